"""Which sines tell most in a given time? Amplitude and periods of each frequency, for a machine known preliminarily."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    NORMAL_QUANTILE,
    Controller,
    ControlLoop,
    Curve,
    Estimator,
    Fit,
    Machine,
    Metric,
    Numerics,
    Outcome,
    ParameterError,
    Quantity,
    RecordError,
    Result,
    Signals,
    param,
    remarks,
    simulate_loop,
)
from fraexp_plugins.estimators._shared.measured_motion import repeated_share
from fraexp_plugins.excitations.sine_list import SineList
from fraexp_plugins.identification._likelihood import LinearRecord, interval_loss
from fraexp_plugins.identification._machine_fit import FitReport
from fraexp_plugins.identification._machine_problem import DEAD_TIME
from fraexp_plugins.identification._record_fit import RecordFit, State
from fraexp_plugins.identification.maximum_likelihood import MaximumLikelihood


class PlannedRecord(NamedTuple):
    """One sine that may be measured, and what a period of it would tell."""

    frequency: float
    """[Hz]"""
    amplitude: float
    """[N]"""
    period: float
    """Time of a period [s]: whole cycles in whole samples."""
    settled: float
    """Time until it has settled [s], which the one period of the shortest record is part of."""
    stroke: float
    """Peak to peak motion [m]."""
    shared: NDArray[np.float64]
    """Information of a period about the shared parameters, where the response is the plant's, shape (p, p)."""
    own: NDArray[np.float64]
    """Relative covariance of 1/P̂ from a period whose friction is known, shape (2, 2)."""
    slopes: NDArray[np.float64]
    """Relative change of 1/P̂ by the shared parameters, shape (2, p): as they are wrong, so is the response."""
    told: NDArray[np.float64]
    """Covariance of the error of 1/P̂ that is the record's own with the shared parameters, over that of the latter,
    shape (2, p): the record tells them, too."""
    repeated: float
    """Share of the variance of a sample's error that is the same in each period; see `repeated_error`."""

    def time(self, count: int) -> float:
        """Return the time that so many periods take [s]; none if it is not measured.

        A record no longer than the windows in which settling shows is the last of them; a longer one comes after it.
        """
        if not count:
            return 0.0
        return self.settled + (count * self.period if count > 1 else 0.0)

    def weight(self, count: int) -> float:
        """Return how many periods without a common error would tell as much."""
        return count / (1 + (count - 1) * self.repeated) if count else 0.0


def planned_records(fit: RecordFit, amplitudes: Sequence[float]) -> list[PlannedRecord]:
    """Return what the simulated records of a fit would tell about the machine that was simulated, and the fit knows.

    `amplitudes` are those of their excitation [N].
    """
    state = State(np.zeros(len(fit.free.names)), tuple(np.zeros(record.count) for record in fit.records))
    fit = fit.with_needed_drifts(state)
    state = State(state.shared, tuple(np.zeros(record.count) for record in fit.records))
    linear, repeated = fit.linearised_at(state), repeated_error(fit.noise, fit.resolution)
    found = []
    for amplitude, record, each, inverse, slopes in zip(
        amplitudes, fit.records, linear.records, linear.inverse, linear.inverse_slopes, strict=True
    ):
        segment = record.segment
        period = segment.samples * segment.sample_time
        settled = (segment.settling.time if segment.settling else 0.0) + period
        size = float(record.frequency[0]), amplitude, period, settled, float(np.ptp(record.position))
        found.append(
            PlannedRecord(
                *size, *_information(each, slopes[0] / inverse[0], record.forces, state.shared.size), repeated
            )
        )
    return found


def repeated_error(noise: float, resolution: float) -> float:
    """Return the share of the variance of samples' errors that each period repeats, for noise and encoder step [m]."""
    return repeated_share(resolution, noise) / (1 + 12 * (noise / resolution) ** 2) if resolution else 0.0


def _information(
    record: LinearRecord, slopes: NDArray[np.complex128], forces: int, p: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return what a planned record knows: `shared`, `own`, `slopes` and `told`."""
    curvature = interval_loss(record.residual, record.resolution, record.std).curvature
    hessian = (record.jacobian.T * curvature) @ record.jacobian
    # Where the response is the plant's, a record has a drift of its own only.
    drift = hessian[p + forces :, p + forces :]
    mixed_drift = hessian[p + forces :, :p]
    by_drift = np.linalg.solve(drift, mixed_drift)
    shared = hessian[:p, :p] - mixed_drift.T @ by_drift
    parts = np.stack([slopes.real, slopes.imag])
    gain = np.linalg.solve(hessian[p:, p:], parts[:, p:].T).T
    own, mixed = gain @ parts[:, p:].T, hessian[p:, :p]
    told = gain @ (mixed - hessian[p:, p + forces :] @ by_drift)
    return shared, own, parts[:, :p] - gain @ mixed, told


class Plan(NamedTuple):
    """Records that are to be measured, and how often each of them."""

    records: tuple[PlannedRecord, ...]
    counts: tuple[int, ...]
    """Periods of each; 0 for one that is left out."""

    @property
    def time(self) -> float:
        """Measuring time [s]."""
        return sum(record.time(count) for record, count in zip(self.records, self.counts, strict=True))

    @property
    def measured(self) -> list[tuple[PlannedRecord, int]]:
        """The records that are measured, each with its number of periods."""
        return [pair for pair in zip(self.records, self.counts, strict=True) if pair[1]]

    def covariance(self) -> NDArray[np.float64]:
        """Return the covariance of the shared parameters, shape (p, p)."""
        return np.asarray(np.linalg.pinv(sum(r.weight(n) * r.shared for r, n in self.measured), hermitian=True))

    def standard_deviations(self) -> NDArray[np.float64]:
        """Return the relative standard deviation of P̂ of each measured record, shape (n,).

        The shared parameters are told by all records, that of the response among them: see `covariances_beside`.
        """
        covariance, measured = self.covariance(), self.measured
        weights = np.array([record.weight(count) for record, count in measured])
        own = np.array([np.trace(record.own) for record, _ in measured]) / weights
        slopes, told = (np.array(each) for each in zip(*((r.slopes, r.told) for r, _ in measured), strict=True))
        by_shared = np.einsum("kip,pq,kiq->k", slopes, covariance, slopes + 2 * told)
        return np.asarray(np.sqrt(own + by_shared))


def log_deviation(plan: Plan, friction: int, is_wanted: Sequence[bool]) -> float:
    """Return the logarithm of what a plan leaves open: of wanted responses and of the first shared parameters.

    Of the responses it is the root mean square of the relative standard deviations, in which the widest band counts
    most; of friction's parameters, which have no common size, the geometric mean. Both count alike.
    """
    wanted = [each for each, count in zip(is_wanted, plan.counts, strict=True) if count]
    responses = plan.standard_deviations()[np.array(wanted, dtype=bool)]
    logs = [0.5 * np.log(np.mean(responses**2))]
    if friction:
        logs.append(0.5 * np.mean(np.log(np.diag(plan.covariance())[:friction])))
    return float(np.mean(logs))


SHARES = 400
"""Times of a record that are tried in a uniform plan: each 2 % longer, as rounded counts fill the time no better."""
PORTION = 0.01
"""Part of the measuring time that is moved from one record to another at once."""
ADDED_PORTIONS, MAX_TAKEN = (1, 3, 10), 4
"""How many portions are given to a record of at most one, as where a second one begins settling is waited for, the
first two of which are also taken from one; and from how many records in turn."""
MIN_GAIN = 1e-5
"""Least gain of the criterion, a logarithm, for which time is moved: bands that are narrower by 1e-5."""


@dataclass(frozen=True)
class PlanSearch:
    """What can be measured, and for how long.

    To halve the bands of the responses counts as much as to halve those of friction's parameters.
    """

    choices: tuple[tuple[PlannedRecord, ...], ...]
    """Records of each frequency, one for each amplitude, shape (frequencies, amplitudes)."""
    is_wanted: tuple[bool, ...]
    """Whether the response of a frequency is wanted; others are measured only for what they tell of friction."""
    friction: int
    """Number of shared parameters, the first ones, that are friction's."""
    time: float
    """Measuring time [s]."""

    def criterion(self, plan: Plan) -> float:
        """Return what is to be as small as possible."""
        return log_deviation(plan, self.friction, self.is_wanted)

    @property
    def shortest_time(self) -> float:
        """Least time in which the wanted responses can be measured [s]."""
        pairs = zip(self.choices, self.is_wanted, strict=True)
        return sum(min(record.time(1) for record in records) for records, is_wanted in pairs if is_wanted)

    def uniform(self) -> Plan | None:
        """Return the best plan of one amplitude with equal times, or equal numbers of periods; None without time."""
        found = list(self._uniform_plans())
        return min(found, key=self.criterion) if found else None

    def _uniform_plans(self) -> Iterator[Plan]:
        """Yield for each amplitude the longest plans of equal times, and of equal numbers of periods."""
        amplitudes = range(min(len(records) for records in self.choices))
        for place, is_equal_time in product(amplitudes, (True, False)):
            records = tuple(each[place] for each, wanted in zip(self.choices, self.is_wanted, strict=True) if wanted)
            periods = np.array([record.period for record in records])
            lengths = periods if is_equal_time else np.full(periods.size, periods.min())
            shares = np.geomspace(periods.min(), max(self.time, 1e-9), SHARES)[:, None]
            counts = np.maximum(np.rint(shares / lengths), 1).astype(int)
            plans = [Plan(records, tuple(each)) for each in counts.tolist()]
            fitting = [plan for plan in plans if plan.time <= self.time]
            if fitting:
                yield self._with_others(max(fitting, key=lambda plan: plan.time))

    def _with_others(self, plan: Plan) -> Plan:
        """Return the plan of wanted records with the others, which are not measured."""
        pairs, found = iter(zip(*plan, strict=True)), []
        for records, is_wanted in zip(self.choices, self.is_wanted, strict=True):
            found.append(next(pairs) if is_wanted else (records[0], 0))
        return Plan(*zip(*found, strict=True))

    def best(self) -> Plan | None:
        """Return the best plan to which exchanges lead from a plan of one amplitude; None without time."""
        found = [self._improved(plan) for plan in self._uniform_plans()]
        return min(found, key=self.criterion) if found else None

    def _improved(self, plan: Plan) -> Plan:
        """Return the plan to which exchanges lead from one."""
        while True:
            found = self._exchanged(self._with_best_amplitudes(plan))
            if self.criterion(plan) - self.criterion(found) < MIN_GAIN:
                return min((plan, found), key=self.criterion)
            plan = found

    def _with_best_amplitudes(self, plan: Plan) -> Plan:
        """Return the plan in which each record in turn has the amplitude that tells most in the same time."""
        for place, records in enumerate(self.choices):
            if plan.counts[place]:
                time = plan.records[place].time(plan.counts[place])
                options = [_with_record(plan, place, each, _count_within(each, time)) for each in records]
                plan = min([plan, *(o for o in options if o.counts[place])], key=self.criterion)
        return plan

    def _exchanged(self, plan: Plan) -> Plan:
        """Return the plan with time given to the records that make most of it, taken from one that needs it least."""
        before = self.criterion(plan)
        less = [
            option
            for place in range(len(plan.counts))
            for portions in ADDED_PORTIONS[:2]
            if (option := self._shorter(plan, place, portions)) is not None
        ]
        less.sort(key=lambda option: (self.criterion(option) - before) / (plan.time - option.time))
        return min([plan, *map(self._fill, [plan, *less[:MAX_TAKEN]])], key=self.criterion)

    def _fill(self, plan: Plan) -> Plan:
        """Return the plan whose time is used up, by what gains most for the time that it takes."""
        while True:
            before, time = self.criterion(plan), plan.time
            more = [option for place in range(len(plan.counts)) for option in self._longer(plan, place)]
            gains = [(before - self.criterion(o)) / (o.time - time) if o.time <= self.time else 0.0 for o in more]
            if max(gains, default=0.0) <= 0:
                return plan
            plan = more[int(np.argmax(gains))]

    def _longer(self, plan: Plan, place: int) -> Iterator[Plan]:
        record, count = plan.records[place], plan.counts[place]
        for each in (record,) if count else self.choices[place]:
            for portions in ADDED_PORTIONS if count <= self._portion(each) else (1,):
                yield _with_record(plan, place, each, count + portions * self._portion(each))

    def _shorter(self, plan: Plan, place: int, portions: int) -> Plan | None:
        record, count = plan.records[place], plan.counts[place]
        fewer = max(count - portions * self._portion(record), int(self.is_wanted[place]))
        return _with_record(plan, place, record, fewer) if fewer < count else None

    def _portion(self, record: PlannedRecord) -> int:
        return max(round(PORTION * self.time / record.period), 1)


def _with_record(plan: Plan, place: int, record: PlannedRecord, count: int) -> Plan:
    records, counts = list(plan.records), list(plan.counts)
    records[place], counts[place] = record, count
    return Plan(tuple(records), tuple(counts))


def _count_within(record: PlannedRecord, time: float) -> int:
    """Return the number of periods for which there is time [s]."""
    count = int((time - record.settled) / record.period + 1e-9)
    return count if count > 1 else int(record.time(1) <= time)


UNIFORM, DESIGNED = "uniform plan", "designed plan"


class ExcitationDesign(Estimator, name="excitation_design", version=6):
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
    they tell enough of friction. Periods that are repeated tell less the smaller the noise is compared with the
    encoder's step, as each is rounded alike; without noise they tell nothing new, and amplitudes alone are chosen.
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
        search = self._search(report)
        uniform, best = search.uniform(), search.best()
        if uniform is None or best is None:
            raise RecordError(
                f"excitation_design: a period of each frequency takes {search.shortest_time:.4g} s with settling; "
                f"measuring_time is {self.measuring_time:g} s: raise it, or leave frequencies out"
            )
        return self._with_plans(found, search, uniform, best)

    def _search(self, report: FitReport) -> PlanSearch:
        """Return what can be measured of the machine that was found, and for how long."""
        known = np.unique(np.concatenate([record.frequency for record in report.found.fit.records])).tolist()
        frequencies = (*known, *self.extra_frequencies)
        records = iter(self._plan_records(report, frequencies))
        choices = [tuple(next(records) for _ in self.amplitudes) for _ in frequencies]
        most = np.inf if self.max_stroke is None else self.max_stroke
        allowed = [tuple(each for each in of if each.stroke <= most) for of in choices]
        for frequency, of in zip(frequencies, allowed, strict=True):
            if not of and frequency in known:
                raise RecordError(
                    f"excitation_design: at {frequency:.4g} Hz the machine moves farther than max_stroke, ",
                    Quantity(self.max_stroke or 0.0, "m"),
                    ", with every amplitude: add smaller amplitudes",
                )
        is_wanted = [frequency in known for frequency in frequencies]
        kept = [pair for pair in zip(allowed, is_wanted, strict=True) if pair[0]]
        count = len(report.found.fit.free.friction)
        return PlanSearch(tuple(of for of, _ in kept), tuple(each for _, each in kept), count, self.measuring_time)

    def _plan_records(self, report: FitReport, frequencies: Sequence[float]) -> list[PlannedRecord]:
        """Return what a period of each frequency tells, at each amplitude, of the machine that was found."""
        assert isinstance(self.method, MaximumLikelihood)
        friction, models = report.found.friction, report.found.models
        if friction is None:
            raise RecordError(
                "excitation_design: the friction law has no parameters for the scales that were found; free others, or "
                "take a law such as rolling, Dahl, LuGre or GMS"
            )
        noise = report.found.fit.noise if report.noise is None else report.noise.value
        settings = ControlLoop.parse({**self.loop, "noise": noise}, "loop")
        sines = SineList(
            frequencies=tuple(np.repeat(frequencies, len(self.amplitudes)).tolist()),
            amplitudes=tuple(np.tile(self.amplitudes, len(frequencies)).tolist()),
        )
        sines.check(settings.sample_time)
        machine = Machine(models.plant, friction, self.controller, settings, Numerics())
        signals = simulate_loop(machine, sines, lambda _: None)
        if len(signals.segments) < len(sines.frequencies):
            raise RecordError(
                f"excitation_design: the preliminary machine diverges in its loop ({signals.message}): lower the "
                "amplitudes, or correct controller and loop"
            )
        method = self.method.model_copy(update={"input_dead_time": models.replay.input_path[0]})
        fit = RecordFit.around(method.problem(signals, noise, friction), models.plant)
        return planned_records(replace(fit, free=report.found.fit.free), sines.amplitudes)

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
        if round(ratio, 2) > 1:
            yield f"{parameter.name} {ratio:.2f} times"


def _plan_metrics(label: str, plan: Plan, parameters: Sequence[_PlannedParameter]) -> Iterator[Metric]:
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
