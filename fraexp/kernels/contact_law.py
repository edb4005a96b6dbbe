"""The laws of several contacts as one, which the number of a contact chooses from: a block then has one law to run."""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

from fraexp.kernels.lanes import LaneRows, LaneValue
from fraexp.kernels.law import Law
from fraexp.kernels.law_arguments import LawArgument


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
