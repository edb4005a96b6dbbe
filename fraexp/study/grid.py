"""The points of a grid: its axes laid over the sections of a study."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fraexp.data.sweep import Plain, as_section
from fraexp.study.sections import merge, nested_table


@dataclass(frozen=True)
class Row:
    """Points of a grid that differ in one section only: those along its last axis."""

    sections: Mapping[str, Any]
    """What is written at the first of them."""
    inner: str
    """Section that the last axis varies; empty for a study without a grid."""
    variants: Sequence[Any]
    """That section at each point."""
    values: Sequence[tuple[Any, ...]]
    """Value of each axis, at each point."""


def rows(sections: Plain, grid: Mapping[str, Sequence[Any]], place: str) -> Iterator[Row]:
    """Yield the rows of a grid in the order of its points; the last axis varies fastest.

    A section that is written the same at several points is the same object.
    """
    written = {name: as_section(value) for name, value in sections.items()}
    if not grid:
        yield Row(written, "", ("",), ((),))
        return
    variants = {name: _Variants(name, written, grid, place) for name in dict.fromkeys(map(owner, grid))}
    *outer, last = grid.values()
    inner = owner(list(grid)[-1])
    for point in itertools.product(*(range(len(axis)) for axis in outer)):
        before = tuple([axis[index] for axis, index in zip(outer, point, strict=True)])
        along = [variants[inner].variant_at((*point, index)) for index in range(len(last))]
        first = {name: of.variant_at((*point, 0)) for name, of in variants.items()}
        yield Row({**written, **first}, inner, along, [(*before, value) for value in last])


def owner(path: str) -> str:
    """Return the section that a path leads into."""
    return path.partition(".")[0]


class _Variants:
    """A section as it is written at the points of a grid, by the indices of the axes that vary it."""

    def __init__(self, name: str, sections: Plain, grid: Mapping[str, Sequence[Any]], place: str) -> None:
        self._name, self._place = name, place
        self._base = {name: sections[name]} if name in sections else {}
        self._axes = [(at, path, values) for at, (path, values) in enumerate(grid.items()) if owner(path) == name]
        self._made: dict[tuple[int, ...], Any] = {}

    def variant_at(self, point: tuple[int, ...]) -> Any:
        """Return the section at a point, given by the index of the value on each axis."""
        mine = tuple([point[at] for at, _, _ in self._axes])
        if mine not in self._made:
            self._made[mine] = self._lay_over(mine)
        return self._made[mine]

    def _lay_over(self, indices: tuple[int, ...]) -> Any:
        whole: dict[str, Any] = self._base
        for (_, path, values), index in zip(self._axes, indices, strict=True):
            whole = merge(whole, nested_table(path, values[index]), self._place)
        return as_section(whole[self._name])
