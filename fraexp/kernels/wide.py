"""Whether a friction law can be computed for several machines at once."""

from typing import Any

from fraexp.kernels.lanes import rows_of
from fraexp.kernels.law import Law, LawError, cached, call
from fraexp.kernels.loop import bound_argument
from fraexp.kernels.storage import stored, zeros


def vectorises(law: Law, arguments: tuple[Any, ...], states: int) -> bool:
    """Try a law in lanes: False if it branches on a value, or uses what lanes lack."""
    z, z_next, displacement = (zeros(rows, True) for rows in (states, states, 1))
    try:
        call(_make_trial, law, z, z_next, displacement, stored(arguments, True))
    except LawError:
        return False
    return True


def _make_trial(law: Law, fingerprint: str) -> Any:
    def trial(z, z_next, displacement, arguments):  # type: ignore[no-untyped-def]
        _ = fingerprint  # a cell of the closure: an edited law is compiled again
        force = rows_of(displacement)
        force[0] = law(rows_of(z), force[0], 1.0, rows_of(z_next), *bound_argument(arguments, force))

    return cached(trial)
