"""What a report says: published numbers beside ours, the sweeps of a run, its inputs, methods and verdict."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from fraexp.components.registry import Registry
from fraexp.data.results import Outcome
from fraexp.data.texts import printable
from fraexp.data.units import with_powers
from fraexp.reports.published_comparisons import verdict
from fraexp.store import RunSummary, StoredSweep
from fraexp.study.published_values import PublishedComparison, number_text, round_to_width
from fraexp.views.comparison import declared_unit
from fraexp.views.text_tables import TextTable
from fraexp.views.words import flatten, value_text

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
    note: str = ""


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
    titles = [of for of in rows[0] if of not in omitted and any(row[of].text for row in rows)]
    return ReportTable(titles, [[row[title] for title in titles] for row in rows])


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
        return Cell(one.outcome.words, is_bold=True, is_bad=True)
    reservation = "" if one.outcome is Outcome.OK else f" ({one.outcome.words})"
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


def report_table(table: TextTable) -> ReportTable:
    """Return a table of texts, upright if it has few rows."""
    titles, *body = table.columns, *table.rows
    if len(table.rows) <= MAX_UPRIGHT_SWEEPS and len(table.columns) > len(table.rows):
        titles, *body = (list(column) for column in zip(titles, *body, strict=True))
    return ReportTable(titles, [[Cell(text) for text in row] for row in body], table.title)


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
    parts += [f"{count} {outcome.words}" for outcome, count in outcomes.items()]
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
    every = [flatten({kind: sweep.experiment.get(kind) for kind in KINDS}) for sweep in sweeps]
    rows = []
    for path, value in every[0].items() if every else ():
        is_shown = value not in (None, [], "", {}) and not path.endswith(".version")
        if is_shown and all(of.get(path) == value for of in every):
            unit = declared_unit(sweeps[0], path, registry)
            rows.append([Cell(path), Cell(value_text(value)), Cell("" if unit == "1" else unit)])
    return ReportTable(["input", "value", "unit"], rows) if rows else None
