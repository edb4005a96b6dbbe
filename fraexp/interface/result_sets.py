"""Results of several sweeps: of a run, or of a search in the database."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, SupportsIndex, overload

from fraexp.data.figure_kinds import check_kind
from fraexp.data.results import Result
from fraexp.errors import ParameterError, StudyError
from fraexp.figures.elements.labels import drawn_labels, label_columns
from fraexp.interface.argument_checks import frequency_view, require_text
from fraexp.interface.datasets import import_optional, label_values, place_drawn_values, stack_datasets
from fraexp.interface.html import page_part
from fraexp.interface.sweep_results import SweepResult
from fraexp.store import RunSummary, StoredSweep, mark_damaged
from fraexp.study.paths import label_units
from fraexp.views.text_tables import TextTable, sweep_table
from fraexp.views.words import plural, value_text

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.figure import Figure

    from fraexp.workspace.workspace_service import WorkspaceService

MAX_SHOWN_SWEEPS = 20
"""Rows of a notebook's table."""
MAX_SHOWN_VALUES = 6
"""Values of a label in a message."""
RESERVED_NAMES = frozenset({"frequency", "part", "other_part", "harmonic", "key", "outcome", "input", "output"})
"""Names that a dataset has already: a label of this name keeps its whole path."""


class Results(Sequence[SweepResult]):
    """Results of sweeps in their order; those without a result, such as failed ones, are in `missing`.

    As any sequence it is true if it has an item: one without a single result is false, whatever is missing.
    """

    def __init__(self, sweeps: Sequence[StoredSweep], service: "WorkspaceService", title: str = "") -> None:
        self._sweeps, self._service, self.title = list(sweeps), service, title

    @cached_property
    def _found(self) -> dict[str, Result]:
        """Results by sweep key: read when they are first needed."""
        if not self._sweeps:
            return {}
        with self._service.open_store() as store:
            return store.results(sweep.key for sweep in self._sweeps)

    @cached_property
    def _items(self) -> list[SweepResult]:
        marked = mark_damaged(self._sweeps, self._found)
        return [SweepResult(of, self._found[of.key], self._service) for of in marked if of.key in self._found]

    @property
    def missing(self) -> dict[str, str]:
        """Sweeps without a result: why, by key."""
        return {of.key[4:12]: of.message or of.state for of in self._sweeps if of.key not in self._found}

    def __len__(self) -> int:
        return len(self._items)

    @overload
    def __getitem__(self, index: int) -> SweepResult: ...

    @overload
    def __getitem__(self, index: slice) -> "Results": ...

    def __getitem__(self, index: int | slice) -> "SweepResult | Results":
        if isinstance(index, slice):
            return Results([of.sweep for of in self._items[index]], self._service, self.title)
        if not isinstance(index, SupportsIndex):
            raise ParameterError(
                f"results: the index is {index!r:.60}; expected a number or a slice, such as [0]; "
                'one("estimator=conventional") finds a result by what it is'
            )
        try:
            return self._items[index]
        except IndexError:
            reason = next((f"; of the others: {text}" for text in self.missing.values()), "")
            raise IndexError(
                f"there is no result {index}: {plural(len(self), 'result')} of {self._heading()}{reason}"
            ) from None

    def __iter__(self) -> Iterator[SweepResult]:
        return iter(self._items)

    def filter(self, text: str = "") -> "Results":
        """Return the results that match a filter, in the language of ``fraexp list``.

        For example ``estimator=effective_input excitation.amplitude>=12``. FraexpError if it is invalid.
        """
        require_text(text, "filter")
        with self._service.open_store() as store:
            known = set(store.keys(text))
        return Results([of for of in self._sweeps if of.key in known], self._service, self.title)

    def one(self, text: str = "") -> SweepResult:
        """Return the only result that matches a filter; StudyError if there is none, or several."""
        found = self.filter(text) if text else self
        if len(found) != 1:
            where = f" match '{text}'" if text else ""
            raise StudyError(
                f"{plural(len(found), 'result')}{where}; expected one of {len(self)}: {self._labels_text()}"
            )
        return found[0]

    def _labels_text(self) -> str:
        """Return the values of all labels, by the names that a filter knows."""
        paths = dict.fromkeys(path for of in self for path in of.labels)
        values = {path: label_values([of.labels.get(path) for of in self]) for path in paths}
        shown = {path: list(dict.fromkeys(map(value_text, of)))[:MAX_SHOWN_VALUES] for path, of in values.items()}
        return "; ".join(f"{path}={' or '.join(of)}" for path, of in shown.items()) or "no labels"

    def _axes(self, results: Sequence[SweepResult]) -> dict[str, list[Any]]:
        """Return the values of each label, by its short name: the end of its path, as in tables."""
        columns = label_columns([of.labels for of in results])
        return {
            (path if name in RESERVED_NAMES else name): label_values([of.labels.get(path) for of in results])
            for path, name in columns.items()
        }

    def to_xarray(self) -> "xarray.Dataset":
        """Return all responses as one dataset: a dimension for each label of the grid, and ``frequency``.

        Random draws have the dimension ``draw``, along which the drawn values are coordinates. The dimension is
        ``sweep`` if the sweeps are no full grid. Points that a sweep lacks are NaN. Key, outcome and message of each
        sweep are variables, and labels have their unit in the attribute ``units``.
        """
        usable = [of for of in self if of.result.response is not None]
        axes = self._axes(usable)
        drawn = {name: axes.pop(name) for name in self._drawn_names(usable)}
        own = {
            of.key: {"key": of.key, "outcome": of.outcome, "message": of.message}
            | {name: values[number] for name, values in drawn.items()}
            for number, of in enumerate(usable)
        }
        datasets = [of.to_xarray().assign(own[of.key]) for of in usable]
        for dataset in datasets:
            dataset.attrs = {
                name: value for name, value in dataset.attrs.items() if name not in own[dataset.key.item()]
            }
        whole = place_drawn_values(stack_datasets(datasets, axes, self._attributes()), list(drawn))
        units = self._label_units(usable)
        for path, name in label_columns([of.labels for of in usable]).items():
            if name in whole.coords:
                whole[name].attrs |= {"path": path} | ({"units": units[path]} if path in units else {})
        return whole

    def _drawn_names(self, results: Sequence[SweepResult]) -> list[str]:
        """Return the short names of the labels that were drawn at random: those behind the number of the draw."""
        columns = label_columns([of.labels for of in results])
        return [columns[path] for path in columns if any(path in drawn_labels(of.labels) for of in results)]

    def _label_units(self, results: Sequence[SweepResult]) -> dict[str, str]:
        pairs = ((of.labels, of.sweep.sections) for of in results)
        return label_units(pairs, self._service.registry)

    def _attributes(self) -> dict[str, Any]:
        return {"title": self.title}

    def to_pandas(self) -> "pandas.DataFrame":
        """Return all responses as one long table: a row for each sweep and frequency, labels and key as columns.

        Results without a response have a row for each sweep, with their metrics.
        """
        pandas = import_optional("pandas", "to_pandas()")
        axes = self._axes(self)
        tables = []
        for number, of in enumerate(self):
            named = {"key": of.key, **{name: values[number] for name, values in axes.items()}}
            named |= {"outcome": of.outcome, "message": of.message}
            if of.result.response is not None:
                table = of.to_pandas().reset_index()
                table.attrs = {}  # each has its own
            else:
                table = pandas.DataFrame([of.metrics])
            for column, (name, value) in enumerate(named.items()):
                table.insert(column, name, value, allow_duplicates=False)
            tables.append(table)
        return pandas.concat(tables, ignore_index=True) if tables else pandas.DataFrame()

    def plot(
        self,
        kind: str = "",
        frequency_range: tuple[float, float] | None = None,
        group_by: Sequence[str] | str | None = None,
    ) -> "Figure":
        """Return a matplotlib figure of all results; `kind` and `frequency_range` [Hz] as for a single one.

        `group_by` are the labels that separate the colours, such as ``["estimator"]``; by default all do.
        """
        sweeps = [of.sweep for of in self if of.is_usable]
        check_kind(kind, "plot: kind")
        view = frequency_view(frequency_range)
        labels = [group_by] if isinstance(group_by, str) else group_by
        return self._service.figures.figure(sweeps, self._found, self.title, kind, view, labels)

    def _table(self) -> TextTable:
        return sweep_table(self._sweeps[:MAX_SHOWN_SWEEPS], self._found, self._service.registry)

    def _heading(self) -> str:
        return plural(len(self._sweeps), "sweep")

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self._heading()}>"

    def _repr_html_(self) -> str:
        table, rest = self._table(), len(self._sweeps) - MAX_SHOWN_SWEEPS
        notes = [
            *([self.title] if self.title else []),
            *([f"{plural(rest, 'more sweep')} not shown"] if rest > 0 else []),
        ]
        drawable = any(of.is_usable and (of.result.response or of.result.curves) for of in self)
        figure = self.plot() if drawable else None
        return page_part(self._heading(), notes, figure, table.columns, table.rows)


class Run(Results):
    """An execution of a study: its results and what is known of it."""

    def __init__(
        self, summary: RunSummary, sweeps: Sequence[StoredSweep], service: "WorkspaceService", title: str = ""
    ) -> None:
        super().__init__(sweeps, service, title or summary.study)
        self.summary = summary
        self.figures: tuple[Path, ...] = ()
        """Files of the figures that the run has drawn."""

    @property
    def number(self) -> int:
        """Number of the run, as `fraexp show` takes it."""
        return self.summary.number

    @property
    def study(self) -> str:
        """Name of the study."""
        return self.summary.study

    @property
    def state(self) -> str:
        """``complete``, ``partial``, ``interrupted`` or ``running``."""
        return self.summary.state

    @property
    def provenance(self) -> dict[str, Any]:
        """Code version, packages and machine, as plain data."""
        return dict(self.summary.provenance)

    def _attributes(self) -> dict[str, Any]:
        return {"title": self.title, "study": self.study, "run": self.number, "provenance": self.provenance}

    def _heading(self) -> str:
        counts = f"{self.summary.computed} computed, {self.summary.reused} reused, {self.summary.failed} failed"
        return f"run {self.number} of {self.study} {self.state}: {plural(len(self._sweeps), 'sweep')}, {counts}"


@dataclass(frozen=True)
class Identification:
    """What records of one machine tell: a run, whose last result has all of them, and the answers that follow."""

    run: Run
    answers: tuple[tuple[str, str], ...]
    """What is asked of the axis, and what the records answer, as ``fraexp identify`` prints it."""

    @property
    def models(self) -> dict[str, Mapping[str, Any]]:
        """Identified plant and friction, by kind, as a study takes them."""
        return self.run[-1].models

    def __repr__(self) -> str:
        return "\n".join(f"{question}: {answer}" for question, answer in self.answers)
