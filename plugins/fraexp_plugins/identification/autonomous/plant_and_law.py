"""Plant and friction of a machine of which nothing is known, whatever its friction law."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from fraexp.api import (
    Finding,
    FrequencyResponse,
    FrictionModel,
    Metric,
    Outcome,
    RecordError,
    Result,
    Signals,
    param,
    remarks,
)
from fraexp_plugins.estimators._shared.delayed_estimator import DelayedEstimator
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.friction.none import Frictionless
from fraexp_plugins.identification._shared.friction_curves import virgin_curve
from fraexp_plugins.identification._shared.usable_records import usable_signals
from fraexp_plugins.identification.autonomous._autonomous_lines import (
    ElementObserver,
    SpectralLines,
    delayed_lines,
    remove_drift,
    scatter_noise,
    spectral_lines,
)
from fraexp_plugins.identification.autonomous._autonomous_plant import (
    IdentifiedPlant,
    InverseResponse,
    identify_plant,
    plant_cost,
    response_of,
)
from fraexp_plugins.identification.autonomous._law_choice import choose_law
from fraexp_plugins.identification.autonomous._law_fit import (
    MAX_PLANT_COST,
    FittedLaw,
    LawReport,
    fit_law,
    rough_inverse,
)
from fraexp_plugins.identification.autonomous._law_records import LawRecords
from fraexp_plugins.identification.plant.modal_fit import ModalFit
from fraexp_plugins.plants.modal import Modal

MIN_LINES, MIN_EQUATIONS = 8, 24
"""Fewest frequencies, and real equations beyond one response each, from which a friction force can be chosen."""
MAX_LINE_SCATTER = 0.1
"""Relative scatter of P̂ over the amplitudes up to which a frequency counts for the plant."""
PLANT_MODEL_ERROR, MIN_PLANT_MODEL_ERROR = 3e-3, 3e-4
"""Relative error of P̂ by friction that the plant's fit allows for, and the least one if the fit leaves less."""
MAX_DEAD_TIME_STEPS, DEAD_TIME_TOLERANCE = 4, 5e-3
"""Fits of the dead time, each with the friction of the one before, and the step [samples] that is the last one."""
DEAD_TIME_RANGE, NEAR_DEAD_TIME_RANGE, MAX_DEAD_TIME_TRIALS, NO_PLANT_COST = 0.4, 0.1, 12, 1e6
"""Distance from a rough dead time in which the dead time is looked for [samples], the same from one with which a plant
explains P̂, how many are tried at most, and the cost where no plant fits."""
CURVE_POINTS, CURVE_RANGE = 60, (1e-5, 0.5)
"""Points of the virgin curve, and their range over the largest motion."""


class PlantAndLaw(DelayedEstimator, name="plant_and_law", version=11):
    """P̂, plant, friction force and dead time from records at several amplitudes; the friction law need not be known.

    Each friction law that fraexp has, and those of `laws`, are driven by the measured motion, with sizes and shape
    parameters that leave least of G_di G_do U_a = Y_a/P + F_a for each record a, at the excited line and at its odd
    harmonics, with a 1/P for each line. Sizes are eliminated (variable projection: G. H. Golub and V. Pereyra, SIAM
    J. Numerical Analysis 10(2), 1973, doi 10.1137/0710036); elements of unknown number are sizes >= 0 on a grid of
    thresholds (C. L. Lawson and R. J. Hanson, Solving Least Squares Problems, 1974, ch. 23, doi
    10.1137/1.9781611971217). The law with the smallest residual is taken, with a verdict that is not ok if noise and
    rounding do not explain that residual.

    A rigid body with modes and viscous friction is then fitted to P̂ as `modal_fit` does, and with it the dead time.
    With `validation` the last segments are held out: the metric `validation error` is the part of their control input
    that the identified plant and friction do not explain along the measured motion.

    The interval of the Coulomb force is that of all laws that leave as little as the best one, or of the first law that
    noise explains. Friction that weakens only above the largest velocity that was measured, or much later than half a
    period of the lowest frequency, counts as Coulomb force. An element that slips in hardly any record is a spring in
    the others; a law is judged with the plant as a free body at the lowest frequencies, unless they contradict it.
    The widest elements are left out where the law leaves hardly more without them.

    The verdict is 1 if a law explains the records, the plant explains P̂, the validation error is not above
    `validation_tolerance`, and the 95 % intervals are within 1 % for k0, 0.2 Hz for f1 and 3 % for ΣF_m. Otherwise it
    is 0, the outcome is inaccurate, and the message gives the reason.

    It needs three amplitudes or more at each of some fifteen frequencies, from nearly still to gross sliding, as
    `fraexp measure --autonomous` records them. Do not use it for friction that depends on the position.
    """

    laws: tuple[FrictionModel, ...] = param(
        "", "further friction laws that are tried, your own ones, each with numbers from which a search may begin", ()
    )
    estimate_dead_time: bool = param("", "whether dead time is estimated, in addition to `input_dead_time`", True)
    resolution: float = param("m", "quantisation step of the encoder", 0.0, at_least=0, inherit="loop.resolution")
    noise: float = param("m", "standard deviation of the encoder's noise", 0.0, at_least=0, inherit="loop.noise")
    oversampling: int = param("1", "points per sample at which the motion drives friction", 4, at_least=1, at_most=64)
    model_error: float = param("1", "relative error of the thrust that is allowed for besides noise", 1e-3, above=0)
    modes: int | None = param(
        "1", "modes of the plant; chosen by an information criterion if not given", None, at_least=0
    )
    validation: int = param("1", "how many of the last segments are predicted instead of fitted", 0, at_least=0)
    validation_tolerance: float = param("1", "validation error that is acceptable", 0.03, above=0)

    expected_failures = dict.fromkeys(
        ("linear-plant", "result-units", "covariance", "outcome"),
        "It refuses a stepped sine at one amplitude, with which it is tried here.",
    )

    def estimate(self, signals: Signals) -> Result:
        """Return P̂ with its band, plant and friction, dead time, validation error and verdict."""
        signals.unit(self.input), signals.unit(self.output)
        if not signals.segments:
            return Result(signals.outcome, signals.findings)
        signals = remove_drift(signals, self.output)
        count = len(signals.segments) - self.validation
        fresh = replace(signals, segments=signals.segments[count:])
        used = usable_signals(replace(signals, segments=signals.segments[:count]), self.output, self.name)
        found = self._fit_law(used)
        plant, remark = self._plant(used, found)
        plant = self._plant_by_residuals(used, found, plant)
        doubt = "" if found.choice.best.explains else found.choice.doubt()
        return self._result(used, found, plant, (remark, doubt), self._validation_error(fresh, found, plant))

    def _observer(self) -> ElementObserver:
        names = set(ElementObserver.model_fields) & set(type(self).model_fields)
        return ElementObserver(friction=Frictionless(), **{name: getattr(self, name) for name in names})

    def _bare_lines(self, signals: Signals) -> SpectralLines:
        """Return the lines of the records without forces; RecordError if they are too few for a friction force."""
        bare = spectral_lines(signals, self._observer())
        if len(bare.frequency) < MIN_LINES or bare.equations < MIN_EQUATIONS:
            raise RecordError(
                f"plant_and_law: {bare.frequency.size} frequencies give {bare.equations} equations for "
                f"friction; expected {MIN_LINES} frequencies and {MIN_EQUATIONS} equations or more: record each "
                "frequency at three amplitudes"
            )
        return bare

    def _settle_dead_time(self, signals: Signals, fit: Callable[[float], FittedLaw], dead_time: float) -> FittedLaw:
        """Return the fit with the dead time [s] that is left in P̂ no more, from one on."""
        found = fit(dead_time)
        for _ in range(MAX_DEAD_TIME_STEPS if self.estimate_dead_time else 0):
            step = self._dead_time_in(signals, found)
            found = fit(max(found.dead_time + step, 0.0))
            if abs(step) < DEAD_TIME_TOLERANCE * signals.segments[0].sample_time:
                break
        return found

    def _fit_law(self, signals: Signals) -> FittedLaw:
        """Return the fit of the law with the smallest residual."""
        observer = self._observer()
        bare = self._bare_lines(signals)
        inverse = rough_inverse(bare)
        rough = bare.frequency, inverse
        choice = choose_law(signals, observer, rough, self.estimate_dead_time, self.laws)
        records, best = LawRecords.at_lines(signals, observer, rough), choice.best
        lines = replace(records.lines, deflection=records.deflection(best.elements))
        variance = scatter_noise(signals, lines, observer, inverse) + self.model_error**2 * np.abs(lines.thrust) ** 2
        variance += records.friction_noise(best.elements, best.sizes)
        fit = partial(fit_law, choice, lines, variance)
        if not self.estimate_dead_time:
            return fit(choice.best.dead_time)
        settled = self._settle_dead_time(signals, fit, choice.best.dead_time).dead_time
        return fit(self._refine_dead_time(signals, fit, (settled, choice.best.dead_time)))

    def _refine_dead_time(
        self, signals: Signals, fit: Callable[[float], FittedLaw], starts: tuple[float, float]
    ) -> float:
        """Return the dead time [s] near the better of two with which a rigid body with modes leaves least of P̂.

        With much viscous friction a delay looks like mass, so that one which is taken from a fit with too few modes
        makes k0 wrong. The sum of squares has sharp minima, with the modes found anew at each dead time. The one that
        the law has found does not depend on the plant, which may have a mode at the end of the frequency range.
        """
        from scipy.optimize import minimize_scalar  # slow to import: only when something is estimated

        def cost(delay: float) -> float:
            plant, _ = self._plant(signals, fit(delay))
            return plant_cost(plant) if isinstance(plant, IdentifiedPlant) else NO_PLANT_COST

        sample_time, costs = signals.segments[0].sample_time, [cost(start) for start in starts]
        least, dead_time = min(zip(costs, starts, strict=True))
        reach = (NEAR_DEAD_TIME_RANGE if least <= MAX_PLANT_COST else DEAD_TIME_RANGE) * sample_time
        low, high = max(dead_time - reach, 0.0), dead_time + reach
        options = {"xatol": DEAD_TIME_TOLERANCE * sample_time, "maxiter": MAX_DEAD_TIME_TRIALS}
        found = minimize_scalar(
            lambda delay: np.log(cost(delay)), bounds=(low, high), method="bounded", options=options
        )
        return float(found.x) if found.fun <= np.log(least) else dead_time

    def _dead_time_in(self, signals: Signals, found: FittedLaw) -> float:
        """Return the dead time [s] that is left in P̂; 0 if no plant fits."""
        _, response = self._inverse(signals, found)
        modal = self._modal().model_copy(update={"dead_time": None, "fit_viscous": True})
        try:
            with np.errstate(all="ignore"):
                (fit,) = modal.fit_response(response).fits
        except RecordError:
            return 0.0
        return float(fit.values[fit.parameters.index("dead_time")])

    def _modal(self, modes: int | None = None, model_error: float = PLANT_MODEL_ERROR) -> ModalFit:
        modes = self.modes if modes is None else modes
        return ModalFit(method=Conventional(), modes=modes, dead_time=0.0, model_error=model_error)

    def _inverse(self, signals: Signals, found: FittedLaw) -> tuple[InverseResponse, FrequencyResponse]:
        """Return 1/P̂ with its errors, and P̂ at the frequencies that count for the plant as settled ones."""
        result, inverse = self._response(signals, found)
        assert result.response is not None
        is_known = found.scatter <= MAX_LINE_SCATTER
        return inverse, replace(result.response, settled=result.response.settled & is_known)

    def _plant(self, signals: Signals, found: FittedLaw) -> tuple[IdentifiedPlant | Result, str]:
        """Return the plant in P̂, or P̂ alone with the reason."""
        inverse, usable = self._inverse(signals, found)
        if (found.scatter > MAX_LINE_SCATTER).all():
            remark = (
                f"no plant identified: the records at several amplitudes differ by more than {MAX_LINE_SCATTER:.0%} in "
                f"their plant at all {usable.frequency.size} frequencies"
            )
            return self._response(signals, found)[0], remark
        try:
            with np.errstate(all="ignore"):  # where nothing is identifiable
                return identify_plant(inverse, usable, self._modal()), ""
        except RecordError as error:
            return self._response(signals, found)[0], f"no plant identified: {error}"

    def _plant_by_residuals(
        self, signals: Signals, found: FittedLaw, plant: IdentifiedPlant | Result
    ) -> IdentifiedPlant | Result:
        """Return the plant with the errors that it leaves of P̂, if these are smaller than what was allowed for."""
        if isinstance(plant, Result) or plant_cost(plant) >= 1:
            return plant
        model_error = max(PLANT_MODEL_ERROR * float(np.sqrt(plant_cost(plant))), MIN_PLANT_MODEL_ERROR)
        modes = len(plant.fit.fits[0].component["frequencies"])
        inverse, usable = self._inverse(signals, found)
        try:
            with np.errstate(all="ignore"):
                return identify_plant(inverse, usable, self._modal(modes, model_error))
        except RecordError:  # what such small errors do not determine
            return plant

    def _response(self, signals: Signals, found: FittedLaw) -> tuple[Result, InverseResponse]:
        """Return P̂ before linear forces are removed, and its inverse."""
        return response_of(signals, (self.input, self.output), found.lines, found.elements)

    def _validation_error(self, fresh: Signals, found: FittedLaw, plant: IdentifiedPlant | Result) -> float | None:
        """Return the part of the thrust in fresh records that plant and friction do not explain; None without any."""
        if not fresh.segments or isinstance(plant, Result):
            return None
        rough = found.lines.frequency, found.elements.inverse
        records = LawRecords.at_lines(fresh, self._observer(), rough)
        lines = replace(records.lines, deflection=records.deflection(found.law))
        lines = delayed_lines(lines, found.dead_time)
        omega = 2 * np.pi * lines.frequency
        (fit,) = plant.fit.fits
        modal = Modal.parse(
            {key: value for key, value in fit.component.items() if key not in ("name", "version")}, "plant"
        )
        inverse = 1 / modal.response(omega) + 1j * omega * plant.viscous + plant.spring
        left = lines.thrust - lines.deflection @ found.elements.stiffness - inverse[:, None] * lines.motion
        power = np.abs(lines.thrust[lines.known]) ** 2
        return float(np.sqrt(np.sum(np.abs(left[lines.known]) ** 2) / np.sum(power)))

    def _result(
        self,
        signals: Signals,
        found: FittedLaw,
        plant: IdentifiedPlant | Result,
        causes: tuple[str, str],
        error: float | None,
    ) -> Result:
        """Return all that was found, with the verdict."""
        fitted = plant.fit if isinstance(plant, IdentifiedPlant) else plant
        report = LawReport(found, plant, self.input_dead_time)
        remark, of_law = causes
        doubts: list[Finding | str] = [remark] if remark else [*report.doubts()]
        doubts += [of_law] if of_law else []
        if self.validation and not remark and (error is None or error > self.validation_tolerance):
            share = "no fresh record" if error is None else f"{error:.1%} of the control input of fresh records"
            doubts.append(
                f"plant and friction leave {share} unexplained; expected {self.validation_tolerance:.1%} or less: "
                "friction may depend on the position, or limits allow too little motion"
            )
        verdict = Metric("verdict", float(not doubts), "1")
        explained = Metric("friction law", float(not of_law), "1")
        validation = () if error is None else (Metric("validation error", error, "1"),)
        size = max(float(np.ptp(segment.channels[self.output])) for segment in signals.segments) / 2
        x = size * np.geomspace(*CURVE_RANGE, CURVE_POINTS)
        return replace(
            fitted,
            outcome=Outcome.INACCURATE if doubts and fitted.outcome is Outcome.OK else fitted.outcome,
            findings=remarks(*doubts) or (report.summary(),),
            metrics=(verdict, *fitted.metrics[:2], explained, *report.metrics(), *validation, *fitted.metrics[2:]),
            curves=(virgin_curve(x, *found.virgin_curve(x)), *fitted.curves),
            fits=(*fitted.fits, report.friction()),
        )
