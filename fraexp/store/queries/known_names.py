"""Names that a filter can use in a database: fields, parameters, labels and metrics, with their units."""

import difflib
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

from sqlalchemy import ColumnElement, Connection, and_, or_, select

from fraexp.data.rotary_axes import rotary_unit
from fraexp.errors import FilterError, did_you_mean
from fraexp.store.queries.filters import is_of_a_kind
from fraexp.store.queries.json_sql import JsonSql
from fraexp.store.tables import field, metric, part, sweep

METRIC_PREFIX = "metric."
COMPONENT_COLUMNS = ("estimator", "friction", "plant", "controller", "excitation")
SWEEP_FIELDS = (
    "key",
    "state",
    "outcome",
    *COMPONENT_COLUMNS,
    "source",
    "study",
    "run",
    "tag",
    "message",
    "elapsed",
    "created",
)
"""Fields that all sweeps have."""
UnitDeclarations = Callable[[str], Mapping[str, Collection[str]]]
"""Returns the units of a parameter on a straight axis, by the component that declares it.

The name is empty for a section that is no component.
"""
MAX_UNIT_SAMPLES = 100
"""Values of a metric whose units are read."""


def no_declared_units(name: str) -> Mapping[str, Collection[str]]:
    """Return no unit, if the units of parameters are unknown."""
    return {}


@dataclass(frozen=True)
class KnownNames:
    """What can stand in a filter, and the units of numbers; read once for a filter."""

    parameters: frozenset[str]
    labels: frozenset[str]
    metrics: frozenset[str]
    connection: Connection
    declared: UnitDeclarations = no_declared_units

    @classmethod
    def of(cls, connection: Connection, declared: UnitDeclarations = no_declared_units) -> "KnownNames":
        """Read the names from a database."""
        found: dict[str, set[str]] = {"parameter": set(), "label": set(), "metric": set(), "word": set()}
        for kind, name in connection.execute(select(field.c.kind, field.c.name)):
            found[kind].add(name)
        parameters, labels, metrics = (frozenset(found[kind]) for kind in ("parameter", "label", "metric"))
        return cls(parameters, labels, metrics, connection, declared)

    @property
    def json(self) -> JsonSql:
        """SQL of values in this database's JSON."""
        return JsonSql(self.connection)

    @property
    def is_rotary_loop(self) -> ColumnElement[bool]:
        """SQL of whether a part is the loop of a rotary axis."""
        return and_(part.c.section == "loop", self.json.text(part.c.content, ["rotary"]) == "true")

    def units(self, name: str) -> frozenset[str]:
        """Return the units of the numbers with a name; none if they are unknown."""
        if not name.startswith(METRIC_PREFIX):
            return frozenset(unit for of in self.stored_units(name).values() for unit in of)
        some = (
            select(metric.c.unit)
            .where(metric.c.name == name.removeprefix(METRIC_PREFIX))
            .limit(MAX_UNIT_SAMPLES)
            .subquery()
        )
        return frozenset(self.connection.scalars(select(some.c.unit).distinct()))

    def stored_units(self, name: str) -> Mapping[str, Collection[str]]:
        """Return the units of a parameter by component, of those that a sweep has; all of them if none has any.

        Those of a rotary axis are among them if one is stored.
        """
        declared, section = self.declared(name), name.partition(".")[0]
        if self.may_turn():
            declared = {of: {*units, *map(rotary_unit, units)} for of, units in declared.items()}
        if section not in COMPONENT_COLUMNS:
            return declared
        stored = set(self.connection.scalars(select(sweep.c[f"{section}_name"]).distinct()))
        return {of: units for of, units in declared.items() if of in stored} or declared

    def of_other_kind(self, name: str, unit: str) -> list[str]:
        """Return the components whose parameter has no unit of the kind of `unit`."""
        return [of for of, units in self.stored_units(name).items() if not is_of_a_kind(unit, units)]

    def may_turn(self) -> bool:
        """Return whether a stored sweep has a rotary axis, or is measured: on an axis of either kind."""
        found = select(part.c.number).where(or_(part.c.section == "record", self.is_rotary_loop)).limit(1)
        return self.connection.scalar(found) is not None

    def full_name(self, name: str) -> str:
        """Return the name that another one is the last part of, as headings are: of labels, else of parameters.

        A known name is its own. FilterError if several end so.
        """
        if name in SWEEP_FIELDS or name in self.parameters | self.labels:
            return name
        for known in (self.labels, self.parameters):
            found = sorted(of for of in known if of.endswith(f".{name}"))
            if len(found) > 1:
                raise FilterError(f"filter: '{name}' is ambiguous; expected one of: {', '.join(found)}")
            if found:
                return found[0]
        return name

    def has_only_numbers(self, section: str, place: Sequence[str]) -> bool:
        """Return whether a parameter is a number wherever it is stored."""
        number, text = self.json.number(part.c.content, place), self.json.text(part.c.content, place)
        stored = select(part.c.number).where(part.c.section == section, text.is_not(None)).limit(1)
        return (
            self.connection.scalar(stored) is not None
            and self.connection.scalar(stored.where(number.is_(None))) is None
        )

    def check_name(self, column: str, value: str) -> None:
        """Raise FilterError if no sweep has a component of this name, but some have others."""
        of = sweep.c[f"{column}_name"]
        if self.connection.scalar(select(of).where(of == value).limit(1)) is not None:
            return
        known = [str(name) for name in self.connection.scalars(select(of).where(of.is_not(None)).distinct())]
        if known:
            raise FilterError(f"filter: no sweep has the {column} '{value}'{did_you_mean(value, known)}")

    def check_word(self, word: str) -> None:
        """Raise FilterError for a word that is the path of a parameter, which no sweep is found by."""
        if "." in word and word in self.parameters | self.labels:
            raise FilterError(f"filter: '{word}' is a parameter; expected a comparison, such as {word}=VALUE")

    def all(self) -> list[str]:
        """Return all names that a filter can use."""
        metrics = {f"{METRIC_PREFIX}{name}" for name in self.metrics}
        return [*SWEEP_FIELDS, *sorted((self.parameters | self.labels | metrics) - set(SWEEP_FIELDS))]

    def unknown_name_error(self, name: str, place: str = "filter") -> FilterError:
        """Return the error for an unknown name in a filter, or in an order."""
        known = self.all()
        near = [other for other in known if other.endswith(f".{name}")]
        near = near or difflib.get_close_matches(name, known, n=1, cutoff=0.5)
        hint = f"did you mean '{near[0]}'?" if near else "expected one such as estimator, tag or excitation.amplitude"
        return FilterError(f"{place}: nothing in the database has '{name}'; {hint}")
