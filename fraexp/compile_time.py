"""The time to compile what a run needs and this machine has not compiled yet."""

from collections.abc import Iterable

from fraexp.reference_costs import compile_cost
from fraexp.speeds import COMPILE, Speeds

KERNELS = ("loop", "drive")
"""Families of work that a compiled kernel does: one kernel for each law, in lanes or not."""


def kernels_of(kinds: Iterable[str]) -> frozenset[str]:
    """Return the kernels that do these kinds of work, such as ``loop/rolling/lanes``."""
    return frozenset(kind for kind in kinds if kind.partition("/")[0] in KERNELS)


def compile_seconds(kernels: Iterable[str], speeds: Speeds) -> float:
    """Return the time [s] to compile those of the kernels that this machine has not compiled yet."""
    new = sorted(set(kernels) - speeds.kernels)
    return sum(_seconds(kernel.partition("/")[0], speeds) for kernel in new)


def _seconds(family: str, speeds: Speeds) -> float:
    return compile_cost(family) * speeds.ratio(f"{COMPILE}/{family}")
