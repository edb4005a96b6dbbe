"""Time to compile the kernels that a run needs and this machine has not compiled yet."""

from collections.abc import Callable, Iterable

from fraexp.execution.estimates.reference_costs import compile_cost
from fraexp.execution.estimates.speeds import COMPILE, Speeds

LOOP, DRIVE = "loop", "drive"
"""Families of work with compiled kernels: one kernel for each law, in lanes or not."""
SHARED_KERNEL = "shared"
"""The part that the loops of all laws share, which is compiled with the first one."""


def kernels_of(kinds: Iterable[str], source: Callable[[str], str]) -> frozenset[str]:
    """Return the kernels for kinds of work such as ``loop/rolling/lanes``, each with a hash of its law's source."""
    return frozenset(f"{kind}/{source(kind.split('/')[1])}" for kind in kinds if _family(kind) in (LOOP, DRIVE))


def compile_seconds(kernels: Iterable[str], speeds: Speeds) -> float:
    """Return the time [s] to compile those of the kernels that this machine has not compiled yet."""
    return sum(_family_seconds(family, speeds) for family in new_families(kernels, speeds.kernels))


def new_families(kernels: Iterable[str], known: frozenset[str]) -> list[str]:
    """Return the family of each unknown kernel, and the shared part of loops if no loop is known."""
    new = [_family(kernel) for kernel in sorted(set(kernels) - known)]
    return [*new, SHARED_KERNEL] if LOOP in new and LOOP not in map(_family, known) else new


def _family(kind: str) -> str:
    return kind.partition("/")[0]


def _family_seconds(family: str, speeds: Speeds) -> float:
    return compile_cost(family) * speeds.ratio(f"{COMPILE}/{family}")
