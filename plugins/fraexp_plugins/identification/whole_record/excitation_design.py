"""Which sines tell most in a given time? Amplitude and periods of each frequency, for a machine known preliminarily."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from fraexp.api import (
    NORMAL_QUANTILE,
    Controller,
    ControlLoop,
    Curve,
    Estimator,
    Fit,
    FrictionModel,
    Machine,
    Metric,
    Numerics,
    Outcome,
    ParameterError,
    Plant,
    Quantity,
    RecordError,
    Result,
    Signals,
    param,
    remarks,
    simulate_loop,
)
from fraexp_plugins.excitations.sine_list import SineList
from fraexp_plugins.identification.whole_record._fit_report import FitReport
from fraexp_plugins.identification.whole_record._machine_problem import (
    DEAD_TIME,
    FreeParameters,
)
from fraexp_plugins.identification.whole_record._plan_search import (
    Plan,
    PlannedRecord,
    PlanSearch,
    planned_records,
)
from fraexp_plugins.identification.whole_record._record_fit import RecordFit
from fraexp_plugins.identification.whole_record.maximum_likelihood import MaximumLikelihood

UNIFORM, DESIGNED = "uniform plan", "designed plan"
MIN_WIDER_RATIO = 1.01
"""Interval of a parameter over that with equal sines from which the message names it."""


class ExcitationDesign(Estimator, name="excitation_design", version=4):
    """The sines that tell most of plant and friction in a given measuring time (optimal input design).

    `method` finds plant, friction and noise from the records there are: those of a short measurement, or of a simulated
    machine. That machine is simulated in its loop at every frequency and every one of `amplitudes`. The information of
    each period in the likelihood (G. C. Goodwin and R. L. Payne, Dynamic System Identification: Experiment Design and
    Data Analysis, 1977) says how wide the bands of `maximum_likelihood` would be. Periods and amplitudes are exchanged
    as long as that narrows the bands (V. V. Fedorov, Theory of Optimal Experiments, 1972). What counts is the root mean
    square of the bands of P̂ over the frequencies, and the geometric mean of those of friction's free parameters.

    The result is the excitation `sine_list`: `fraexp design ID -o FILE` writes a study with it. Metrics and curves are
    the bands that it is predicted to reach, beside those of a uniform plan: the best one with one amplitude, and equal
    times or equal numbers of periods, in the same measuring time, settling included. Numbers of the plant do not count
    beside its response: where the designed sines tell less of one, the message says so.

    The prediction is as good as the preliminary machine. Amplitudes are limited by `amplitudes` and `max_stroke` alone:
    greater ones tell more of the plant, and are rarely worse for friction. `extra_frequencies` are measured only if
    they tell enough of friction. Without noise (less than a tenth of the encoder's step) periods that are repeated tell
    nothing new; then amplitudes alone are chosen.
    """

    fits: ClassVar[str] = "excitation"

    method: Estimator = param("", "maximum_likelihood, which finds the preliminary machine")
    amplitudes: tuple[float, ...] = param("N", "amplitudes among which is chosen")
    measuring_time: float = param("s", "time of the whole measurement, with settling", above=0)
    max_stroke: float | None = param("m", "greatest motion, peak to peak; none if it is not given", None, above=0)
    extra_frequencies: tuple[float, ...] = param(
        "Hz", "frequencies that may be measured too, for what they tell of friction", ()
    )
    controller: Controller = param("", "controller of the loop", inherit="controller")
    loop: dict[str, Any] = param("", "sampled loop with delays and encoder", inherit="loop")

    def model_post_init(self, context: object) -> None:
        """Check the method and the amplitudes."""
        if not isinstance(self.method, MaximumLikelihood):
            raise ParameterError(
                f"excitation_design.method is {self.method.name}; expected maximum_likelihood, whose bands are "
                "predicted"
            )
        if not self.amplitudes or min(self.amplitudes) <= 0:
            raise ParameterError("excitation_design.amplitudes must be one or more numbers above 0 N")
        ControlLoop.parse(self.loop, "excitation_design.loop")

    def estimate(self, signals: Signals) -> Result:
        """Return what `method` finds, the excitation, and the bands that are predicted with it."""
        assert isinstance(self.method, MaximumLikelihood)
        if not signals.segments:
            return Result(signals.outcome, signals.findings)
        report = self.method.fit(signals)
        found = report.result()
        if found.outcome is not Outcome.OK:
            return found.with_findings("no excitation is designed, as the preliminary machine is not known")
        search = self._search(self._preliminary(report))
        uniform, best = search.uniform(), search.best()
        if uniform is None or best is None:
            raise RecordError(
                f"excitation_design: a period of each frequency takes {search.shortest_time:.4g} s with settling; "
                f"measuring_time is {self.measuring_time:g} s: raise it, or leave frequencies out"
            )
        return self._with_plans(found, search, uniform, best)

    def _preliminary(self, report: FitReport) -> "_Preliminary":
        """Return the machine that was found."""
        friction, models = report.found.friction, report.found.models
        if friction is None:
            raise RecordError(
                "excitation_design: the friction law has no parameters for the scales that were found; free others, or "
                "take a law such as rolling, Dahl, LuGre or GMS"
            )
        fit = report.found.fit
        noise = fit.noise if report.noise is None else report.noise.value
        frequencies = np.unique(np.concatenate([record.frequency for record in fit.records]))
        return _Preliminary(
            models.plant, friction, models.replay.input_path[0], noise, fit.free, tuple(frequencies.tolist()),
        )  # fmt: skip

    def _search(self, known: "_Preliminary") -> PlanSearch:
        """Return what can be measured of a machine, and for how long."""
        frequencies = (*known.frequencies, *self.extra_frequencies)
        records = iter(self._plan_records(known, frequencies))
        choices = [tuple(next(records) for _ in self.amplitudes) for _ in frequencies]
        allowed = [tuple(each for each in of if self._is_allowed(each)) for of in choices]
        for frequency, of in zip(frequencies, allowed, strict=True):
            if not of and frequency in known.frequencies:
                raise RecordError(
                    f"excitation_design: at {frequency:.4g} Hz the machine moves farther than max_stroke, ",
                    Quantity(self.max_stroke or 0.0, "m"),
                    ", with every amplitude: add smaller amplitudes",
                )
        is_wanted = [frequency in known.frequencies for frequency in frequencies]
        kept = [pair for pair in zip(allowed, is_wanted, strict=True) if pair[0]]
        return PlanSearch(
            tuple(of for of, _ in kept), tuple(each for _, each in kept), len(known.free.friction), self.measuring_time
        )

    def _is_allowed(self, record: PlannedRecord) -> bool:
        return self.max_stroke is None or record.stroke <= self.max_stroke

    def _plan_records(self, known: "_Preliminary", frequencies: Sequence[float]) -> list[PlannedRecord]:
        """Return what a period of each frequency tells, at each amplitude."""
        assert isinstance(self.method, MaximumLikelihood)
        settings = ControlLoop.parse({**self.loop, "noise": known.noise}, "loop")
        sines = SineList(
            frequencies=tuple(np.repeat(frequencies, len(self.amplitudes)).tolist()),
            amplitudes=tuple(np.tile(self.amplitudes, len(frequencies)).tolist()),
        )
        sines.check(settings.sample_time)
        machine = Machine(known.plant, known.friction, self.controller, settings, Numerics())
        signals = simulate_loop(machine, sines, lambda _: None)
        if len(signals.segments) < len(sines.frequencies):
            raise RecordError(
                f"excitation_design: the preliminary machine diverges in its loop ({signals.message}): lower the "
                "amplitudes, or correct controller and loop"
            )
        method = self.method.model_copy(update={"input_dead_time": known.dead_time})
        fit = RecordFit.around(method.problem(signals, known.noise, known.friction), known.plant)
        return planned_records(replace(fit, free=known.free), sines.amplitudes)

    def _with_plans(self, found: Result, search: PlanSearch, uniform: Plan, designed: Plan) -> Result:
        gain = np.exp(search.criterion(designed) - search.criterion(uniform))
        widest = float(designed.standard_deviations().max() / uniform.standard_deviations().max())
        text = (
            f"in {self.measuring_time:g} s the designed sines are predicted to make bands {gain:.2f} times as wide as "
            f"equal ones do, the widest one of P̂ {widest:.2f} times"
        )
        parameters = _planned_parameters(found, ControlLoop.parse(self.loop, "loop").sample_time)
        wider = ", ".join(_wider_intervals(parameters, uniform, designed))
        text += f"; wider intervals: {wider}" if wider else ""
        metrics = [*_plan_metrics(UNIFORM, uniform, parameters), *_plan_metrics(DESIGNED, designed, parameters)]
        ordered = sorted(designed.measured, key=lambda pair: pair[0].frequency)
        excitation = SineList(
            frequencies=tuple(record.frequency for record, _ in ordered),
            amplitudes=tuple(record.amplitude for record, _ in ordered),
            period_counts=tuple(count for _, count in ordered),
        )
        fit = Fit("excitation", excitation.spec(), (), (), np.empty(0), np.empty((0, 0)))
        return replace(
            found,
            findings=(*remarks(text), *found.findings),
            metrics=(*metrics, *found.metrics),
            curves=(_plan_curve(UNIFORM, uniform), _plan_curve(DESIGNED, designed), *found.curves),
            fits=(*found.fits, fit),
        )


class _Preliminary(NamedTuple):
    """A machine that is known preliminarily."""

    plant: Plant
    friction: FrictionModel
    dead_time: float
    """Before the thrust [s]."""
    noise: float
    """[m]"""
    free: FreeParameters
    """What is to be estimated of it."""
    frequencies: tuple[float, ...]
    """[Hz]"""


class _PlannedParameter(NamedTuple):
    """A parameter whose interval is predicted."""

    name: str
    unit: str
    slope: float
    """Change of its value with what the fit sees: the logarithm of the value, or samples of dead time."""


def _planned_parameters(found: Result, sample_time: float) -> list[_PlannedParameter]:
    """Return the parameters of a result that have an interval, friction's first."""
    names = {metric.name for metric in found.metrics}
    return [
        _PlannedParameter(metric.name, metric.unit, sample_time if metric.name == DEAD_TIME else abs(metric.value))
        for metric in found.metrics
        if f"{metric.name}, 95 %" in names
    ]


def _wider_intervals(parameters: Sequence[_PlannedParameter], uniform: Plan, designed: Plan) -> Iterator[str]:
    """Yield each parameter that the designed sines tell less of, and by how much its interval grows."""
    ratios = np.sqrt(np.diag(designed.covariance()) / np.diag(uniform.covariance()))
    for parameter, ratio in zip(parameters, ratios, strict=False):
        if ratio >= MIN_WIDER_RATIO:
            yield f"{parameter.name} {ratio:.2f} times"


def _plan_metrics(label: str, plan: Plan, parameters: Sequence["_PlannedParameter"]) -> Iterator[Metric]:
    """Yield the measuring time, the bands of P̂, and the intervals of friction and plant, all predicted."""
    bands = NORMAL_QUANTILE * plan.standard_deviations()
    yield Metric(f"{label}: time", plan.time, "s")
    yield Metric(f"{label}: band, rms", float(np.sqrt(np.mean(bands**2))), "1")
    yield Metric(f"{label}: largest band", float(bands.max()), "1")
    for each, std in zip(parameters, np.sqrt(np.diag(plan.covariance())), strict=False):
        yield Metric(f"{label}: {each.name}, 95 %", float(NORMAL_QUANTILE * std * each.slope), each.unit)


def _plan_curve(label: str, plan: Plan) -> Curve:
    """Return the sines of a plan with the relative standard deviation of P̂ that is predicted."""
    measured, std = plan.measured, plan.standard_deviations()
    columns = {
        "frequency": np.array([record.frequency for record, _ in measured]),
        "amplitude": np.array([record.amplitude for record, _ in measured]),
        "periods": np.array([float(count) for _, count in measured]),
        "relative standard deviation": std,
    }
    return Curve(label, columns, dict(zip(columns, ("Hz", "N", "1", "1"), strict=True)))
