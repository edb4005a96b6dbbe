"""Numbers that a publication prints, and what a study computes in their place."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from fraexp import units
from fraexp.errors import FraexpError, ParameterError, StudyError
from fraexp.parameters import Parameters, param
from fraexp.paths import value_at
from fraexp.results import Metric

SAME = 1e-9
"""Relative difference up to which two numbers of a study are the same."""


class Printed(Parameters):
    """A number in a publication, and where a study finds its own: a metric of the one sweep that `where` tells."""

    what: str = param("", "what the number is")
    source: str = param("", "where it is printed, such as 'paper, section III-B'", "")
    value: float = param("", "the number, in `unit`")
    unit: str = param("", "its unit", "1")
    compare: Literal["about", "above", "below"] = param("", "how ours is expected to lie: about, above, below", "about")
    tolerance: float | str | None = param("", "how far about is: in `unit`, with another one, or as '1 %'", None)
    metric: str = param("", "name of the metric that is ours")
    where: dict[str, Any] = param("", "labels or parameters of the sweep, by path; a component by its name", {})

    def model_post_init(self, context: object) -> None:
        """Check that numbers can be compared in this unit, and that it is said how near is near."""
        if self.unit != "1":
            units.si(self.unit)
        if (self.compare == "about") != (self.tolerance is not None):
            wanted = "lacks 'tolerance', such as '1 %'" if self.compare == "about" else "has a tolerance; leave it out"
            raise ParameterError(f"compare is '{self.compare}', which {wanted}")
        if self.tolerance is not None and not self.margin > 0:
            raise ParameterError(f"tolerance is {self.tolerance!r}; expected more than 0")

    @classmethod
    def parse_all(cls, tables: Any) -> "tuple[Printed, ...]":
        """Build from a study's ``[[printed]]``; FraexpError says in one line what does not fit."""
        if not isinstance(tables, list) or not all(isinstance(table, Mapping) for table in tables):
            raise StudyError(f"printed is {tables!r:.60}; expected tables, each under [[printed]]")
        return tuple(cls.parse(table, f"[[printed]] number {n}") for n, table in enumerate(tables, start=1))

    @property
    def margin(self) -> float:
        """How far ours may be off [`unit`]; infinite where a side is all that is expected."""
        match self.tolerance:
            case None:
                return math.inf
            case str() as text if text.strip().endswith("%"):
                return abs(self.value) * units.number(text.strip().removesuffix("%").strip(), "1") / 100
            case str() as text:
                return units.number(text, self.unit)
        return float(self.tolerance)

    def beside(self, sweeps: "Sequence[Candidate]") -> "Compared":
        """Return our number beside this one, or why there is none."""
        told = ", ".join(f"{path} = {value}" for path, value in self.where.items())
        where = f" with {told}" if told else ""
        chosen = [of for of in sweeps if all(of.holds(path, value) for path, value in self.where.items())]
        if not chosen:
            return Compared(self, math.nan, f"there is no sweep{where}")
        found = [metric for of in chosen for metric in of.metrics if metric.name == self.metric]
        if not found:
            return Compared(self, math.nan, f"no sweep{where} has a metric '{self.metric}'")
        if len(found) > 1:
            return Compared(self, math.nan, f"{len(found)} sweeps{where} have a metric '{self.metric}': say which one")
        try:
            scale = 1.0 if found[0].unit == self.unit else units.factor(found[0].unit, self.unit)
        except FraexpError as error:
            return Compared(self, math.nan, f"metric '{self.metric}': {error}")
        value = scale * found[0].value
        return Compared(self, value, "" if math.isfinite(value) else f"metric '{self.metric}' has no value{where}")


@dataclass(frozen=True)
class Candidate:
    """A sweep among which a printed number finds its own."""

    labels: Mapping[str, Any]
    sections: Mapping[str, Any]
    """Its experiment, and its estimator under ``estimator``."""
    metrics: Sequence[Metric]

    def holds(self, path: str, wanted: Any) -> bool:
        """Say whether a label, or what is at this path of the sections, is what is wanted."""
        if path in self.labels and _same(self.labels[path], wanted):
            return True
        try:
            return _same(value_at(self.sections, path), wanted)
        except StudyError:
            return False


def _same(found: Any, wanted: Any) -> bool:
    """Compare numbers but for rounding, and a component by its name or by those parameters that are wanted."""
    if isinstance(found, Mapping):
        wanted = wanted if isinstance(wanted, Mapping) else {"name": wanted}
        return all(key in found and _same(found[key], value) for key, value in wanted.items())
    numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in (found, wanted))
    return math.isclose(found, wanted, rel_tol=SAME) if numbers else found == wanted


@dataclass(frozen=True)
class Compared:
    """A printed number with ours."""

    printed: Printed
    ours: float
    """In the printed number's unit; NaN where there is none."""
    remark: str = ""
    """Why there is none."""

    @property
    def difference(self) -> float:
        """Ours less the printed one [unit]."""
        return self.ours - self.printed.value

    @property
    def agrees(self) -> bool:
        """Whether ours is where it is expected."""
        match self.printed.compare:
            case "above":
                return self.difference > 0
            case "below":
                return self.difference < 0
        return abs(self.difference) <= self.printed.margin
