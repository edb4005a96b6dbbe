"""What is compared: the marked sweeps, what they have found, and the pictures and commands that show it."""

import shlex
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from fraexp.data.results import Result
from fraexp.errors import FraexpError
from fraexp.figures.elements.bundles import MANY
from fraexp.figures.elements.scales import readable_unit
from fraexp.figures.elements.shown import ShownResult
from fraexp.figures.elements.view import View
from fraexp.store import Store, StoredSweep, shown
from fraexp.tui.plotting import plotted_curves
from fraexp.tui.plotting.plotted_curves import REFERENCE, Picture, Reference
from fraexp.views.comparison import named_alike, rows_that_differ
from fraexp.views.words import plural, short
from fraexp.workspace.workspace import Workspace

VIEWS = {
    "bode": "Bode",
    "difference": "Difference",
    "nyquist": "Nyquist",
    "coherence": "Coherence",
    "curves": "Curves",
}
"""Names of the views."""
OF_RESPONSES = ("bode", "difference", "nyquist", "coherence")
"""Views for which sweeps need a frequency response, and share its unit."""


@dataclass(frozen=True)
class Gathered:
    """What the database has of the marked sweeps."""

    sweeps: tuple[StoredSweep, ...]
    """Those with a result, in the order of marking."""
    results: dict[str, Result]
    left_out: tuple[str, ...]
    """What cannot be compared, and why."""
    gone: tuple[str, ...]
    """Keys that are not in the database any more."""


@dataclass(frozen=True)
class ComparedSweeps:
    """Sweeps side by side."""

    sweeps: tuple[StoredSweep, ...]
    shown: tuple[ShownResult, ...]
    """Their results with names, in the same order."""
    references: dict[str, Reference]
    """P(jω) by the unit of the responses, where all of them are of one plant."""
    rows: list[list[str]]
    """In what they differ: a name, and a text for each."""
    left_out: tuple[str, ...]

    @property
    def units(self) -> list[str]:
        """Units of the responses, each a group of its own."""
        found = (self.unit_of(index) for index in range(len(self.shown)))
        return list(dict.fromkeys(unit for unit in found if unit))

    def groups(self, view: str) -> list[str]:
        """Return what a view shows one of at a time: units of responses, or kinds of curves."""
        if view in OF_RESPONSES:
            return self.units
        return [kind for kind in plotted_curves.KINDS if self.places(view, kind)]

    def unit_of(self, place: int) -> str:
        """Return the unit of a sweep's response; empty if it has none."""
        response = self.shown[place].response
        return response.unit if response is not None else ""

    def places(self, view: str, group: str) -> list[int]:
        """Return the places of the sweeps of which a view shows something in a group."""
        every = range(len(self.shown))
        if view in OF_RESPONSES:
            return [place for place in every if self.unit_of(place) == group]
        return [place for place in every if group in plotted_curves.kinds_of(self.shown[place])]

    def picture(self, view: str, group: str, first: int) -> Picture:
        """Return what a view shows of a group; differences are from the sweep at the place `first`, or from P."""
        wanted = set(self.places(view, group))
        shown = [of if place in wanted else _nothing(of) for place, of in enumerate(self.shown)]
        if view in OF_RESPONSES and not wanted:
            raise FraexpError("none of these sweeps has a frequency response; v shows their curves")
        match view:
            case "bode":
                return plotted_curves.bode(shown, self.references.get(group))
            case "difference":
                return plotted_curves.difference(shown, first)
            case "nyquist":
                return plotted_curves.nyquist(shown, self.references.get(group))
            case "coherence":
                return plotted_curves.coherence(shown)
        return plotted_curves.curves(shown, group)

    def labels(self, view: str, group: str) -> dict[int, str]:
        """Return the names of what a view can show, by place."""
        named = {place: self.shown[place].label for place in self.places(view, group)}
        known = view in ("bode", "difference", "nyquist") and group in self.references
        return named | ({REFERENCE: self.references[group][0]} if known else {})

    def notes(self, view: str, group: str) -> list[str]:
        """Return what a view does not show of the sweeps, and the key that does."""
        others = {of: len(self.places(view, of)) for of in self.groups(view) if of != group}
        if view in OF_RESPONSES:
            notes = [
                f"{plural(count, 'response')} in {readable_unit(of)[1]} on other axes: g"
                for of, count in others.items()
            ]
            without = sum(not self.unit_of(place) for place in range(len(self.shown)))
            notes += [f"{plural(without, 'sweep')} without a response: v shows curves"] if without else []
        else:
            more = [f"{plotted_curves.KINDS[of]} of {plural(count, 'sweep')}" for of, count in others.items()]
            notes = [f"{', '.join(more)}: g"] if more else []
            without = sum(not of.result.curves for of in self.shown)
            notes += [f"{plural(without, 'sweep')} without a curve"] if without else []
        return [*notes, *self.left_out]


def gather(store: Store, marked: Iterable[str]) -> Gathered:
    """Read the marked sweeps and their results."""
    found, gone = [], []
    for key in marked:
        try:
            found.append(store.find(key))
        except FraexpError:  # deleted since
            gone.append(key)
    notes = [f"{plural(len(gone), 'marked sweep')} not in the database any more"] if gone else []
    with_result = [sweep for sweep in found if sweep.outcome is not None]
    if len(found) > len(with_result):
        notes.append(f"{plural(len(found) - len(with_result), 'sweep')} without a result")
    if len(with_result) > MANY:
        notes.append(f"{len(with_result) - MANY} more than the {MANY} that can be told apart")
    sweeps = named_alike(store, with_result[:MANY])
    results = store.results(sweep.key for sweep in sweeps)
    return Gathered(tuple(sweep for sweep in sweeps if sweep.key in results), results, tuple(notes), tuple(gone))


def compared(workspace: Workspace, gathered: Gathered) -> ComparedSweeps:
    """Return sweeps side by side: named, with what they differ in, and the plant's own response where it is known."""
    sweeps, results = gathered.sweeps, gathered.results
    named = tuple(workspace.figures.shown(sweeps, results))
    references: dict[str, Reference] = {}
    for unit in dict.fromkeys(of.response.unit for of in named if of.response is not None):
        group = [s for s, of in zip(sweeps, named, strict=True) if of.response is not None and of.response.unit == unit]
        try:
            found = workspace.figures.reference(group, results)
        except FraexpError:  # a plugin that is no longer there: what is stored can be shown without it
            found = None
        references |= {unit: found} if found is not None else {}
    return ComparedSweeps(sweeps, named, references, rows_that_differ(sweeps, results), gathered.left_out)


def compare_command(workspace: Workspace, keys: Sequence[str]) -> str:
    """Return the command line that prints in what sweeps differ."""
    return shlex.join(["fraexp", "compare", *map(short, keys), *_place(workspace)])


def plot_command(workspace: Workspace, keys: Sequence[str], kind: str, file: str, view: View) -> str:
    """Return the command line that draws a figure of sweeps."""
    return shlex.join(["fraexp", *plot_arguments(keys, kind, file, view), *_place(workspace)])


def plot_arguments(keys: Sequence[str], kind: str, file: str, view: View) -> list[str]:
    """Return the arguments that draw a figure of sweeps, or what is seen of it."""
    return ["plot", *map(short, keys), "--kind", kind, *view.options(), "-o", file]


def _place(workspace: Workspace) -> list[str]:
    """Return the options that name workspace and database, where they are not those of the current folder."""
    here = workspace.folder.resolve() == Path.cwd()
    usual = workspace.database == str(workspace.folder / "results.db")
    folder = [] if here else [f"--workspace={workspace.folder}"]
    return folder + ([] if usual else [f"--db={shown(workspace.database)}"])


def _nothing(shown: ShownResult) -> ShownResult:
    """Return a place without anything to draw."""
    return replace(shown, result=replace(shown.result, response=None, curves=()))
