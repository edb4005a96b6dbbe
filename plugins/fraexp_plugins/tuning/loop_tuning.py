"""Feedback gains for an identified plant, with margins for all plants of its band and every amplitude."""

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
from fraexp_plugins.tuning._shared.friction_gain import FrictionGain, LimitCycle, known_friction, limit_cycles
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

IDENTIFIED_DEAD_TIME = "input_dead_time"
"""Metric by which a method says the dead time that it has identified: all of it."""
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
        identified = {metric.name: metric.value for metric in found.metrics}.get(IDENTIFIED_DEAD_TIME)
        before = known["input_dead_time"] or 0.0 if identified is None else identified
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
        over_frequency = {
            "frequency": loop.family.band.frequency,
            "largest sensitivity": _finite(sensitivity.max(axis=1)),
        }
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


def _finite(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return values with a gap where a loop may be unstable."""
    return np.where(np.isfinite(values), values, np.nan)


def _controller_fit(controller: NotchedPid) -> Fit:
    names = ("proportional", "integral_time", "derivative_time", "filter_time")
    values = np.array([getattr(controller, name) for name in names])
    return Fit("controller", controller.spec(), names, ("N/m", "s", "s", "s"), values, np.zeros((4, 4)))
