"""Which sweeps share a panel, a colour and a band: the one rule for figures, terminal UI, reports and Python.

Sweeps are grouped by all nominal labels. Those that differ only in random draws or realisations are one point of the
grid: one line, or one band. More groups than colours can distinguish become panels of their own, or rows of a map.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.data.results import EXTREMUM_CURVES, Curve, FrequencyResponse, Result
from fraexp.data.sweep import DRAW, Plain
from fraexp.data.units import with_powers
from fraexp.errors import FraexpError, did_you_mean
from fraexp.figures.elements.labels import (
    MAX_GROUPS,
    RandomDraw,
    curve_names,
    label_columns,
    label_texts,
    nominal_labels,
)

MAX_FACETS = 9
"""Maximum number of panels side by side that still are large enough to be read."""
MAX_MAPS = 4
"""Maximum number of maps side by side."""
MAX_NAMED_ROWS = 40
"""Maximum number of rows of a map that are known by their names."""
KEY = "sweep"
"""Label that distinguishes sweeps which share all others."""
REALISATION = "seed"
"""Last part of the path of a label that counts realisations of noise or phases."""


class CurvePlace(NamedTuple):
    """Where the curve of a sweep belongs in a figure."""

    facet: str = ""
    """Name of its panel, or of its map; empty if there is one."""
    group: str = ""
    """Name that it shares with the curves of its colour; empty if there is one group."""
    point: str = ""
    """Name of its point of the grid: sweeps with the same facet and point differ in random draws only."""
    row: float = np.nan
    """Value at which it is a row of a map, or the number of its row; NaN if it is drawn as a line."""
    axis: str = ""
    """What the rows of a map are, with its unit; empty if they are known by the names of their groups."""
    sample: str = "sweep"
    """What the sweeps of its point are: a draw, a realisation, or a sweep that was repeated."""

    @property
    def is_mapped(self) -> bool:
        """Whether there are too many groups for lines."""
        return bool(np.isfinite(self.row))


OWN_PLACE = CurvePlace()
"""The place of a curve that is alone."""


def group_sweeps(
    labels: Sequence[Plain],
    units: Mapping[str, str] | None = None,
    by: Sequence[str] | None = None,
    keys: Sequence[str] = (),
) -> list[CurvePlace]:
    """Return the place of each sweep from its labels; `units` are those of the labels, by path.

    `by` are the labels that separate groups: without one of them, its values share a colour. By default all are, but
    the labels with the most values where neither panels nor rows of a map could distinguish as many groups. `keys`
    distinguish sweeps whose labels do not. FraexpError if a label is unknown.
    """
    nominal = _with_keys([grid_labels(of) for of in labels], labels, keys)
    texts = {path: label_texts([of.get(path) for of in nominal]) for path in label_columns(nominal)}
    varying = [path for path in texts if len(set(texts[path])) > 1]
    wanted = varying if by is None else [*find_labels(labels, by), KEY]
    chosen = [path for path in varying if path in wanted]
    rows = list(zip(*(texts[path] for path in chosen), strict=True)) if chosen else [()] * len(labels)
    points = _names(nominal, varying, units)
    axis = _row_label(nominal, chosen)
    apart = _facet_labels(rows, MAX_GROUPS if axis else MAX_FACETS)
    if apart is None and by is None and not _can_be_mapped(nominal, chosen, axis, rows):
        kept = _without_most_values(chosen, rows)
        if kept:
            return group_sweeps(labels, units, kept, keys)
    if apart is None:
        places = _map_places(nominal, chosen, axis, points, units or {})
    else:
        facets = _names(nominal, [chosen[index] for index in apart], units)
        groups = _names(nominal, [path for index, path in enumerate(chosen) if index not in apart], units)
        places = [CurvePlace(*of) for of in zip(facets, groups, points, strict=True)]
    return [place._replace(sample=_sample_name(of)) for place, of in zip(places, labels, strict=True)]


def _with_keys(
    nominal: Sequence[dict[str, object]], labels: Sequence[Plain], keys: Sequence[str]
) -> list[dict[str, object]]:
    """Return labels of the grid in which the keys are one where labels repeat without a random draw."""
    texts = [repr(sorted(of.items(), key=repr)) for of in labels]
    repeated = {text for text, count in Counter(texts).items() if count > 1}
    pairs = zip(nominal, texts, keys or [""] * len(texts), strict=True)
    return [{**of, KEY: key} if key and text in repeated else of for of, text, key in pairs]


def grid_labels(labels: Plain) -> dict[str, object]:
    """Return the labels of a sweep that place it in the grid: those that are neither drawn nor count realisations."""
    return {path: value for path, value in nominal_labels(labels).items() if path.rpartition(".")[2] != REALISATION}


def _sample_name(labels: Plain) -> str:
    if DRAW in labels:
        return "draw"
    return "realisation" if any(path.rpartition(".")[2] == REALISATION for path in labels) else "sweep"


def find_labels(labels: Sequence[Plain], names: Sequence[str]) -> list[str]:
    """Return the paths of labels that are given by path or by title; FraexpError if one is unknown."""
    columns = label_columns([grid_labels(of) for of in labels])
    paths = {**{title: path for path, title in columns.items()}, **{path: path for path in columns}}
    for name in names:
        if name not in paths:
            drawn = any(name in of or name == DRAW for of in labels)
            reason = "is drawn at random, and makes no groups" if drawn else "is no label"
            known = f"expected one of: {', '.join(columns.values())}" if columns else "these sweeps have none"
            near = did_you_mean(name, paths).partition("; known")[0]
            raise FraexpError(f"group by: '{name}' {reason}; {known}{near}")
    return list(dict.fromkeys(paths[name] for name in names))


def point_indices(places: Sequence[CurvePlace]) -> dict[tuple[str, str], list[int]]:
    """Return the indices of the sweeps at each point of the grid, by group and name of the point."""
    found: dict[tuple[str, str], list[int]] = {}
    for index, place in enumerate(places):
        found.setdefault((place.group, place.point), []).append(index)
    return found


def facet_indices(places: Sequence[CurvePlace]) -> dict[str, list[int]]:
    """Return the indices of the sweeps in each facet, by its name."""
    found: dict[str, list[int]] = {}
    for index, place in enumerate(places):
        found.setdefault(place.facet, []).append(index)
    return found


def _names(labels: Sequence[Plain], paths: Sequence[str], units: Mapping[str, str] | None) -> list[str]:
    chosen = [{path: of[path] for path in paths if path in of} for of in labels]
    return curve_names(chosen, [""] * len(labels), units)


def _facet_labels(rows: Sequence[tuple[str, ...]], most: int) -> tuple[int, ...] | None:
    """Return which of the labels separate panels: as few as possible; None if more than `most` would be needed."""
    count = len(rows[0]) if rows else 0
    for size in range(count):
        found = []
        for apart in combinations(range(count), size):
            groups = Counter(tuple(row[index] for index in apart) for row in set(rows))
            if len(groups) <= most and max(groups.values(), default=0) <= MAX_GROUPS:
                found.append((len(groups), apart))
        if found:
            return min(found)[1]
    return () if count == 0 else None


def _can_be_mapped(nominal: Sequence[Plain], chosen: Sequence[str], axis: str, rows: Sequence[tuple[str, ...]]) -> bool:
    """Return whether groups are rows of maps that can be told apart: by an amount, or by so few names."""
    others = [path for path in chosen if path != axis]
    maps = {tuple(map(repr, map(of.get, others))) for of in nominal} if axis else ()
    return 0 < len(maps) <= MAX_MAPS or len(set(rows)) <= MAX_NAMED_ROWS or KEY in chosen


def _without_most_values(chosen: Sequence[str], rows: Sequence[tuple[str, ...]]) -> list[str]:
    """Return the labels that separate groups in panels, without those with the most values."""
    counts = [len(set(column)) for column in zip(*rows, strict=True)]
    kept = sorted(range(len(chosen)), key=lambda index: counts[index])
    while kept and _facet_labels([tuple(row[index] for index in sorted(kept)) for row in rows], MAX_FACETS) is None:
        kept.pop()
    return [chosen[index] for index in sorted(kept)]


def _map_places(
    labels: Sequence[Plain], chosen: Sequence[str], axis: str, points: Sequence[str], units: Mapping[str, str]
) -> list[CurvePlace]:
    """Return places in maps over the label `axis`, or else in one map with a row for each group."""
    groups = _names(labels, chosen, units)
    facets = _names(labels, [path for path in chosen if path != axis], units) if axis else []
    if axis and len(set(facets)) <= MAX_MAPS:
        unit = units.get(axis, "")
        title = label_columns(labels)[axis].replace("_", " ")
        title = f"{title[:1].upper()}{title[1:]}" + (f" [{with_powers(unit)}]" if unit else "")
        values = [float(str(of[axis])) for of in labels]
        return [CurvePlace(*of, title) for of in zip(facets, groups, points, values, strict=True)]
    numbers = {name: float(index) for index, name in enumerate(dict.fromkeys(groups))}
    return [CurvePlace("", name, point, numbers[name]) for name, point in zip(groups, points, strict=True)]


def _row_label(labels: Sequence[Plain], chosen: Sequence[str]) -> str:
    """Return the label with the most numbers above 0, if all sweeps have one; empty without such a label."""
    columns = {path: [of.get(path) for of in labels] for path in chosen}
    counts = {path: len(set(column)) for path, column in columns.items() if all(map(_is_amount, column))}
    best = max(counts, key=lambda path: counts[path], default="")
    return best if best and counts[best] > MAX_GROUPS else ""


def _is_amount(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 < value < np.inf


FITTED_CURVE = "plant fit"
"""Name of the curve with the response of a fitted plant: its magnitude, and its phase if that was fitted."""


@dataclass(frozen=True)
class ShownResult:
    """The result of a sweep with its name, and the response of the simulated plant if it is known."""

    label: str
    result: Result
    place: CurvePlace | None = None
    """Where its curve belongs; None for a colour of its own."""
    truth: NDArray[np.complex128] | None = None
    """P(jω) at the frequencies and in the unit of its `response`, shape (n,); None if it is unknown."""
    amplitude: float = np.nan
    """Amplitude of the excitation [`amplitude_unit`]; NaN if there is none, or several."""
    amplitude_unit: str = ""
    key: str = ""
    """Key of its sweep."""
    series: str = ""
    """Name without the amplitude: the sweeps of a series differ in the amplitude only."""
    drawn: RandomDraw | None = None
    """Its random draw; None if nothing was drawn."""

    @property
    def name(self) -> str:
        """Name of its curve in a legend: that of its group if it shares one."""
        return self.place.group if self.place and self.place.group else self.label

    @cached_property
    def response(self) -> FrequencyResponse | None:
        """Its response in the order of frequencies if it has at least one point, otherwise None."""
        found = self.result.response
        return found.ascending() if found is not None and len(found.frequency) else None

    @property
    def fitted(self) -> Curve | None:
        """Magnitude, and phase [deg] if known, of the plant that was fitted to its response; None without a fit.

        The column ``extremum`` is 1 at its resonances and -1 at its antiresonances, ``rigid body`` the magnitude of its
        rigid body alone.
        """
        unit = self.response.unit if self.response else None
        fits = (of for of in self.result.curves if of.name == FITTED_CURVE and of.units.get("magnitude") == unit)
        found = next(fits, None)
        return replace(found, columns={**found.columns, **self._plant_columns(found)}) if found else None

    def _plant_columns(self, of: Curve) -> dict[str, NDArray[np.float64]]:
        frequency, columns = of.columns["frequency"], {"extremum": np.zeros(len(of.columns["frequency"]))}
        for curve in self.result.curves:
            if curve.name in EXTREMUM_CURVES:
                nearest = np.abs(frequency - curve.columns["frequency"][:, None]).argmin(axis=1)
                columns["extremum"][nearest] = EXTREMUM_CURVES[curve.name]
        gains = [fit.component.get("rigid_body_gain") for fit in self.result.fits]
        if gains and isinstance(gains[0], float):
            columns["rigid body"] = gains[0] / (2 * np.pi * frequency) ** 2
        return columns


def curve_places(shown: Sequence[ShownResult]) -> list[CurvePlace]:
    """Return the places of results; those without one are points of the grid of their own."""
    return [of.place or CurvePlace(group=of.label, point=f"{of.label} {index}") for index, of in enumerate(shown)]
