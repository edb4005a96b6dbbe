"""Feedback gains for an identified plant, with margins for all plants of its band and every amplitude.

Friction enters by its describing function over amplitude and frequency, and by the limit cycles that it predicts.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    Controller,
    Curve,
    Estimator,
    Finding,
    Fit,
    FrictionModel,
    Metric,
    Motion,
    ParameterError,
    Quantity,
    RecordError,
    Result,
    Signals,
    hold_response,
    image_factor,
    param,
    path_response,
)
from fraexp_plugins.controllers.notched_pid import NotchedPid
from fraexp_plugins.identification.modal_fit import ModalFit
from fraexp_plugins.positioning._shared.design_model import DesignModel
from fraexp_plugins.tuning._shared.gain_search import (
    GainSearch,
    LoopFamily,
    Margins,
    RequiredMargins,
    closed_loop_radius,
    damped_plant,
    rigid_gain,
)
from fraexp_plugins.tuning._shared.plant_band import plant_band, plant_of

POINTS = 256
"""Points of the sine along which a law is driven."""
PROBE_FREQUENCIES = 14
"""Frequencies at which a law is driven; between them the describing function is interpolated."""


def known_friction(method: Estimator, found: Result) -> FrictionModel | None:
    """Return the friction model that a method identified, or the one that it uses; None if it knows none."""
    fit = next((fit for fit in found.fits if fit.kind == FrictionModel.kind), None)
    if fit is None:
        used = getattr(method, "friction", None)
        return used if isinstance(used, FrictionModel) else None
    law = next(each for each in _subclasses(FrictionModel) if each.name == fit.component["name"])
    return law.parse({key: value for key, value in fit.component.items() if key not in ("name", "version")}, "friction")


def _subclasses(base: type[FrictionModel]) -> Iterator[type[FrictionModel]]:
    for each in base.__subclasses__():
        yield each
        yield from _subclasses(each)


@dataclass(frozen=True)
class FrictionGain:
    """N(A, ω) + jω Dv [N/m]: fundamental of the friction force over that of a sine of the displacement."""

    amplitudes: NDArray[np.float64]
    """Amplitudes of the displacement [m], ascending, shape (a,)."""
    frequencies: NDArray[np.float64]
    """Frequencies of the table [Hz], ascending, shape (f,)."""
    table: NDArray[np.complex128]
    """N [N/m], shape (f, a)."""
    viscous: float
    """Dv [N s/m]."""

    @classmethod
    def from_model(
        cls, friction: FrictionModel | None, amplitudes: NDArray[np.float64], low: float, high: float
    ) -> "FrictionGain":
        """Return the describing function of a model between two frequencies [Hz]; 0 without a model."""
        if friction is None:
            return cls(np.ones(1), np.array([low, high]), np.zeros((2, 1), dtype=complex), 0.0)
        frequencies = np.geomspace(low, high, PROBE_FREQUENCIES)
        angle = 2 * np.pi * np.arange(POINTS) / POINTS
        motions = [
            Motion(amplitude * np.cos(angle), 1 / (frequency * POINTS), True)
            for frequency in frequencies
            for amplitude in amplitudes
        ]
        forces = np.array(friction.forces(motions)).reshape(frequencies.size, amplitudes.size, POINTS)
        table = 2 / POINTS * (forces @ np.exp(-1j * angle)) / amplitudes
        return cls(amplitudes, frequencies, table, friction.viscous)

    def gain_at(self, frequency: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return N + jω Dv [N/m] at frequencies [Hz], shape (n, a)."""
        place = np.interp(np.log(frequency), np.log(self.frequencies), np.arange(self.frequencies.size))
        below = np.minimum(place.astype(int), self.frequencies.size - 2)
        share = (place - below)[:, None]
        law = (1 - share) * self.table[below] + share * self.table[below + 1]
        return np.asarray(law + 2j * np.pi * frequency[:, None] * self.viscous)

    def between(self, frequency: float, log_amplitude: float) -> complex:
        """Return N + jω Dv [N/m] at a frequency [Hz] and the logarithm of an amplitude."""
        row = self.gain_at(np.array([frequency]))[0]
        logs = np.log(self.amplitudes)
        return complex(np.interp(log_amplitude, logs, row.real) + 1j * np.interp(log_amplitude, logs, row.imag))


NEAR_ZERO = 0.5
"""Relative size of the loop's sum at a grid point from which a zero nearby is looked for."""
DERIVATIVE_STEP = 1e-3
"""Relative step of frequency and amplitude by which the sum's derivatives are found."""
ZERO_TOLERANCE = 1e-6
"""Relative size of the sum at a zero."""


@dataclass(frozen=True)
class LimitCycle:
    """A sustained oscillation of the displacement."""

    amplitude: float
    """Amplitude [m]."""
    frequency: float
    """Frequency [Hz]."""
    is_stable: bool
    """Whether the loop returns to it; if not, it grows from above and decays from below."""


def limit_cycles(family: LoopFamily, friction: FrictionGain, control: NDArray[np.complex128]) -> list[LimitCycle]:
    """Return the limit cycles of the nominal plant, by frequency: 1/P + N(A, ω) + C G = 0.

    J. M. Loeb's criterion says which are stable (A. Gelb and W. E. Vander Velde, Multiple-Input Describing Functions,
    1968, section 3.3).
    """
    linear = 1 / family.band.nominal + control
    total = linear[:, None] + family.friction
    size = np.abs(linear)[:, None] + np.abs(family.friction)
    relative = np.abs(total) / size
    found: list[LimitCycle] = []
    for row, column in _minima(relative):
        cycle = _solve(family.band.frequency, linear, friction, row, column)
        if cycle and not any(_is_same(cycle, other) for other in found):
            found.append(cycle)
    return sorted(found, key=lambda cycle: cycle.frequency)


def _minima(values: NDArray[np.float64]) -> Iterator[tuple[int, int]]:
    """Yield the places inside of a grid that are no greater than their neighbours, and small."""
    inner = values[1:-1, 1:-1]
    around = [
        values[1 + i : values.shape[0] - 1 + i, 1 + j : values.shape[1] - 1 + j]
        for i in (-1, 0, 1)
        for j in (-1, 0, 1)
        if i or j
    ]
    is_least = np.logical_and.reduce([inner <= other for other in around]) & (inner < NEAR_ZERO)
    for row, column in np.argwhere(is_least):
        yield int(row) + 1, int(column) + 1


def _solve(
    frequency: NDArray[np.float64], linear: NDArray[np.complex128], friction: FrictionGain, row: int, column: int
) -> LimitCycle | None:
    """Return the limit cycle near a place of the grid, or None if there is none."""
    from scipy.optimize import root

    logs = np.log(frequency)
    scale = abs(linear[row]) + abs(friction.between(frequency[row], np.log(friction.amplitudes[column])))

    def total(point: NDArray[np.float64]) -> complex:
        here = complex(np.interp(point[0], logs, linear.real) + 1j * np.interp(point[0], logs, linear.imag))
        return here + friction.between(float(np.exp(point[0])), float(point[1]))

    def parts(point: NDArray[np.float64]) -> NDArray[np.float64]:
        value = total(point) / scale
        return np.array([value.real, value.imag])

    start = np.array([logs[row], np.log(friction.amplitudes[column])])
    solution = root(parts, start, method="hybr")
    point = solution.x
    bounds = (logs[0], logs[-1]), (np.log(friction.amplitudes[0]), np.log(friction.amplitudes[-1]))
    is_inside = all(low < value < high for value, (low, high) in zip(point, bounds, strict=True))
    if not is_inside or np.hypot(*parts(point)) > ZERO_TOLERANCE:
        return None
    by_frequency, by_amplitude = (total(point + step) - total(point - step) for step in DERIVATIVE_STEP * np.eye(2))
    # a change of amplitude moves the root s = σ + jω of the sum by dσ = Im(∂N/∂A / ∂F/∂ω) dA
    return LimitCycle(float(np.exp(point[1])), float(np.exp(point[0])), (by_amplitude / by_frequency).imag < 0)


def _is_same(first: LimitCycle, second: LimitCycle) -> bool:
    return bool(np.allclose([first.amplitude, first.frequency], [second.amplitude, second.frequency], rtol=1e-3))


IDENTIFIED_DEAD_TIME = "input_dead_time"
"""Metric by which a method says the dead time that it has identified: all of it."""
IDENTIFIED_LAG = "input_time_constant"
"""Metric of a lag before the plant that a method has identified beside those that it knew."""
DELAYS = ("input_dead_time", "input_time_constants", "output_dead_time", "output_time_constants")


class _LoopPath(NamedTuple):
    """What lies between the controller and the plant, and back."""

    sample_time: float
    """Sample time of the controller [s]."""
    dead_time: float
    """Dead time of both directions [s]."""
    input_time_constants: tuple[float, ...]
    """Of the lags before the plant [s]."""
    output_time_constants: tuple[float, ...]
    """Of the lags behind it [s]."""

    @classmethod
    def of_loop(cls, stated: Estimator, signals: Signals, found: Result, fit: Fit) -> "_LoopPath":
        """Return the path that a tuning estimator states, and what it leaves open as its method knows or found it.

        Of the dead time that is stated and the one that is known the greater counts. Raises RecordError if no sample
        time is stated for a response that has none.
        """
        given = {name: getattr(stated, name) for name in ("sample_time", *DELAYS)}
        if given["sample_time"] is None:
            if signals.are_stated:
                raise RecordError(
                    f"{stated.name}: the response has no sample time; expected {stated.name}.sample_time, that of the "
                    "controller: --set sample_time=0.001"
                )
            given["sample_time"] = signals.segments[0].sample_time
        method = innermost_method(stated)
        known = {name: getattr(method, name, None) for name in DELAYS}
        late = dict(zip(fit.parameters, fit.values.tolist(), strict=True)).get("dead_time", 0.0)
        identified = {metric.name: metric.value for metric in found.metrics}
        before = identified.get(IDENTIFIED_DEAD_TIME, known["input_dead_time"] or 0.0)
        if (lag := identified.get(IDENTIFIED_LAG)) is not None:
            known["input_time_constants"] = (*(known["input_time_constants"] or ()), lag)
        lags = [given[name] if given[name] is not None else known[name] or () for name in DELAYS[1::2]]
        return cls(
            given["sample_time"],
            max(
                (given["input_dead_time"] or 0.0) + (given["output_dead_time"] or 0.0),
                before + (known["output_dead_time"] or 0.0) + max(late, 0.0),
            ),
            *lags,
        )


def innermost_method(estimator: Estimator) -> Estimator:
    """Return the estimator of the response that others fit."""
    while isinstance(method := getattr(estimator, "method", None), Estimator):
        estimator = method
    return estimator


FREQUENCIES = 500
"""Frequencies at which loops are examined; more are added around the modes."""
MODE_POINTS = 61
MODE_SPAN = 0.25
"""Relative distance from a mode up to which frequencies are added."""
AMPLITUDES = 72
PLANT_RELATIVE_DEGREE = 2


class LoopTuning(Estimator, name="loop_tuning", version=3):
    """PID gains with notches such that every plant of the band keeps the margins, at every amplitude of friction.

    The loop is C G P/(1 + P N): N(A, ω) is the friction model's describing function (A. Gelb and W. E. Vander Velde,
    Multiple-Input Describing Functions, 1968), G are hold and delays. In 1/P + N + C G all of it is a sum; the band of
    the plant becomes a disc of 1/P at each frequency, so that margins have closed forms. If the disc of the sum does
    not contain 0 for any frequency and amplitude, and the nominal loop is stable, all loops are stable: the zero
    exclusion principle (J. Ackermann, Robust Control, 1993). The band consists of the 95 % ellipsoid of the fitted
    plant, of what the response differs from it by beyond noise, and of `model_error`; with `band` = response of the
    response's own 95 % band too.

    Of the controllers that keep the margins the result is the one that is stiffest against slow disturbances: with the
    greatest Kp/Ti, or Kp without integral action. Metrics and curves show the given controller and the tuned one, and
    the limit cycles that friction causes by the describing function: a first harmonic approximation, which is good
    where the plant attenuates the others. Feedforward follows from the same fit: mass and viscous coefficient are
    metrics, friction is the model.

    Without `[loop]`, as of a record, friction, dead times and lags are those that `method` knows or identifies. A
    greater dead time that is stated counts instead of it, a smaller one does not.
    """

    fits: ClassVar[str] = "controller"
    takes_responses: ClassVar[bool] = True

    method: Estimator = param("", "estimator of the plant, or of a response to which modes are fitted")
    friction: FrictionModel | None = param(
        "", "friction model of the machine; that of the method if not given", None, inherit="friction"
    )
    controller: Controller | None = param("", "controller to compare with", None, inherit="controller")
    sample_time: float | None = param(
        "s", "sample time of the controller; that of the record if not given", None, above=0, inherit="loop.sample_time"
    )
    input_dead_time: float | None = param("s", "dead time in G_di", None, at_least=0, inherit="loop.input_dead_time")
    input_time_constants: tuple[float, ...] | None = param(
        "s", "time constants of first-order lags in G_di", None, inherit="loop.input_time_constants"
    )
    output_dead_time: float | None = param("s", "dead time in G_do", None, at_least=0, inherit="loop.output_dead_time")
    output_time_constants: tuple[float, ...] | None = param(
        "s", "time constants of first-order lags in G_do", None, inherit="loop.output_time_constants"
    )
    integral_action: bool = param("", "whether the controller has an integral time", True)
    modulus_margin: float = param("1", "least distance of the loop from -1, 1/max|S|", 0.5, above=0, below=1)
    gain_margin: float = param("1", "least factor up to which the gain may rise", 2.0, at_least=1, at_most=20)
    phase_margin: float = param("rad", "least phase lag that may be added", math.pi / 6, at_least=0, at_most=1.4)
    model_error: float = param("1", "relative error of the plant that is allowed for everywhere", 0.02, at_least=0)
    band: Literal["fit", "response"] = param(
        "", "plants that keep the margins: those of the fit's band, or of the response's too", "fit"
    )
    min_amplitude: float = param("m", "smallest amplitude of the describing function", 1e-8, above=0)
    max_amplitude: float = param("m", "greatest amplitude of the describing function", 1e-2, above=0)

    def model_post_init(self, context: object) -> None:
        """Check that amplitudes and errors leave something to tune."""
        if self.max_amplitude <= self.min_amplitude:
            raise ParameterError(
                "loop_tuning.max_amplitude is ",
                Quantity(self.max_amplitude, "m"),
                "; expected more than min_amplitude, ",
                Quantity(self.min_amplitude, "m"),
            )
        if self.model_error >= 1:
            raise ParameterError(f"loop_tuning.model_error is {self.model_error:g}; expected less than 1")

    def estimate(self, signals: Signals) -> Result:
        """Return what `method` finds, the tuned controller, margins before and after, and limit cycles."""
        found = self.method.estimate(signals)
        if found.response is None:
            return found
        fit = next((each for each in found.fits if each.kind == "plant"), None)
        if fit is None:
            fitted = ModalFit(method=self.method).fit_response(found.response)
            (fit,) = fitted.fits
            found = replace(found.with_findings(*fitted.findings), fits=(*found.fits, fit))
        loop = _Loop.from_fit(self, fit, found, _LoopPath.of_loop(self, signals, found, fit))
        tuned = loop.search(self).best()
        if tuned is None:
            raise RecordError(self._refusal(loop))
        before = self._curves(loop, self.controller, "given loop") if self.controller else ()
        return replace(
            found,
            findings=(*found.findings, *self._remarks(loop, tuned)),
            metrics=(*self._metrics(loop, tuned, fit), *found.metrics),
            curves=(*before, *self._curves(loop, tuned, "tuned loop"), *found.curves),
            fits=(*found.fits, _controller_fit(tuned)),
        )

    def _refusal(self, loop: "_Loop") -> str:
        advice = "narrow the band by a longer record, or lower the margins"
        if self.integral_action:
            advice += ", or set integral_action = false: with it friction may cause limit cycles at any gain"
        widest = float((loop.family.band.radius / np.abs(loop.family.band.nominal)).max())
        margins = (
            f"a modulus margin of {self.modulus_margin:g}, a gain margin of {self.gain_margin:g} and a phase margin of "
            f"{math.degrees(self.phase_margin):.3g}°"
        )
        return (
            f"loop_tuning: no controller keeps {margins} for all plants of the band, whose radius is up to "
            f"{widest:.2g} of the plant; {advice}"
        )

    def _remarks(self, loop: "_Loop", tuned: NotchedPid) -> Iterator[Finding]:
        for name, controller in (("given", self.controller), ("tuned", tuned)):
            if controller is None:
                continue
            if not loop.is_stable(controller):
                yield Finding("remark", text=f"the {name} loop is unstable without friction")
            for cycle in loop.limit_cycles(controller):
                kind = "a limit cycle" if cycle.is_stable else "an unstable limit cycle"
                size = Quantity(cycle.amplitude, "m", "amplitude", cycle.frequency)
                yield Finding("remark", (size,), text=f"the {name} loop has {kind} by friction")

    def _metrics(self, loop: "_Loop", tuned: NotchedPid, fit: Fit) -> Iterator[Metric]:
        for prefix, controller in (("", tuned), ("given ", self.controller)):
            if controller is None:
                continue
            margins = loop.margins(controller)
            yield Metric(f"{prefix}modulus margin", margins.modulus, "1")
            yield Metric(f"{prefix}gain margin", margins.gain, "1")
            yield Metric(f"{prefix}gain reduction margin", margins.gain_reduction, "1")
            yield Metric(f"{prefix}phase margin", math.degrees(margins.phase), "deg")
            stable = [cycle for cycle in loop.limit_cycles(controller) if cycle.is_stable]
            for cycle in stable[:1]:
                yield Metric(f"{prefix}limit cycle amplitude", cycle.amplitude, "m")
                yield Metric(f"{prefix}limit cycle frequency", cycle.frequency, "Hz")
        gain = plant_of(fit, fit.values)[0].rigid_body_gain
        yield Metric("mass feedforward", 1 / gain, "kg")
        yield Metric("viscous feedforward", loop.friction.viscous, "N s/m")
        yield Metric("loop sample time", loop.path.sample_time, "s")
        yield Metric("loop dead time", loop.path.dead_time, "s")

    def _curves(self, loop: "_Loop", controller: Controller, name: str) -> tuple[Curve, ...]:
        sensitivity = loop.family.sensitivity(loop.family.control(controller))
        largest = np.where(np.isfinite(sensitivity), sensitivity, np.nan).max(axis=1)  # a gap where it may be unstable
        over_frequency = {"frequency": loop.family.band.frequency, "largest sensitivity": largest}
        over_amplitude = {"amplitude": loop.friction.amplitudes, "modulus margin": 1 / sensitivity.max(axis=0)}
        return (
            Curve(name, over_frequency, {"frequency": "Hz", "largest sensitivity": "1"}),
            Curve(name, over_amplitude, {"amplitude": "m", "modulus margin": "1"}),
        )


@dataclass(frozen=True)
class _Loop:
    """The family of loops around an identified plant."""

    family: LoopFamily
    friction: FrictionGain
    model: DesignModel
    modes: tuple[float, ...]
    path: _LoopPath

    @classmethod
    def from_fit(cls, tuning: LoopTuning, fit: Fit, found: Result, path: _LoopPath) -> "_Loop":
        plant, _ = plant_of(fit, fit.values)
        assert found.response is not None
        nyquist = 0.5 / path.sample_time
        modes = tuple(frequency for frequency in plant.frequencies if frequency < 0.9 * nyquist)
        frequency = _frequencies(nyquist, modes)
        omega, lags = 2 * np.pi * frequency, (*path.input_time_constants, *path.output_time_constants)
        delays = path_response(omega, path.dead_time, lags) * hold_response(omega, path.sample_time)
        delays = delays * image_factor(omega, path.sample_time, path.dead_time, lags, PLANT_RELATIVE_DEGREE)
        amplitudes = np.geomspace(tuning.min_amplitude, tuning.max_amplitude, AMPLITUDES)
        model = tuning.friction or known_friction(innermost_method(tuning), found)
        friction = FrictionGain.from_model(model, amplitudes, frequency[0], frequency[-1])
        band = plant_band(fit, found.response, frequency, tuning.model_error, tuning.band == "response")
        design = DesignModel.from_plant(
            damped_plant(plant, friction.viscous),
            path.sample_time,
            path.dead_time,
            path.input_time_constants,
            path.output_time_constants,
        )
        family = LoopFamily(band, friction.gain_at(frequency), delays, path.sample_time)
        return cls(family, friction, design, modes, path)

    def search(self, tuning: LoopTuning) -> GainSearch:
        """Return the search for the stiffest controller."""
        wanted = RequiredMargins(tuning.modulus_margin, tuning.gain_margin, tuning.phase_margin)
        gain = rigid_gain(self.family.band.nominal, self.family.band.frequency)
        return GainSearch(self.family, self.model, gain, wanted, self.modes, tuning.integral_action)

    def margins(self, controller: Controller) -> Margins:
        """Return the margins of all loops; none if the nominal one is unstable."""
        if not self.is_stable(controller):
            return Margins(0.0, 1.0, 1.0, 0.0)
        return self.family.margins(self.family.control(controller))

    def is_stable(self, controller: Controller) -> bool:
        """Return whether the nominal loop without friction is stable."""
        return closed_loop_radius(self.model, controller) < 1.0

    def limit_cycles(self, controller: Controller) -> list[LimitCycle]:
        """Return the limit cycles of the nominal plant."""
        return limit_cycles(self.family, self.friction, self.family.control(controller))


def _frequencies(nyquist: float, modes: tuple[float, ...]) -> NDArray[np.float64]:
    """Return frequencies up to the Nyquist frequency [Hz], closer to each other around the modes."""
    near = [mode * np.linspace(1 - MODE_SPAN, 1 + MODE_SPAN, MODE_POINTS) for mode in modes]
    found = np.concatenate([np.geomspace(1e-4 * nyquist, 0.999 * nyquist, FREQUENCIES), *near])
    return np.unique(found[found < nyquist])


def _controller_fit(controller: NotchedPid) -> Fit:
    names = ("proportional", "integral_time", "derivative_time", "filter_time")
    values = np.array([getattr(controller, name) for name in names])
    return Fit("controller", controller.spec(), names, ("N/m", "s", "s", "s"), values, np.zeros((4, 4)))
