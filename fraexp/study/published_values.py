"""Numbers that a publication prints, what a study computes in their place, and how people write both."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from fraexp.analysis.confidence import NORMAL_QUANTILE
from fraexp.components.parameters import Parameters, param
from fraexp.data import units
from fraexp.data.results import Metric, Outcome, Result
from fraexp.data.sweep import Sweep
from fraexp.errors import FraexpError, ParameterError, StudyError, did_you_mean
from fraexp.study.paths import value_at

RELATIVE_ROUNDING = 1e-9
"""Relative difference up to which two numbers of a study are the same."""
HALF_WIDTH_ENDING = ", 95 %"
"""Ending of a metric's name that marks it as the half width of another metric's 95 % interval."""
MAX_DIGITS = 4
"""Significant digits of a number without a confidence interval."""


Comparison = Literal["about", "above", "below", "within"]
"""How a number is compared: as a value with a tolerance, or as a bound from below, from above, or of the magnitude."""
Origin = Literal["input", "calibrated", "predicted", "unstated"]
"""What a study knew of a number: the number itself, a parameter chosen to match it, or neither."""
ORIGINS: tuple[Origin, ...] = ("predicted", "calibrated", "input", "unstated")
"""In the order in which a verdict counts them: agreement with what was predicted is worth most."""


class PublishedNumber(Parameters):
    """A number in a publication, and where a study finds its own: a metric of the one sweep that `where` selects."""

    what: str = param("", "what the number is")
    source: str = param("", "where it is printed, such as 'paper, section III-B'", "")
    value: float = param("", "the number, in `unit`")
    unit: str = param("", "its unit", "1")
    compare: Comparison = param("", "expected place of ours: about, or a bound: above, below or within ±", "about")
    tolerance: float | str | None = param("", "tolerance of about: in `unit`, with another unit, or as '1 %'", None)
    metric: str = param("", "name of the metric that is ours")
    where: dict[str, Any] = param("", "labels or parameters of the sweep, by path; a component by its name", {})
    origin: Origin = param(
        "", "input: given to the simulation; calibrated: a parameter was chosen to match it; predicted", "unstated"
    )
    accepts_inaccurate: bool = param(
        "",
        "whether ours may be from an inaccurate sweep: the publication reads it off a model that does not fit either",
        False,
    )
    note: str = param("", "where it enters the simulation, or how ours comes about", "")

    def model_post_init(self, context: object) -> None:
        """Check that numbers can be compared in this unit, and that a tolerance is given where one is needed."""
        if self.unit != "1":
            units.si(self.unit)
        if (self.compare == "about") != (self.tolerance is not None):
            wanted = "lacks 'tolerance', such as '1 %'" if self.compare == "about" else "has a tolerance; leave it out"
            raise ParameterError(f"compare is '{self.compare}', which {wanted}")
        if self.tolerance is not None and not self.margin > 0:
            raise ParameterError(f"tolerance is {self.tolerance!r}; expected more than 0")
        if self.compare == "within" and not self.value > 0:
            raise ParameterError(f"compare is 'within' ±{self.value:g}; expected a value above 0")

    @classmethod
    def parse_all(cls, tables: Any) -> "tuple[PublishedNumber, ...]":
        """Build from a study's ``[[published]]``; FraexpError says in one line what does not fit."""
        if not isinstance(tables, list) or not all(isinstance(table, Mapping) for table in tables):
            raise StudyError(f"published is {tables!r:.60}; expected tables, each under [[published]]")
        return tuple(cls.parse(table, f"[[published]] number {n}") for n, table in enumerate(tables, start=1))

    @property
    def is_bound(self) -> bool:
        """Whether the published number is a limit, from which ours has no difference to be judged."""
        return self.compare != "about"

    @property
    def bound_text(self) -> str:
        """Return the bound as people write it, without its unit; the number itself if it is a value."""
        return f"{ {'about': '', 'above': '> ', 'below': '< ', 'within': '± '}[self.compare] }{self.value:g}"

    @property
    def margin(self) -> float:
        """Allowed difference [`unit`]; infinite if the number is a bound."""
        match self.tolerance:
            case None:
                return math.inf
            case str() as text if text.strip().endswith("%"):
                return abs(self.value) * units.number(text.strip().removesuffix("%").strip(), "1") / 100
            case str() as text:
                return units.number(text, self.unit)
        return float(self.tolerance)

    def compare_with(self, sweeps: "Sequence[Candidate]") -> "PublishedComparison":
        """Return the study's number beside this one, or why there is none."""
        told = ", ".join(f"{path} = {value}" for path, value in self.where.items())
        where = f" with {told}" if told else ""
        chosen = [of for of in sweeps if self.selects(of)]
        if not chosen:
            return PublishedComparison(self, math.nan, f"there is no sweep{where}")
        found = [(metric, of) for of in chosen for metric in of.metrics if metric.name == self.metric]
        if not found:
            return PublishedComparison(self, math.nan, f"no sweep{where} has a metric '{self.metric}'")
        if len(found) > 1:
            return PublishedComparison(
                self, math.nan, f"{len(found)} sweeps{where} have a metric '{self.metric}': say which one"
            )
        metric, of = found[0]
        try:
            scale = 1.0 if metric.unit == self.unit else units.factor(metric.unit, self.unit)
        except FraexpError as error:
            return PublishedComparison(self, math.nan, f"metric '{self.metric}': {error}")
        value, half = scale * metric.value, scale * of.half_widths.get(metric.name, math.nan)
        lacking = "" if math.isfinite(value) else f"metric '{self.metric}' has no value{where}"
        return PublishedComparison(self, value, lacking, half, of.outcome)

    def selects(self, sweep: "Candidate") -> bool:
        """Say whether `where` selects a sweep."""
        return all(sweep.holds(path, value) for path, value in self.where.items())


@dataclass(frozen=True)
class Candidate:
    """A sweep among which a printed number finds its own."""

    labels: Mapping[str, Any]
    sections: Mapping[str, Any]
    """Its experiment, and its estimator under ``estimator``."""
    metrics: Sequence[Metric]
    half_widths: Mapping[str, float] = field(default_factory=dict)
    """Half widths of the metrics' 95 % intervals by name [unit of the metric], where known."""
    outcome: Outcome = Outcome.OK

    def holds(self, path: str, wanted: Any) -> bool:
        """Say whether a label, or what is at this path of the sections, is what is wanted."""
        if path in self.labels and _same(self.labels[path], wanted):
            return True
        try:
            return _same(value_at(self.sections, path), wanted)
        except StudyError:
            return False


def _same(found: Any, wanted: Any) -> bool:
    """Compare numbers except for rounding, and a component by its name or by the given parameters."""
    if isinstance(found, Mapping):
        wanted = wanted if isinstance(wanted, Mapping) else {"name": wanted}
        return all(key in found and _same(found[key], value) for key, value in wanted.items())
    numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in (found, wanted))
    return math.isclose(found, wanted, rel_tol=RELATIVE_ROUNDING) if numbers else found == wanted


@dataclass(frozen=True)
class PublishedComparison:
    """A printed number with ours."""

    published: PublishedNumber
    ours: float
    """In the printed number's unit; NaN where there is none."""
    remark: str = ""
    """Why there is none."""
    half: float = math.nan
    """Half width of the 95 % interval of ours, in the same unit; NaN if unknown."""
    outcome: Outcome = Outcome.OK
    """Of the sweep that ours is from."""

    @property
    def difference(self) -> float:
        """Ours less the printed one [unit]."""
        return self.ours - self.published.value

    @property
    def agrees(self) -> bool:
        """Whether ours is where it is expected."""
        match self.published.compare:
            case "above":
                return self.difference > 0
            case "below":
                return self.difference < 0
            case "within":
                return abs(self.ours) <= self.published.value
        return abs(self.difference) <= self.published.margin

    @property
    def is_met(self) -> bool:
        """Whether ours is where it is expected, and is from a sweep without a reservation that counts."""
        return self.agrees and not self.has_reservation

    @property
    def has_reservation(self) -> bool:
        """Whether ours is from a sweep that is not ok, unless the number is known to be of an inaccurate one."""
        accepted = {Outcome.OK, Outcome.INACCURATE} if self.published.accepts_inaccurate else {Outcome.OK}
        return self.outcome not in accepted


def check(numbers: Sequence[PublishedNumber], sweeps: Sequence[Sweep], place: str) -> None:
    """Raise StudyError if a published number refers to a sweep that the study does not have.

    Whether that sweep has the metric shows only when it has been computed.
    """
    candidates = [Candidate(of.labels, of.sections, ()) for of in sweeps]
    for index, one in enumerate(numbers, start=1):
        if not any(one.selects(of) for of in candidates):
            raise StudyError(f"{place}, [[published]] number {index}: {_why_none(one, candidates)}")


def _why_none(one: PublishedNumber, candidates: Sequence[Candidate]) -> str:
    for path, wanted in one.where.items():
        if any(of.holds(path, wanted) for of in candidates):
            continue
        labels = {str(of.labels[path]) for of in candidates if path in of.labels}
        if labels:
            return f"no sweep has {path} = {wanted!r}{did_you_mean(str(wanted), labels)}"
        try:
            found = value_at(candidates[0].sections, path)
        except StudyError as error:
            return str(error)
        return f"no sweep has {path} = {wanted!r}; the first one has {found!r:.60}"
    told = ", ".join(f"{path} = {value!r}" for path, value in one.where.items())
    return f"no sweep has {told} together"


def half_widths(result: Result) -> dict[str, float]:
    """Return half the widths of the 95 % intervals of a result's metrics, by name, where they are known.

    A metric may have its own in another one; that of a fitted parameter is in the fit's covariance.
    """
    found = {}
    for metric in result.metrics:
        if metric.name.endswith(HALF_WIDTH_ENDING):
            found[metric.name.removesuffix(HALF_WIDTH_ENDING)] = metric.value
        for fit in result.fits:
            deviations = zip(fit.values.tolist(), fit.units, fit.standard_deviation.tolist(), strict=True)
            for value, unit, deviation in deviations:
                if (value, unit) == (metric.value, metric.unit) and deviation > 0:  # 0 where it was held
                    found[metric.name] = NORMAL_QUANTILE * deviation
    return found


def number_text(value: float, half: float = math.nan, like: float = math.nan) -> str:
    """Return a number with half the width of its interval, to the second digit of that; without one in short.

    `like` is a width by whose digits it is rounded where it has none of its own.
    """
    if not math.isfinite(value):
        return "–"
    if math.isfinite(half) and half > RELATIVE_ROUNDING * abs(value):
        return interval_text(value, half)
    if math.isfinite(like) and like > RELATIVE_ROUNDING * abs(value):
        return round_to_width(value, like)
    if 10**MAX_DIGITS <= abs(value) < 1e6 or (value == round(value) and abs(value) < 1e6):
        return f"{value:.0f}"
    return f"{value:.{MAX_DIGITS}g}"


def interval_text(value: float, half: float) -> str:
    """Return a number with half the width of its interval, both to the second digit of that."""
    return f"{round_to_width(value, half)} ± {round_to_width(half, half)}"


def round_to_width(value: float, half: float) -> str:
    """Return a number, rounded to the second digit of a width."""
    decimals = 1 - int(f"{half:.1e}".partition("e")[2])
    return f"{round(value, decimals) + 0.0:.{max(decimals, 0)}f}"  # + 0.0: never -0
