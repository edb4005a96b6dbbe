"""SQL of a filter: for each term a condition on a sweep and on the run that contains it."""

import json
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from datetime import datetime

from sqlalchemy import ColumnElement, Float, Text, and_, cast, exists, false, func, literal, not_, or_, select

from fraexp.data.identity import key_heads
from fraexp.data.results import UNUSABLE_OUTCOMES, Outcome
from fraexp.data.rotary_axes import rotary_unit
from fraexp.errors import FilterError, did_you_mean
from fraexp.store.queries.filters import (
    Condition,
    UnitLookup,
    is_of_a_kind,
    no_units,
    parse_number,
    parse_time_span,
    unit_in,
)
from fraexp.store.queries.json_sql import JsonSql
from fraexp.store.queries.known_names import COMPONENT_COLUMNS, METRIC_PREFIX, KnownNames
from fraexp.store.tables import PARTS, STANDING_LATEST, Expression, field, metric, part, run, run_sweep, sweep, tag

Columns = Mapping[str, Expression]
STATES = ("pending", "computed", "reused", "failed")
RELATIVE_TOLERANCE = 1e-9
"""Relative difference up to which numbers are equal: 0.1 um is not exactly 1e-7."""
UNUSABLE = "unusable"
"""Word for failed attempts and unusable results alike."""
findings_text = cast(sweep.c.findings, Text)
"""JSON of a result's findings: a search finds their kinds and their texts."""
run_view = run_sweep.alias("run_view")
"""A sweep in one run: the latest one, or the requested one."""
SWEEP_KEY = sweep.c.key
SWEEP_COLUMNS: Columns = {
    "key": SWEEP_KEY,
    "state": func.coalesce(run_view.c.state, "computed"),
    "outcome": sweep.c.outcome,
    **{name: sweep.c[f"{name}_name"] for name in COMPONENT_COLUMNS},
    "source": sweep.c.source,
    "study": select(run.c.study).where(run.c.number == run_view.c.run).scalar_subquery(),
    "run": run_view.c.run,
    "message": func.coalesce(func.nullif(run_view.c.message, ""), func.nullif(findings_text, "[]"), ""),
    "elapsed": sweep.c.elapsed,
    "created": sweep.c.created,
}
"""Columns by which a listing can be sorted, beside parameters and metrics."""


def split_parameter(path: str) -> tuple[str, list[str]]:
    """Return the part of a sweep that contains a parameter, and the keys within it."""
    head, *rest = path.split(".")
    return (head, rest) if head in PARTS and head != "rest" and rest else ("rest", [head, *rest])


def condition_sql(
    condition: Condition, names: KnownNames, now: datetime, number: int | None = None
) -> ColumnElement[bool]:
    """Return the SQL of a condition on sweeps in a run, or in their latest one; FilterError if it is invalid."""
    positive = _positive_sql(condition, names, now, number)
    return not_(func.coalesce(positive, false())) if condition.negated else positive


def _positive_sql(condition: Condition, names: KnownNames, now: datetime, number: int | None) -> ColumnElement[bool]:
    if not condition.field:
        names.check_word(condition.value)
        return _anywhere_sql(condition.value, number)
    name = names.full_name(condition.field)
    condition = replace(condition, field=name)
    if name == "created":
        return _created_sql(condition, now)
    if name == "state":
        return _state_sql(condition, number)
    if name in COMPONENT_COLUMNS and condition.operator == "=":
        names.check_name(name, condition.value)
    if name in SWEEP_COLUMNS or name in FIELD_SQL:
        return FIELD_SQL[name](condition) if name in FIELD_SQL else _text_sql(condition, SWEEP_COLUMNS[name])
    return _named_value_sql(condition, names)


def _named_value_sql(condition: Condition, names: KnownNames) -> ColumnElement[bool]:
    """Return the SQL of a condition on a metric, a parameter or a label, which only some sweeps have."""
    name = condition.field
    if name.startswith(METRIC_PREFIX) and name.removeprefix(METRIC_PREFIX) in names.metrics:
        value = _required_number(condition, lambda: names.units(name))
        chosen = (
            metric.c.name == name.removeprefix(METRIC_PREFIX),
            _compare_number(metric.c.value, condition.operator, value),
        )
        return exists().where(metric.c.key == SWEEP_KEY, *chosen)
    if name in names.parameters:
        section, place = split_parameter(name)
        if _parsed_number(condition, no_units) is None and names.has_only_numbers(section, place):
            raise _no_number_error(condition)
        fits = _json_value_sql(condition, names.json, part.c.content, place, lambda: names.units(name))
        fitting = select(part.c.number).where(part.c.section == section, fits).cte().prefix_with("MATERIALIZED")
        found = sweep.c[f"{section}_part"].in_(select(fitting.c.number))  # evaluated once, for each part once
        unit = unit_in(condition.value)
        return and_(found, *_unit_sql(unit, name, names)) if unit else found
    if name in names.labels:
        return _json_value_sql(condition, names.json, run_view.c.labels, [name])
    raise names.unknown_name_error(name)


def _unit_sql(unit: str, name: str, names: KnownNames) -> Iterator[ColumnElement[bool]]:
    """Yield the SQL of whether a parameter of a sweep can have a unit: by its component, and by its kind of axis."""
    section = name.partition(".")[0]
    if section in COMPONENT_COLUMNS:
        yield func.coalesce(sweep.c[f"{section}_name"], "").not_in(names.of_other_kind(name, unit))
    straight = {unit for units in names.declared(name).values() for unit in units}
    on_straight, on_rotary = is_of_a_kind(unit, straight), is_of_a_kind(unit, set(map(rotary_unit, straight)))
    if on_straight != on_rotary:
        turns = sweep.c.loop_part.in_(select(part.c.number).where(names.is_rotary_loop))
        yield or_(sweep.c.loop_part.is_(None), turns if on_rotary else not_(turns))


def _json_value_sql(
    condition: Condition, json_sql: JsonSql, column: Expression, place: list[str], kinds: UnitLookup = no_units
) -> ColumnElement[bool]:
    """Return the SQL of a comparison with a value in JSON: as a number, as a text, or as either."""
    number = json_sql.number(column, place)
    if condition.operator not in "=:":
        return _compare_number(number, condition.operator, _required_number(condition, kinds))
    text = _text_sql(condition, json_sql.text(column, place))
    value = _parsed_number(condition, kinds)
    return text if value is None else or_(text, _compare_number(number, "=", value))


def _compare_number(column: Expression, operator: str, value: float) -> ColumnElement[bool]:
    """Return the SQL of a comparison of numbers, which are equal if they differ by rounding only."""
    margin = abs(value) * RELATIVE_TOLERANCE
    low, high = literal(value - margin, Float()), literal(value + margin, Float())
    match operator:
        case ">":
            return column > high
        case ">=":
            return column >= low
        case "<":
            return column < low
        case "<=":
            return column <= high
    return column.between(low, high)


def _text_sql(condition: Condition, column: Expression) -> ColumnElement[bool]:
    if condition.operator == "=":
        return column == condition.value
    if condition.operator == ":":
        return column.icontains(condition.value, autoescape=True)
    raise FilterError(f"filter: '{condition.term}' compares a text; expected {condition.field}= or {condition.field}:")


def _parsed_number(condition: Condition, kinds: UnitLookup) -> float | None:
    try:
        return parse_number(condition.value, kinds)
    except FilterError as error:
        raise FilterError(f"filter: '{condition.term}': {error}") from None


def _required_number(condition: Condition, kinds: UnitLookup = no_units) -> float:
    value = _parsed_number(condition, kinds)
    if value is None:
        raise _no_number_error(condition)
    return value


def _no_number_error(condition: Condition) -> FilterError:
    return FilterError(
        f"filter: '{condition.term}': '{condition.value}' is not a number; expected one such as 12, 1e-6 or 0.1um"
    )


def _check_equality(condition: Condition) -> None:
    if condition.operator not in "=:":
        raise FilterError(
            f"filter: '{condition.term}' needs a value, not a comparison; expected {condition.field}:{condition.value}"
        )


def _key_sql(condition: Condition) -> ColumnElement[bool]:
    _check_equality(condition)
    return _key_prefix_sql(condition.value)


def _key_prefix_sql(text: str) -> ColumnElement[bool]:
    return or_(false(), *[SWEEP_KEY.startswith(head, autoescape=True) for head in key_heads(text)])


def _state_sql(condition: Condition, number: int | None) -> ColumnElement[bool]:
    _check_equality(condition)
    word = condition.value.lower()
    if word == UNUSABLE:
        unusable = [outcome.name for outcome in UNUSABLE_OUTCOMES]
        return or_(_in_run_sql(number, run_sweep.c.state == "failed"), sweep.c.outcome.in_(unusable))
    if word == "computed":  # like sweeps that no run has any more
        return not_(_in_run_sql(number, run_sweep.c.state != word))
    return (
        _in_run_sql(number, run_sweep.c.state == word)
        if word in STATES
        else _outcome_named(condition, (*STATES, UNUSABLE))
    )


def _in_run_sql(number: int | None, *conditions: ColumnElement[bool]) -> ColumnElement[bool]:
    """Return the SQL of whether a sweep meets conditions in the run `number`, or in its latest one."""
    of_run = run_sweep.c.standing == STANDING_LATEST if number is None else run_sweep.c.run == number
    return SWEEP_KEY.in_(select(run_sweep.c.key).where(of_run, *conditions))


def _outcome_sql(condition: Condition) -> ColumnElement[bool]:
    _check_equality(condition)
    return _outcome_named(condition, ())


def _outcome_named(condition: Condition, others: tuple[str, ...]) -> ColumnElement[bool]:
    word = condition.value.upper().replace(" ", "_").replace("-", "_")
    if word not in Outcome.__members__:
        known = [*others, *(outcome.name.lower() for outcome in Outcome)]
        raise FilterError(
            f"filter: there is no {condition.field} '{condition.value}'{did_you_mean(word.lower(), known)}"
        )
    return sweep.c.outcome == word


def _tag_sql(condition: Condition) -> ColumnElement[bool]:
    _check_equality(condition)
    return SWEEP_KEY.in_(select(tag.c.key).where(tag.c.name == condition.value))


def _study_sql(condition: Condition) -> ColumnElement[bool]:
    runs = select(run.c.number).where(_text_sql(condition, run.c.study))
    return exists().where(run_sweep.c.key == SWEEP_KEY, run_sweep.c.run.in_(runs))


def _run_sql(condition: Condition) -> ColumnElement[bool]:
    chosen = _compare_number(run_sweep.c.run, condition.operator, _required_number(condition, lambda: ("1",)))
    return exists().where(run_sweep.c.key == SWEEP_KEY, chosen)


def _elapsed_sql(condition: Condition) -> ColumnElement[bool]:
    minutes = re.sub(r"(?<=[\d.\s])m$", "min", condition.value)  # m is a minute here, never a metre
    value = _required_number(replace(condition, value=minutes), lambda: ("s",))
    elapsed = _compare_number(sweep.c.elapsed, condition.operator, value)
    return and_(sweep.c.outcome.is_not(None), elapsed)


def _created_sql(condition: Condition, now: datetime) -> ColumnElement[bool]:
    created = sweep.c.created
    begin, end = parse_time_span(condition.value, now)
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


def _anywhere_sql(word: str, number: int | None) -> ColumnElement[bool]:
    """Return the SQL of a search in labels, component names, study, message, tags, and the beginning of the key."""
    words = select(field.c.name).where(field.c.kind == "word", field.c.name.icontains(word, autoescape=True))
    runs = select(run.c.number).where(run.c.study.icontains(word, autoescape=True))
    escaped = json.dumps(word)[1:-1]  # as it is in the labels' JSON
    written = cast(run_sweep.c.labels, Text).icontains(escaped, autoescape=True)
    in_message = run_sweep.c.message.icontains(word, autoescape=True)
    return or_(
        *(func.coalesce(sweep.c[f"{name}_name"].in_(words), false()) for name in COMPONENT_COLUMNS),
        _in_run_sql(number, or_(run_sweep.c.run.in_(runs), written, in_message)),
        and_(findings_text.icontains(escaped, autoescape=True), not_(_in_run_sql(number, run_sweep.c.message != ""))),
        SWEEP_KEY.in_(select(tag.c.key).where(tag.c.name.icontains(word, autoescape=True))),
        _key_prefix_sql(word),
    )


FIELD_SQL: dict[str, Callable[[Condition], ColumnElement[bool]]] = {
    "key": _key_sql,
    "outcome": _outcome_sql,
    "tag": _tag_sql,
    "study": _study_sql,
    "run": _run_sql,
    "elapsed": _elapsed_sql,
}
