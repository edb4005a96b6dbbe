"""The time to compile what a run needs and this machine has not compiled yet."""

from collections.abc import Callable, Iterable

from fraexp.reference_costs import compile_cost
from fraexp.speeds import COMPILE, Speeds

KERNELS = ("loop", "drive")
"""Families of work that a compiled kernel does: one kernel for each law, in lanes or not."""
SHARED = "shared"
"""What is the same for all laws, and is compiled with the first one."""


def kernels_of(kinds: Iterable[str], source: Callable[[str], str]) -> frozenset[str]:
    """Return the kernels for kinds of work such as ``loop/rolling/lanes``, each with a hash of its law's source."""
    return frozenset(f"{kind}/{source(kind.split('/')[1])}" for kind in kinds if kind.partition("/")[0] in KERNELS)


def compile_seconds(kernels: Iterable[str], speeds: Speeds) -> float:
    """Return the time [s] to compile those of the kernels that this machine has not compiled yet."""
    return sum(_seconds(family, speeds) for family in new_families(kernels, speeds.kernels))


def new_families(kernels: Iterable[str], known: frozenset[str]) -> list[str]:
    """Return the family of each kernel that is not among the known ones, and what all share if none is known."""
    new = [kernel.partition("/")[0] for kernel in sorted(set(kernels) - known)]
    return [*new, SHARED] if new and not known else new


def _seconds(family: str, speeds: Speeds) -> float:
    return compile_cost(family) * speeds.ratio(f"{COMPILE}/{family}")
