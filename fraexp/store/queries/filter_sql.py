"""From what a filter says to SQL: one condition on a sweep, and on a run that saw it, for each term."""

import difflib
import json
import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any

from sqlalchemy import (
    ColumnElement,
    Connection,
    Text,
    and_,
    cast,
    exists,
    false,
    func,
    not_,
    or_,
    select,
)

from fraexp.data.identity import TAG
from fraexp.data.results import Outcome
from fraexp.errors import StoreError, did_you_mean
from fraexp.store.queries.filters import Condition
from fraexp.store.queries.json_sql import Kinds, at, compared, contains, number, number_at, span, text_at, unknown
from fraexp.store.tables import LATEST, PARTS, field, metric, note, part, run, run_sweep, sweep, tag

Columns = Mapping[str, ColumnElement[Any]]
STATES = ("pending", "computed", "reused", "failed")
FRUITLESS = (Outcome.FAILED.name, Outcome.DIVERGED.name, Outcome.NO_SIGNAL.name)
METRIC = "metric."
NAMES = ("estimator", "friction", "plant", "controller", "excitation")
FIELDS = ("key", "state", "outcome", *NAMES, "source", "study", "run", "tag", "note", "message", "elapsed", "created")
"""What every sweep can be found by."""

seen = run_sweep.alias("seen")
"""A sweep as one run saw it: the latest one, or the one that is asked for."""
KEY = sweep.c.key
COLUMNS: Columns = {
    "key": KEY,
    "state": func.coalesce(seen.c.state, "computed"),
    "outcome": sweep.c.outcome,
    **{name: sweep.c[f"{name}_name"] for name in NAMES},
    "source": sweep.c.source,
    "study": select(run.c.study).where(run.c.number == seen.c.run).scalar_subquery(),
    "run": seen.c.run,
    "note": select(note.c.text).where(note.c.key == KEY).scalar_subquery(),
    "message": func.coalesce(func.nullif(seen.c.message, ""), sweep.c.message),
    "elapsed": sweep.c.elapsed,
    "created": sweep.c.created,
}
"""What a listing can be sorted by, beside parameters and metrics."""


Declared = Callable[[str], Collection[str]]
SOME = 100
"""Values of a metric that are asked for their unit."""


def undeclared(name: str) -> Collection[str]:
    """Return no unit: that of a parameter is not known."""
    return ()


@dataclass(frozen=True)
class Names:
    """Names that something in the database has."""

    parameters: frozenset[str]
    labels: frozenset[str]
    metrics: frozenset[str]
    connection: Connection
    declared: Declared = undeclared
    """Tells the units in which a parameter is declared; none where that is not known."""

    @classmethod
    def of(cls, connection: Connection, declared: Declared = undeclared) -> "Names":
        """Read them."""
        found: dict[str, set[str]] = {"parameter": set(), "label": set(), "metric": set(), "word": set()}
        for kind, name in connection.execute(select(field.c.kind, field.c.name)):
            found[kind].add(name)
        parameters, labels, metrics = (frozenset(found[kind]) for kind in ("parameter", "label", "metric"))
        return cls(parameters, labels, metrics, connection, declared)

    def units(self, name: str) -> frozenset[str]:
        """Return the units that numbers of this name have; none where that is not known."""
        if not name.startswith(METRIC):
            return frozenset(self.declared(name))
        some = select(metric.c.unit).where(metric.c.name == name.removeprefix(METRIC)).limit(SOME).subquery()
        return frozenset(self.connection.scalars(select(some.c.unit).distinct()))

    def check_name(self, column: str, value: str) -> None:
        """Raise StoreError if no sweep has a component of this name, though some have others."""
        of = sweep.c[f"{column}_name"]
        if self.connection.scalar(select(of).where(of == value).limit(1)) is not None:
            return
        known = [str(name) for name in self.connection.scalars(select(of).where(of.is_not(None)).distinct())]
        if known:
            raise StoreError(f"filter: no sweep has the {column} '{value}'{did_you_mean(value, known)}")

    def all(self) -> list[str]:
        """Return everything that a filter may name."""
        metrics = {f"{METRIC}{name}" for name in self.metrics}
        return [*FIELDS, *sorted((self.parameters | self.labels | metrics) - set(FIELDS))]

    def unknown(self, name: str) -> StoreError:
        """Return what is said of a name that nothing has."""
        known = self.all()
        near = [other for other in known if other.endswith(f".{name}")]
        near = near or difflib.get_close_matches(name, known, n=1, cutoff=0.5)
        hint = f"did you mean '{near[0]}'?" if near else "expected one such as estimator, tag or excitation.amplitude"
        return StoreError(f"filter: nothing in the database has '{name}'; {hint}")


def place_of(path: str) -> tuple[str, list[str]]:
    """Return in which part of a sweep a parameter stands, and where in it."""
    head, *rest = path.split(".")
    return (head, rest) if head in PARTS and head != "rest" and rest else ("rest", [head, *rest])


def holds(condition: Condition, names: Names, now: datetime, number: int | None = None) -> ColumnElement[bool]:
    """Return the SQL of a condition on sweeps, as a run or the latest one saw them; StoreError if it has no sense."""
    positive = _positive(condition, names, now, number)
    return not_(func.coalesce(positive, false())) if condition.negated else positive


def _positive(condition: Condition, names: Names, now: datetime, number: int | None) -> ColumnElement[bool]:
    name = condition.field
    if not name:
        return _anywhere(condition.value, number)
    if name == "created":
        return _at_time(condition, now)
    if name == "state":
        return _state(condition, number)
    if name in NAMES and condition.operator == "=":
        names.check_name(name, condition.value)
    if name in COLUMNS or name in SPECIAL:
        return SPECIAL[name](condition) if name in SPECIAL else _text(condition, COLUMNS[name])
    return _of_its_own(condition, names)


def _of_its_own(condition: Condition, names: Names) -> ColumnElement[bool]:
    """Return the SQL of a condition on what only some sweeps have: a metric, a parameter, a label."""
    name = condition.field
    if name.startswith(METRIC) and name.removeprefix(METRIC) in names.metrics:
        value = _number_of(condition, lambda: names.units(name))
        chosen = (metric.c.name == name.removeprefix(METRIC), compared(metric.c.value, condition.operator, value))
        return exists().where(metric.c.key == KEY, *chosen)
    if name in names.parameters:
        section, place = place_of(name)
        fits = _value(condition, part.c.content, place, lambda: names.units(name))
        fitting = select(part.c.number).where(part.c.section == section, fits).cte().prefix_with("MATERIALIZED")
        return sweep.c[f"{section}_part"].in_(select(fitting.c.number))  # asked once, and each part looked into once
    if name in names.labels:
        return _value(condition, seen.c.labels, [name])
    raise names.unknown(name)


def _value(
    condition: Condition, column: ColumnElement[Any], place: list[str], kinds: Kinds = unknown
) -> ColumnElement[bool]:
    """Return a comparison with what is at a place in JSON: with a number, with a text, or with either."""
    if condition.operator not in "=:":
        return compared(at(number_at, column, place), condition.operator, _number_of(condition, kinds))
    text = _text(condition, at(text_at, column, place))
    value = _told(condition, kinds)
    return text if value is None else or_(text, compared(at(number_at, column, place), "=", value))


def _text(condition: Condition, column: ColumnElement[Any]) -> ColumnElement[bool]:
    if condition.operator == "=":
        return column == condition.value
    if condition.operator == ":":
        return contains(column, condition.value)
    raise StoreError(f"filter: '{condition.term}' compares a text; expected {condition.field}= or {condition.field}:")


def _told(condition: Condition, kinds: Kinds) -> float | None:
    try:
        return number(condition.value, kinds)
    except StoreError as error:
        raise StoreError(f"filter: '{condition.term}': {error}") from None


def _number_of(condition: Condition, kinds: Kinds = unknown) -> float:
    value = _told(condition, kinds)
    if value is None:
        raise StoreError(
            f"filter: '{condition.term}': '{condition.value}' is no number; expected one such as 12, 1e-6 or 0.1um"
        )
    return value


def _equal(condition: Condition) -> None:
    if condition.operator not in "=:":
        raise StoreError(f"filter: '{condition.term}' is no comparison; expected {condition.field}:{condition.value}")


def _key(condition: Condition) -> ColumnElement[bool]:
    _equal(condition)
    return _key_begins(condition.value)


def _key_begins(text: str) -> ColumnElement[bool]:
    head = text.lower()
    if set(head.removeprefix(f"{TAG}-"[: len(head)])) - set("0123456789abcdef"):
        return false()
    return or_(KEY.startswith(head, autoescape=True), KEY.startswith(f"{TAG}-{head}", autoescape=True))


def _state(condition: Condition, number: int | None) -> ColumnElement[bool]:
    _equal(condition)
    word = condition.value.lower()
    if word == "failed":  # an attempt that broke off, or one that taught nothing
        return or_(_seen_with(number, run_sweep.c.state == word), sweep.c.outcome.in_(FRUITLESS))
    if word == "computed":  # as is what no run has any more
        return not_(_seen_with(number, run_sweep.c.state != word))
    return _seen_with(number, run_sweep.c.state == word) if word in STATES else _with_outcome(condition, STATES)


def _seen_with(number: int | None, *conditions: ColumnElement[bool]) -> ColumnElement[bool]:
    """Return whether the run `number`, or the latest one, saw a sweep so: asked once for all sweeps, which is fast."""
    of_run = run_sweep.c.standing == LATEST if number is None else run_sweep.c.run == number
    return KEY.in_(select(run_sweep.c.key).where(of_run, *conditions))


def _outcome(condition: Condition) -> ColumnElement[bool]:
    _equal(condition)
    return _with_outcome(condition, ())


def _with_outcome(condition: Condition, others: tuple[str, ...]) -> ColumnElement[bool]:
    word = condition.value.upper().replace(" ", "_").replace("-", "_")
    if word not in Outcome.__members__:
        known = [*others, *(name.lower() for name in Outcome.__members__)]
        raise StoreError(
            f"filter: there is no {condition.field} '{condition.value}'{did_you_mean(word.lower(), known)}"
        )
    return sweep.c.outcome == word


def _tag(condition: Condition) -> ColumnElement[bool]:
    _equal(condition)
    return KEY.in_(select(tag.c.key).where(tag.c.name == condition.value))


def _note(condition: Condition) -> ColumnElement[bool]:
    return KEY.in_(select(note.c.key).where(_text(condition, note.c.text)))


def _study(condition: Condition) -> ColumnElement[bool]:
    runs = select(run.c.number).where(_text(condition, run.c.study))
    return exists().where(run_sweep.c.key == KEY, run_sweep.c.run.in_(runs))


def _run(condition: Condition) -> ColumnElement[bool]:
    chosen = compared(run_sweep.c.run, condition.operator, _number_of(condition, lambda: ("1",)))
    return exists().where(run_sweep.c.key == KEY, chosen)


def _elapsed(condition: Condition) -> ColumnElement[bool]:
    minutes = re.sub(r"(?<=[\d.\s])m$", "min", condition.value)  # of how long it took m can be nothing else
    value = _number_of(replace(condition, value=minutes), lambda: ("s",))
    elapsed = compared(sweep.c.elapsed, condition.operator, value)
    return and_(sweep.c.outcome.is_not(None), elapsed)


def _at_time(condition: Condition, now: datetime) -> ColumnElement[bool]:
    created = sweep.c.created
    begin, end = span(condition.value, now)
    match condition.operator:
        case ">":
            return created >= end
        case ">=":
            return created >= begin
        case "<":
            return created < begin
        case "<=":
            return created < end
    return and_(created >= begin, created < end)


def _anywhere(word: str, number: int | None) -> ColumnElement[bool]:
    """Return where a word is found: labels, names of components, study, message, tags, beginning of the key."""
    words = select(field.c.name).where(field.c.kind == "word", contains(field.c.name, word))
    runs = select(run.c.number).where(contains(run.c.study, word))
    written = contains(cast(run_sweep.c.labels, Text), json.dumps(word)[1:-1])  # as it stands in the labels' JSON
    told = contains(run_sweep.c.message, word)
    return or_(
        *(func.coalesce(sweep.c[f"{name}_name"].in_(words), false()) for name in NAMES),
        _seen_with(number, or_(run_sweep.c.run.in_(runs), written, told)),
        and_(contains(sweep.c.message, word), not_(_seen_with(number, run_sweep.c.message != ""))),
        KEY.in_(select(tag.c.key).where(contains(tag.c.name, word))),
        _key_begins(word),
    )


SPECIAL: dict[str, Callable[[Condition], ColumnElement[bool]]] = {
    "key": _key,
    "outcome": _outcome,
    "tag": _tag,
    "note": _note,
    "study": _study,
    "run": _run,
    "elapsed": _elapsed,
}
