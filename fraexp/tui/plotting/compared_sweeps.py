"""The marked sweeps with their results, and the pictures and commands that compare them."""

import shlex
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from fraexp.data.results import Result
from fraexp.errors import FraexpError
from fraexp.figures.elements.bundles import MAX_SINGLE_CURVES
from fraexp.figures.elements.scales import readable_unit
from fraexp.figures.elements.shown import ShownResult
from fraexp.figures.elements.view import View
from fraexp.store import Store, StoredSweep, leave_out_damaged, url_without_password
from fraexp.tui.plotting import plotted_curves
from fraexp.tui.plotting.plotted_curves import REFERENCE, Picture, Reference
from fraexp.views.comparison import difference_rows, with_common_labels
from fraexp.views.words import plural, short_key
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


@dataclass(frozen=True)
class ComparedSweeps:
    """Sweeps side by side."""

    sweeps: tuple[StoredSweep, ...]
    shown: tuple[ShownResult, ...]
    """Their results with names, in the same order."""
    references: dict[str, Reference]
    """P(jω) by the unit of the responses, where all of them are of one plant."""
    rows: list[list[str]]
    """The differences: a name, and a text for each sweep."""
    left_out: tuple[str, ...]

    @property
    def units(self) -> list[str]:
        """Units of the responses; each is a group."""
        found = (self.unit_of(index) for index in range(len(self.shown)))
        return list(dict.fromkeys(unit for unit in found if unit))

    def groups(self, view: str) -> list[str]:
        """Return the groups of a view, which shows one at a time: units of responses, or kinds of curves."""
        if view in RESPONSE_VIEWS:
            return self.units
        return [kind for kind in plotted_curves.CURVE_KINDS if self.places(view, kind)]

    def unit_of(self, place: int) -> str:
        """Return the unit of a sweep's response; empty without a response."""
        response = self.shown[place].response
        return response.unit if response is not None else ""

    def places(self, view: str, group: str) -> list[int]:
        """Return the places of the sweeps that a view shows in a group."""
        every = range(len(self.shown))
        if view in RESPONSE_VIEWS:
            return [place for place in every if self.unit_of(place) == group]
        return [place for place in every if group in plotted_curves.curve_kinds(self.shown[place])]

    def picture(self, view: str, group: str, first: int) -> Picture:
        """Return the picture of a group in a view; differences are relative to the sweep at place `first`, or to P."""
        wanted = set(self.places(view, group))
        shown = [of if place in wanted else _without_curves(of) for place, of in enumerate(self.shown)]
        if view in RESPONSE_VIEWS and not wanted:
            raise FraexpError("these sweeps have no frequency response; press v for their curves")
        match view:
            case "bode":
                return plotted_curves.bode_picture(shown, self.references.get(group))
            case "difference":
                return plotted_curves.difference_picture(shown, first)
            case "nyquist":
                return plotted_curves.nyquist_picture(shown, self.references.get(group))
            case "coherence":
                return plotted_curves.coherence_picture(shown)
        return plotted_curves.curves_picture(shown, group)

    def labels(self, view: str, group: str) -> dict[int, str]:
        """Return the names of the curves in a view, by place."""
        named = {place: self.shown[place].label for place in self.places(view, group)}
        known = view in ("bode", "difference", "nyquist") and group in self.references
        return named | ({REFERENCE: self.references[group][0]} if known else {})

    def notes(self, view: str, group: str) -> list[str]:
        """Return notes on what a view does not show, and the key that does."""
        others = {of: len(self.places(view, of)) for of in self.groups(view) if of != group}
        if view in RESPONSE_VIEWS:
            notes = [
                f"{plural(count, 'response')} in {readable_unit(of)[1]} in another view: g"
                for of, count in others.items()
            ]
            without = sum(not self.unit_of(place) for place in range(len(self.shown)))
            notes += [f"{plural(without, 'sweep')} without a response: v shows curves"] if without else []
        else:
            more = [f"{plotted_curves.CURVE_KINDS[of]} of {plural(count, 'sweep')}" for of, count in others.items()]
            notes = [f"{', '.join(more)}: g"] if more else []
            without = sum(not of.result.curves for of in self.shown)
            notes += [f"{plural(without, 'sweep')} without a curve"] if without else []
        return [*notes, *self.left_out]


def read_marked_sweeps(store: Store, marked: Iterable[str]) -> MarkedSweeps:
    """Read the marked sweeps and their results."""
    found, gone = [], []
    for key in marked:
        try:
            found.append(store.find(key))
        except FraexpError:  # deleted since
            gone.append(key)
    notes = [f"{plural(len(gone), 'marked sweep')} no longer in the database"] if gone else []
    with_result = [sweep for sweep in found if sweep.outcome is not None]
    if len(found) > len(with_result):
        notes.append(f"{plural(len(found) - len(with_result), 'sweep')} without a result")
    if len(with_result) > MAX_SINGLE_CURVES:
        notes.append(f"{len(with_result) - MAX_SINGLE_CURVES} more than {MAX_SINGLE_CURVES}, the maximum")
    sweeps = with_common_labels(store, with_result[:MAX_SINGLE_CURVES])
    results = store.results(sweep.key for sweep in sweeps)
    sweeps = leave_out_damaged(sweeps, results, notes.append)
    return MarkedSweeps(tuple(sweep for sweep in sweeps if sweep.key in results), results, tuple(notes), tuple(gone))


def compare_sweeps(workspace: WorkspaceService, gathered: MarkedSweeps) -> ComparedSweeps:
    """Return sweeps for comparison: named, with their differences, and the response of the plant where it is known."""
    sweeps, results = gathered.sweeps, gathered.results
    named = tuple(workspace.figures.shown_results(sweeps, results))
    references: dict[str, Reference] = {}
    for unit in dict.fromkeys(of.response.unit for of in named if of.response is not None):
        group = [s for s, of in zip(sweeps, named, strict=True) if of.response is not None and of.response.unit == unit]
        try:
            found = workspace.figures.reference(group, results)
        except FraexpError:  # a missing plugin: stored results are shown without the plant
            found = None
        references |= {unit: found} if found is not None else {}
    return ComparedSweeps(sweeps, named, references, difference_rows(sweeps, results), gathered.left_out)


def compare_command(workspace: WorkspaceService, keys: Sequence[str]) -> str:
    """Return the command line that prints the differences between sweeps."""
    return shlex.join(["fraexp", "compare", *map(short_key, keys), *_location_options(workspace)])


def plot_command(workspace: WorkspaceService, keys: Sequence[str], kind: str, file: str, view: View) -> str:
    """Return the command line that draws a figure of sweeps."""
    return shlex.join(["fraexp", *plot_arguments(keys, kind, file, view), *_location_options(workspace)])


def plot_arguments(keys: Sequence[str], kind: str, file: str, view: View) -> list[str]:
    """Return the arguments that draw a figure of sweeps, or the visible part of it."""
    return ["plot", *map(short_key, keys), "--kind", kind, *view.options(), "-o", file]


def _location_options(workspace: WorkspaceService) -> list[str]:
    """Return the options that name workspace and database, unless they are those of the current folder."""
    here = workspace.folder.resolve() == Path.cwd()
    usual = workspace.database == str(workspace.folder / "results.db")
    folder = [] if here else [f"--workspace={workspace.folder}"]
    return folder + ([] if usual else [f"--db={url_without_password(workspace.database)}"])


def _without_curves(shown: ShownResult) -> ShownResult:
    """Return a result without a response and curves."""
    return replace(shown, result=replace(shown.result, response=None, curves=()))
