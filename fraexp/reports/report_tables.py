"""What a report says: published numbers beside ours, the sweeps of a run, its inputs, methods and verdict."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import nan
from typing import NamedTuple

from fraexp.components.registry import Registry
from fraexp.data.results import Outcome, Result
from fraexp.data.terminal_text import printable
from fraexp.data.units import factor, with_powers
from fraexp.errors import FraexpError
from fraexp.figures.elements.labels import label_columns, label_texts
from fraexp.reports.published_comparisons import verdict
from fraexp.store import RunSummary, StoredSweep
from fraexp.study.published_values import (
    HALF_WIDTH_ENDING,
    PublishedComparison,
    half_widths,
    number_text,
    readable_unit,
    round_to_width,
)

MAX_UPRIGHT_SWEEPS = 6
"""Up to so many sweeps are columns of the table, with a row for each number."""
MIN_SHARE = 0.001
"""Differences from this share of the published number on [%] are given as a share, too."""
LONG_CELL = 28
"""Characters above which a cell is broken into lines."""


@dataclass(frozen=True)
class Cell:
    """A cell of a table."""

    text: str
    href: str = ""
    """Target of a link; empty for plain text."""
    is_bold: bool = False
    is_bad: bool = False
    """Whether it is a finding that the reader should not overlook."""
    detail: str = ""
    """A remark below the text."""
    may_wrap: bool = False
    """Whether a short text, too, may be broken into lines."""

    @property
    def is_long(self) -> bool:
        """Whether the text is broken into lines."""
        return len(self.text) > LONG_CELL and not self.href


@dataclass(frozen=True)
class ReportTable:
    """A table of a report."""

    titles: Sequence[str]
    rows: Sequence[Sequence[Cell]]


@dataclass(frozen=True)
class OriginTable:
    """The published numbers of one origin."""

    origin: str
    meaning: str
    """What an agreement shows."""
    table: ReportTable


def published_table(
    compared: Sequence[PublishedComparison], studies: Sequence[Cell] = (), omitted: Sequence[str] = ()
) -> ReportTable | None:
    """Return the table of published numbers without the `omitted` columns, or None if there are none.

    `studies` are links to the study of each, for a table that is not in its study's chapter.
    """
    if not compared:
        return None
    rows = [_published_row(one, studies[at : at + 1]) for at, one in enumerate(compared)]
    titles = [title for title in _used_titles(rows) if title not in omitted]
    return ReportTable(titles, [[row[title] for title in titles] for row in rows])


def _used_titles(rows: Sequence[Mapping[str, Cell]]) -> list[str]:
    """Return the titles of the columns that are not empty."""
    return [title for title in rows[0] if any(row[title].text for row in rows)]


def _published_row(one: PublishedComparison, study: Sequence[Cell]) -> dict[str, Cell]:
    """Return the cells of a published number by the titles of their columns."""
    of = one.published
    link = study[0] if study else Cell("")
    row = {"number": Cell(of.what, detail=of.note), "source": Cell(of.source, may_wrap=True), "study": link}
    row["origin"] = Cell(of.origin)
    row |= {"unit": Cell(unit_text(of.unit)), "published": Cell(of.bound_text)}
    row |= {"ours": Cell(_ours(one)), "difference": Cell(_difference(one)), "expected": Cell(_expectation(one))}
    return row | {"met": _met(one)}


def _ours(one: PublishedComparison) -> str:
    return "–" if one.remark else number_text(one.ours, one.half, one.published.margin)


def _met(one: PublishedComparison) -> Cell:
    """Return whether a number is met; if the sweep has a reservation, its outcome."""
    if one.remark:
        return Cell(one.remark, is_bold=True, is_bad=True)
    if one.has_reservation:
        return Cell(outcome_text(one.outcome), is_bold=True, is_bad=True)
    reservation = "" if one.outcome is Outcome.OK else f" ({outcome_text(one.outcome)})"
    return Cell(("yes" if one.agrees else "no") + reservation, is_bold=True, is_bad=not one.agrees)


def _difference(one: PublishedComparison) -> str:
    """Return the difference with the digits of what is expected, and its share of the number; none from a bound."""
    of = one.published
    if one.remark or of.is_bound:
        return ""
    share = 100 * one.difference / of.value if of.value else 0.0
    difference = round_to_width(one.difference, of.margin / 10)
    signed = difference if difference.startswith("-") else f"+{difference}"
    return signed + (f" ({share:+.2g} %)" if abs(share) >= MIN_SHARE else "")


def _expectation(one: PublishedComparison) -> str:
    of = one.published
    if of.is_bound:
        return f"{of.compare} {'±' if of.compare == 'within' else ''}{of.value:g}"
    return f"± {of.tolerance if isinstance(of.tolerance, str) else f'{of.margin:g}'}"


def sweep_table(
    sweeps: Sequence[StoredSweep],
    results: Mapping[str, Result],
    label_units: Mapping[str, str],
    metric_units: Mapping[str, str],
) -> ReportTable | None:
    """Return the table of sweeps: labels, outcome, settled lines, metrics and message; None if there are no sweeps.

    `label_units` are by the path of the label; `metric_units` are those in which a study gives a metric, by its name.
    """
    if not sweeps:
        return None
    found = [results.get(sweep.key) for sweep in sweeps]
    columns: dict[str, list[str]] = {}
    for path, name in label_columns([sweep.labels for sweep in sweeps]).items():
        values = [sweep.labels.get(path) for sweep in sweeps]
        title, texts = _label_column(name, label_units.get(path, ""), values)
        columns[title] = texts
    columns["outcome"] = [_outcome(sweep) for sweep in sweeps]
    columns["settled"] = [_settled_text(result) for result in found]
    columns |= _metric_columns(found, metric_units)
    columns["message"] = [sweep.message for sweep in sweeps]
    rows = [[title, *texts] for title, texts in columns.items() if any(texts)]
    is_upright = len(sweeps) <= MAX_UPRIGHT_SWEEPS and len(rows) > len(sweeps)
    titles, *body = rows if is_upright else [list(row) for row in zip(*rows, strict=True)]
    return ReportTable(titles, [[Cell(text) for text in row] for row in body])


def _outcome(sweep: StoredSweep) -> str:
    return outcome_text(sweep.outcome) if sweep.outcome else sweep.state


def outcome_text(outcome: Outcome) -> str:
    """Return an outcome as people write it: ``not settled``."""
    return outcome.name.lower().replace("_", " ")


def _label_column(name: str, unit: str, values: Sequence[object]) -> tuple[str, list[str]]:
    """Return title and texts of a column of labels."""
    numbers = [value for value in values if isinstance(value, int | float) and not isinstance(value, bool)]
    if len(numbers) < len(values):
        return _title(name, unit), label_texts(values)
    scale, shown = readable_unit(unit, numbers)
    scaled = [float(f"{scale * value:.12g}") if scale != 1 else value for value in numbers]
    return _title(name, shown), label_texts(scaled)


def _metric_columns(results: Sequence[Result | None], stated: Mapping[str, str]) -> dict[str, list[str]]:
    """Return the texts of each metric by its title, in the unit that is stated for it, or in a readable one."""
    found = [
        {(metric.name, metric.unit): metric.value for metric in result.metrics} if result else {} for result in results
    ]
    halves = [half_widths(result) if result else {} for result in results]
    columns = {}
    for name, unit in dict.fromkeys(key for values in found for key in values):
        if name.endswith(HALF_WIDTH_ENDING) and any(name.removesuffix(HALF_WIDTH_ENDING) in half for half in halves):
            continue  # it stands behind its number
        column = [values.get((name, unit)) for values in found]
        scale, shown = _scale(unit, stated.get(name), [value for value in column if value is not None])
        columns[_title(name, shown)] = [
            "" if value is None else number_text(scale * value, scale * half.get(name, nan))
            for value, half in zip(column, halves, strict=True)
        ]
    return columns


def _scale(unit: str, stated: str | None, values: Sequence[float]) -> tuple[float, str]:
    """Return the factor to the unit of a column, and that unit."""
    try:
        return (factor(unit, stated), stated) if stated else readable_unit(unit, values)
    except FraexpError:  # the table of published numbers reports it
        return readable_unit(unit, values)


def _settled_text(result: Result | None) -> str:
    response = result.response if result else None
    return f"{int(response.settled.sum())}/{len(response.settled)}" if response is not None else ""


def _title(name: str, unit: str) -> str:
    return f"{name} [{unit_text(unit)}]" if unit_text(unit) else name


def unit_text(unit: str) -> str:
    """Return a unit as people write it; empty for a pure number."""
    shown = with_powers(unit)
    return "" if unit == "1" else f"µ{shown[1:]}" if shown.startswith("u") and len(shown) > 1 else shown


KINDS = ("plant", "friction", "controller", "excitation", "compensation", "loop", "record")
"""Sections of an experiment, in the order in which a report lists them."""


class Method(NamedTuple):
    """A component as a report describes it."""

    kind: str
    name: str
    paragraphs: tuple[str, ...]
    """What it does, with its reference in the literature; code is between backticks."""


def verdict_text(run: RunSummary, sweeps: Sequence[StoredSweep], compared: Sequence[PublishedComparison]) -> str:
    """Return in words what a run has shown: which sweeps can be used, and which published numbers are met."""
    outcomes = Counter(of.outcome for of in sweeps if of.outcome)
    sound = outcomes.pop(Outcome.OK, 0)
    parts = [_sound_text(sound, len(sweeps))]
    parts += [f"{count} {outcome_text(outcome)}" for outcome, count in outcomes.items()]
    without = len(sweeps) - sound - sum(outcomes.values())
    parts += [f"{without} without a result"] if without else []
    text = ", ".join(parts) + "."
    told = verdict(compared)
    missed = [one.published.what for one in compared if not one.is_met]
    text += f" {told}." if told else ""
    text += f" Not met: {'; '.join(missed)}." if missed else ""
    return text if run.state == "complete" else f"The run is {run.state}. {text}"


def _sound_text(sound: int, count: int) -> str:
    if count == 1:
        return "The sweep is sound" if sound else "The sweep is not sound"
    return f"All {count} sweeps are sound" if sound == count else f"{sound} of {count} sweeps are sound"


def describe_methods(sweeps: Sequence[StoredSweep], registry: Registry) -> list[Method]:
    """Return the estimators of sweeps, each once, with the description that its plugin gives."""
    found: dict[tuple[str, str], Method] = {}
    for sweep in sweeps:
        for provider in registry.used_providers("estimator", sweep.estimator):
            component = provider.component
            words = component.name.replace("_", " ")
            found[component.kind, component.name] = Method(
                component.kind, words, tuple(map(printable, provider.paragraphs))
            )
    return [method for key, method in found.items() if key[0] == "estimator" and method.paragraphs]


def input_table(sweeps: Sequence[StoredSweep], registry: Registry) -> ReportTable | None:
    """Return what all sweeps share of their experiment, a row for each number or text; None if there is nothing."""
    from fraexp.study.paths import unit_at

    rows = []
    for kind in KINDS:
        shared = _shared_inputs(kind, [sweep.experiment for sweep in sweeps])
        for path, value in shared.items():
            try:
                unit = unit_at(sweeps[0].experiment, path, registry)
            except FraexpError:
                unit = ""
            rows.append([Cell(path), Cell(_value_text(value)), Cell("" if unit == "1" else unit)])
    return ReportTable(["input", "value", "unit"], rows) if rows else None


def _shared_inputs(kind: str, experiments: Sequence[Mapping[str, object]]) -> dict[str, object]:
    every = [dict(_leaves(of.get(kind), kind)) for of in experiments]
    first = every[0] if every else {}
    return {
        path: value
        for path, value in first.items()
        if _is_shown(path, value) and all(of.get(path) == value for of in every)
    }


def _is_shown(path: str, value: object) -> bool:
    return value not in (None, [], "", {}) and not path.endswith(".version")


def _leaves(value: object, path: str) -> list[tuple[str, object]]:
    if isinstance(value, Mapping):
        return [leaf for key, item in value.items() for leaf in _leaves(item, f"{path}.{key}")]
    return [(path, value)]


def _value_text(value: object) -> str:
    if isinstance(value, list):
        texts = [_value_text(item) for item in value]
        return ", ".join(texts if len(texts) <= 6 else [*texts[:2], "…", texts[-1]])
    return f"{value:.6g}" if isinstance(value, float) else str(value)
