"""The marked sweeps with their results, and the pictures and commands that compare them."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from fraexp.data.results import Result
from fraexp.errors import FraexpError
from fraexp.figures.elements.bands import MAX_SINGLE_CURVES, MIN_QUANTILE_CURVES
from fraexp.figures.elements.grouping import CurvePlace, ShownResult, grid_labels
from fraexp.figures.elements.labels import label_columns
from fraexp.figures.elements.scales import readable_unit
from fraexp.store import Store, StoredSweep, leave_out_damaged
from fraexp.tui.plotting import plotted_curves
from fraexp.tui.plotting.plotted_curves import REFERENCE, Picture, Reference
from fraexp.views.comparison import difference_rows, fold_incomparable, with_all_labels
from fraexp.views.words import plural
from fraexp.workspace.workspace_service import WorkspaceService

VIEW_NAMES = {
    "bode": "Bode",
    "difference": "Difference",
    "nyquist": "Nyquist",
    "coherence": "Coherence",
    "curves": "Curves",
}
"""Names of the views."""
RESPONSE_VIEWS = ("bode", "difference", "nyquist", "coherence")
"""Views of frequency responses, which must share a unit."""


MAX_COMPARED_SWEEPS = 20_000
"""Maximum number of sweeps that are compared."""
MAX_CURVES = 35
"""Maximum number of curves: each has a digit or a letter."""
MAX_DRAWN_LINES = 12
"""Maximum number of lines that stand for the sweeps of one point where a view has no bands."""
GOLDEN_RATIO = (1 + 5**0.5) / 2
FACET_MARK = "\0"
"""Separates a unit or a kind of curves from the name of a facet."""


@dataclass(frozen=True)
class MarkedSweeps:
    """The marked sweeps in the database."""

    sweeps: tuple[StoredSweep, ...]
    """Those with a result, in the order of marking."""
    results: dict[str, Result]
    left_out: tuple[str, ...]
    """Notes on sweeps that cannot be compared."""
    gone: tuple[str, ...]
    """Keys that are no longer in the database."""

    def is_same(self, other: "MarkedSweeps | None") -> bool:
        """Return whether others are the same sweeps with the same results."""
        if other is None or other.left_out != self.left_out:
            return False
        mine, theirs = ([(of.key, of.created, of.labels) for of in each.sweeps] for each in (self, other))
        return mine == theirs


@dataclass(frozen=True)
class ComparedCurve:
    """One name and colour of a view: a sweep, or a group whose points are sweeps or random draws."""

    label: str
    points: tuple[tuple[int, ...], ...]
    """Indices of the sweeps at each point of the grid; several of a point are random draws or realisations."""
    facet: str = ""
    """Name of the view that shows it, if one view cannot show all; empty if it can."""

    @property
    def members(self) -> list[int]:
        """Indices of all of its sweeps."""
        return [index for point in self.points for index in point]

    @property
    def some_members(self) -> list[int]:
        """Indices of sweeps that stand for all where each is a line of its own."""
        return [index for point in self.points for index in point[:MAX_DRAWN_LINES]]


@dataclass(frozen=True)
class ComparedSweeps:
    """Sweeps side by side, as curves that are numbered from 0: the places of curves."""

    sweeps: tuple[StoredSweep, ...]
    shown: tuple[ShownResult, ...]
    """Their results with names, in the same order."""
    curves: tuple[ComparedCurve, ...]
    references: dict[str, Reference]
    """P(jω) by the unit of the responses, where all of them are of one plant."""
    rows: list[Sequence[str]]
    """The differences: a name, and a text for each curve, the median where its sweeps differ."""
    folded: dict[str, int]
    """Number of parameters that are left out of the rows, as not all curves have them, by component."""
    left_out: tuple[str, ...]

    @property
    def units(self) -> list[str]:
        """Units of the responses; each is a group."""
        found = (self.unit_of(place) for place in range(len(self.curves)))
        return list(dict.fromkeys(unit for unit in found if unit))

    @property
    def default_view(self) -> str:
        """The view that is shown first."""
        return "bode" if self.units else "curves"

    def groups(self, view: str) -> list[str]:
        """Return the groups of a view, which shows one at a time.

        They are units of responses, or kinds of curves, each once for every facet.
        """
        facets = list(dict.fromkeys(curve.facet for curve in self.curves))
        heads = self.units if view in RESPONSE_VIEWS else list(plotted_curves.CURVE_KINDS)
        found = [f"{head}{FACET_MARK}{facet}" if facet else head for head in heads for facet in facets]
        return [group for group in found if self.places(view, group)]

    def unit_of(self, place: int) -> str:
        """Return the unit of a curve's response; empty without a response."""
        responses = (self.shown[index].response for index in self.curves[place].members)
        return next((of.unit for of in responses if of is not None), "")

    def places(self, view: str, group: str) -> list[int]:
        """Return the places of the curves that a view shows in a group."""
        head, facet = split_group(group)
        every = [place for place, curve in enumerate(self.curves) if curve.facet == facet]
        if view in RESPONSE_VIEWS:
            return [place for place in every if self.unit_of(place) == head]
        return [place for place in every if head in self._kinds(place)]

    def _kinds(self, place: int) -> set[str]:
        members = self.curves[place].some_members
        return {kind for index in members for kind in plotted_curves.curve_kinds(self.shown[index])}

    def keys_of(self, places: Iterable[int]) -> list[str]:
        """Return the keys of the sweeps of curves."""
        return [sweep.key for place in places for sweep in self.members(place)]

    @property
    def curve_names(self) -> list[str]:
        """What identifies each curve in other comparisons: the key of its sweep, or the name of its group."""
        curves = ((curve, self.sweeps[curve.members[0]].key) for curve in self.curves)
        return [curve.label if len(curve.members) > 1 else key for curve, key in curves]

    def varying_labels(self) -> dict[str, str]:
        """Return the labels that may make groups, by path, with their titles and numbers of values."""
        labels = [grid_labels(sweep.labels) for sweep in self.sweeps]
        titles = label_columns(labels)
        counts = {path: len({repr(of.get(path)) for of in labels}) for path in titles}
        return {path: f"{titles[path]}  ({count} values)" for path, count in counts.items() if count > 1}

    def members(self, place: int) -> list[StoredSweep]:
        """Return the sweeps of a curve."""
        return [self.sweeps[index] for index in self.curves[place].members]

    def picture(self, view: str, group: str, first: int) -> Picture:
        """Return the picture of a group in a view; differences are relative to the curve at place `first`, or to P."""
        head, wanted = split_group(group)[0], self.places(view, group)
        if view in RESPONSE_VIEWS and not wanted:
            raise FraexpError("these sweeps have no frequency response; press v for their curves")
        curve_of = {index: place for place in wanted for index in self.curves[place].members}
        drawn = list(curve_of)
        if view != "bode":
            drawn = [index for place in wanted for index in self.curves[place].some_members]
        shown, reference = [self.shown[index] for index in drawn], self.references.get(head)
        match view:
            case "bode":
                picture = plotted_curves.bode_picture(shown, reference, self._point_of)
            case "difference":
                picture = plotted_curves.difference_picture(shown, self._position(drawn, first))
            case "nyquist":
                picture = plotted_curves.nyquist_picture(shown, reference)
            case "coherence":
                picture = plotted_curves.coherence_picture(shown)
            case _:
                picture = plotted_curves.curves_picture(shown, head)
        return plotted_curves.with_curves(picture, {at: curve_of[index] for at, index in enumerate(drawn)})

    def first_place(self, group: str, wanted: int | None) -> int:
        """Return the reference of the differences in a group: the wanted curve, else P(jω), else the first curve."""
        places = self.places("difference", group)
        members = [self.shown[index] for place in places for index in self.curves[place].some_members]
        if wanted is not None and wanted in places:
            return wanted
        return REFERENCE if any(of.truth is not None for of in members) else next(iter(places), 0)

    def _point_of(self, shown: ShownResult) -> CurvePlace:
        """Return where a result belongs if its point has several, else a place of its own."""
        if shown.place is None:
            return CurvePlace(point=shown.key)
        place = shown.place
        return CurvePlace("", place.group, place.point, place.row, place.axis)

    def _position(self, drawn: Sequence[int], first: int) -> int:
        if first == REFERENCE:
            return REFERENCE
        return next((at for at, index in enumerate(drawn) if index in self.curves[first].members), 0)

    def labels(self, view: str, group: str) -> dict[int, str]:
        """Return the names of the curves in a view, by place."""
        named = {place: self.curves[place].label for place in self.places(view, group)}
        head = split_group(group)[0]
        known = view in ("bode", "nyquist") and head in self.references
        return named | ({REFERENCE: self.references[head][0]} if known else {})

    def notes(self, view: str, group: str) -> list[str]:
        """Return notes on what a view does not show, and the key that does."""
        groups = self.groups(view)
        at = groups.index(group) if group in groups else -1
        others = {of: len(self.places(view, of)) for of in [*groups[at + 1 :], *groups[: max(at, 0)]]}
        if view in RESPONSE_VIEWS:
            notes = [_other_views(others)] if others else []
            without = sum(not self.unit_of(place) for place in range(len(self.curves)))
            notes += [f"{plural(without, 'sweep')} without a response: v shows curves"] if without else []
        else:
            more = [_other_curves(of, count) for of, count in others.items()]
            notes = [f"{', '.join(more)}: g"] if more else []
            without = sum(not of.result.curves for of in self.shown)
            notes += [f"{plural(without, 'sweep')} without a curve"] if without else []
        return [*notes, *self._sample_notes(view, group), *self.left_out]

    def _sample_notes(self, view: str, group: str) -> list[str]:
        """Return how random draws are drawn."""
        counts = [len(point) for place in self.places(view, group) for point in self.curves[place].points]
        most = max(counts, default=1)
        if most > 1 and view == "bode":
            quantiles = "median and 5…95 %" if most >= MIN_QUANTILE_CURVES else "lines"
            return [f"{quantiles} of {_count_range(counts)} sweeps each: Enter opens them"]
        return [f"{MAX_DRAWN_LINES} of {most} sweeps of a curve"] if most > MAX_DRAWN_LINES else []


def split_group(group: str) -> tuple[str, str]:
    """Return the unit or the kind of curves of a group, and its facet."""
    head, _, facet = group.partition(FACET_MARK)
    return head, facet


def _other_views(others: Mapping[str, int]) -> str:
    """Return which views there are beside this one, the next first."""
    text = _other_text(*next(iter(others.items())))
    return f"{text} in another view: g" if len(others) == 1 else f"g: {text}, the next of {len(others)} more views"


def _other_text(group: str, count: int) -> str:
    unit, facet = split_group(group)
    if facet:
        return facet
    return f"{plural(count, 'response')} in {readable_unit(unit)[1]}"


def _other_curves(group: str, count: int) -> str:
    kind, facet = split_group(group)
    return f"{plotted_curves.CURVE_KINDS[kind]} of {facet or plural(count, 'sweep')}"


def _count_range(counts: Sequence[int]) -> str:
    return str(max(counts)) if min(counts) == max(counts) else f"{min(counts)} to {max(counts)}"


def read_marked_sweeps(store: Store, marked: Iterable[str], most: int = MAX_COMPARED_SWEEPS) -> MarkedSweeps:
    """Read the marked sweeps and their results; of more than `most`, up to that many distributed ones."""
    keys = list(marked)
    some = _distribute(keys, most) if len(keys) > most else keys
    found = store.find_all(some)
    gone = [key for key in some if key not in found]
    notes = [f"{plural(len(gone), 'marked sweep')} no longer in the database"] if gone else []
    with_result = [sweep for sweep in found.values() if sweep.outcome is not None]
    if len(found) > len(with_result):
        notes.append(f"{plural(len(found) - len(with_result), 'sweep')} without a result")
    if len(some) < len(keys):
        notes.append(f"{len(some):,} of {len(keys):,} sweeps so far")
    sweeps = with_all_labels(with_result)
    results = store.results(sweep.key for sweep in sweeps)
    sweeps = leave_out_damaged(sweeps, results, notes.append)
    return MarkedSweeps(tuple(sweep for sweep in sweeps if sweep.key in results), results, tuple(notes), tuple(gone))


def _distribute(keys: Sequence[str], count: int) -> list[str]:
    """Return up to `count` of the keys by multiples of the golden ratio.

    Their distances are nearly even, but repeat with no period of a grid: each of its points is met.
    """
    places = {int(index * GOLDEN_RATIO % 1 * len(keys)) for index in range(count)}
    return [keys[place] for place in sorted(places)]


def compare_sweeps(
    workspace: WorkspaceService, gathered: MarkedSweeps, by: Sequence[str] | None = None, apart: bool = False
) -> ComparedSweeps:
    """Return sweeps for comparison: named, grouped, with their differences, and the response of the plant if known.

    `by` are the labels that separate groups, see `group_sweeps`; with `apart` each sweep is a curve of its own.
    """
    sweeps, results, left_out = gathered.sweeps, gathered.results, gathered.left_out
    if apart and len(sweeps) > MAX_SINGLE_CURVES:
        left_out = (*left_out, f"{MAX_SINGLE_CURVES} of {len(sweeps)} sweeps")
        sweeps = sweeps[:MAX_SINGLE_CURVES]
    few = len(sweeps) <= MAX_SINGLE_CURVES
    named = tuple(workspace.figures.shown_results(sweeps, results, few, by))
    if apart:
        named = tuple(replace(of, place=None) for of in named)
    curves = _curves(named)
    if len(curves) > MAX_CURVES:
        left_out = (*left_out, f"{MAX_CURVES} of {len(curves)} groups: G merges some")
        curves = curves[:MAX_CURVES]
    leads = [sweeps[curve.members[0]] for curve in curves]
    references = _references(workspace, sweeps if few else leads, results)
    groups = [[sweeps[index] for index in curve.members] for curve in curves]
    rows, folded = fold_incomparable(difference_rows(groups, results, workspace.registry))
    return ComparedSweeps(tuple(sweeps), named, curves, references, rows, folded, left_out)


def _references(
    workspace: WorkspaceService, sweeps: Sequence[StoredSweep], results: Mapping[str, Result]
) -> dict[str, Reference]:
    by_unit: dict[str, list[StoredSweep]] = {}
    for sweep in sweeps:
        response = results[sweep.key].response
        if response is not None and len(response.frequency):
            by_unit.setdefault(response.unit, []).append(sweep)
    found: dict[str, Reference] = {}
    for unit, group in by_unit.items():
        try:
            reference = workspace.figures.reference(group, results)
        except FraexpError:  # a missing plugin: stored results are shown without the plant
            reference = None
        found |= {unit: reference} if reference is not None else {}
    return found


def _curves(shown: Sequence[ShownResult]) -> tuple[ComparedCurve, ...]:
    """Return the curves of results by facet and group; where too many groups would be facets, all are in one view."""
    points: dict[tuple[str, str], dict[str, list[int]]] = {}
    for index, of in enumerate(shown):
        place = of.place or CurvePlace(group=of.label, point=f"{of.label} {index}")
        facet = "" if place.is_mapped else place.facet
        group = place.group or (place.point if place.sample == "sweep" else "")
        unit = of.response.unit if of.response else ""
        points.setdefault((facet, f"{group}{FACET_MARK}{unit}"), {}).setdefault(place.point, []).append(index)
    return tuple(
        ComparedCurve(_curve_label(shown, list(of.values())), tuple(map(tuple, of.values())), facet)
        for (facet, _), of in points.items()
    )


def _curve_label(shown: Sequence[ShownResult], points: Sequence[Sequence[int]]) -> str:
    first = shown[points[0][0]]
    count = sum(map(len, points))
    if count == 1 or first.place is None:
        return first.label
    noun = first.place.sample if len(points) == 1 else "sweep"
    return f"{first.place.group}, {plural(count, noun)}".removeprefix(", ")
