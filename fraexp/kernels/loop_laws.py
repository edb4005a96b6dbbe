"""The laws of a loop: that of friction, and that of its compensation; and the call of them that was recorded last.

The laws of several contacts are one, which the number of a contact chooses from: a block then has one law to run.
"""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

from fraexp.kernels.batch_arrays import KernelBatch
from fraexp.kernels.call_watch import FIRST_BUILT_IN_STEPS
from fraexp.kernels.guards import state_half
from fraexp.kernels.lanes import LaneRows, LaneValue
from fraexp.kernels.law import Law, is_all_built_in
from fraexp.kernels.law_arguments import ArgumentKinds, LawArgument
from fraexp.kernels.law_error import LawCall
from fraexp.kernels.observed_law import FRICTION


class Laws(NamedTuple):
    """The law of friction and that of its compensation, if any, with the kinds of their arguments."""

    law: Law
    kinds: ArgumentKinds
    compensation_law: Law | None = None
    compensation_kinds: ArgumentKinds = ()
    is_set_valued: tuple[bool, ...] = (False,)
    """Whether friction at each contact is a law of velocity that jumps at rest. For several contacts, the law takes the
    number of one before its other arguments."""

    @property
    def given(self) -> tuple[Law, ...]:
        """The law, and that of the compensation, if any."""
        return (self.law,) if self.compensation_law is None else (self.law, self.compensation_law)

    @property
    def first_steps(self) -> int:
        """Steps of the first call into compiled code: few, if a law might be slow."""
        return FIRST_BUILT_IN_STEPS if all(map(is_all_built_in, self.given)) else 0

    def is_observed(self, is_vectorised: bool) -> bool:
        """Whether calls of the laws are recorded: those of dropped-in laws in the scalar kernel, at one contact."""
        if len(self.is_set_valued) > 1:
            return False
        return not (is_vectorised or all(map(is_all_built_in, self.given)))


def last_call(laws: Laws, batch: KernelBatch) -> tuple[Law, LawCall | None]:
    """Return the law that was called last, and the call, if it is on record."""
    if not laws.is_observed(batch.layout.is_vectorised):
        return laws.law, None
    number, half, dy, dt = batch.last_call.tolist()
    z = state_half(batch.law_memories[int(number)], int(half) if number == FRICTION else 0)[:, 0]
    return laws.given[int(number)], LawCall(z.copy(), dy, dt)


def chosen_law(laws: Sequence[Law]) -> Law:
    """Return the law (contact, z, dy, dt, z_next, arguments) that is one of several, by the number of the contact.

    Their states lie one after another in z. See `chosen_arguments` for the arguments.
    """
    chosen = _last(laws[-1])
    for law in laws[-2::-1]:
        chosen = _choice(law, chosen)
    return chosen


def chosen_arguments(sizes: Sequence[int], arguments: Sequence[tuple[LawArgument, ...]]) -> tuple[LawArgument, ...]:
    """Return what the chosen law takes: the size of the first law's state, its arguments, and those of the rest."""
    chosen = arguments[-1]
    for size, given in zip(sizes[-2::-1], arguments[-2::-1], strict=True):
        chosen = (size, given, chosen)
    return chosen


@cache
def _last(law: Law) -> Law:
    def advance(
        contact: int, z: LaneRows, dy: LaneValue, dt: float, z_next: LaneRows, arguments: tuple[LawArgument, ...]
    ) -> LaneValue:
        return law(z, dy, dt, z_next, *arguments)

    return advance


@cache
def _choice(first: Law, rest: Callable[..., LaneValue]) -> Law:
    def advance(
        contact: int, z: LaneRows, dy: LaneValue, dt: float, z_next: LaneRows, arguments: tuple[Any, ...]
    ) -> LaneValue:
        size, first_arguments, rest_arguments = arguments
        if contact == 0:
            return first(z[:size], dy, dt, z_next[:size], *first_arguments)
        return rest(contact - 1, z[size:], dy, dt, z_next[size:], rest_arguments)

    return advance
