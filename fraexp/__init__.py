"""fraexp: frequency response analysis of machines with friction.

This is the Python interface: `Workspace` runs studies and reads their results, `Study` writes one in Python, and
`simulate`, `read_record` and `estimate` work without a database. Names that are not listed in ``__all__`` are private;
plugins import `fraexp.api`.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fraexp.errors import FraexpError
    from fraexp.interface.callable_law import FrictionLaw
    from fraexp.interface.direct_computation import Recording
    from fraexp.interface.result_sets import Identification, Results, Run
    from fraexp.interface.session import Workspace, estimate, friction_law, identify, read_record, run, simulate
    from fraexp.interface.study_source import Study
    from fraexp.interface.sweep_results import SweepResult

__all__ = [
    "FraexpError",
    "FrictionLaw",
    "Identification",
    "Recording",
    "Results",
    "Run",
    "Study",
    "SweepResult",
    "Workspace",
    "estimate",
    "friction_law",
    "identify",
    "read_record",
    "run",
    "simulate",
]

_MODULES = {
    "FraexpError": "errors",
    "FrictionLaw": "interface.callable_law",
    "Identification": "interface.result_sets",
    "Recording": "interface.direct_computation",
    "Results": "interface.result_sets",
    "Run": "interface.result_sets",
    "Study": "interface.study_source",
    "SweepResult": "interface.sweep_results",
    "Workspace": "interface.session",
}
_SHORTCUTS = "interface.session"
"""Module of all other names: importing fraexp loads nothing, so that the command line starts at once."""


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f"module 'fraexp' has no attribute '{name}'")
    value = globals()[name] = getattr(import_module(f"fraexp.{_MODULES.get(name, _SHORTCUTS)}"), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
