"""Plant and friction together from records at several amplitudes, without any known friction parameter."""

from contextlib import suppress
from dataclasses import replace
from typing import Literal

import numpy as np

from fraexp.api import (
    CONVERGED,
    MAX_ITERATIONS,
    Finding,
    FrictionModel,
    Metric,
    Outcome,
    ParameterError,
    Quantity,
    RecordError,
    Result,
    Signals,
    param,
)
from fraexp_plugins.estimators._shared.delayed_estimator import DelayedEstimator
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.friction.none import Frictionless
from fraexp_plugins.identification._law_forces import unit_law
from fraexp_plugins.identification._law_report import IdentifiedPlant, LawChoice, LawReport, identify_plant
from fraexp_plugins.identification._law_selection import LawSelection
from fraexp_plugins.identification._line_records import LineRecords, remove_drift
from fraexp_plugins.identification._usable_records import FORCE_FLOOR, MAX_NOISE_RATIO, MIN_SIZE_RATIO, usable_signals
from fraexp_plugins.identification.modal_fit import ModalFit
from fraexp_plugins.plants.modal import Modal

MAX_LINE_SCATTER = 0.1
"""Relative scatter of P̂ over the amplitudes up to which a frequency counts for the plant."""


class PlantAndFriction(DelayedEstimator, name="plant_and_friction", version=12):
    """Friction, P̂ and the plant of eq (1) together, such that P̂ is the same at all amplitudes and phases.

    G_di G_do U_a = Y_a/P + F_a for each record a, at each excited line, with a 1/P of its own, and at the odd harmonics
    of sines, where friction alone acts. The measured motion drives a law; forces that leave least are >= 0 and linear
    in their sizes, which are eliminated (variable projection: G. H. Golub and V. Pereyra, SIAM J. Numerical Analysis
    10(2), 1973, doi 10.1137/0710036; C. L. Lawson and R. J. Hanson, Solving Least Squares Problems, 1974, ch. 23, doi
    10.1137/1.9781611971217). The law is a free set of elasto-slide elements (eqs 6-11) on a grid of thresholds, a
    convex problem without start values. With `law = "any"` the other laws of fraexp and dampers of the elements are
    tried too, with `laws` and `starts` further ones; the one with the smallest residual is taken. The sweep is not ok
    if noise and rounding do not explain that residual.

    This does not separate a force that is linear in the motion from the plant. A rigid body with modes, eq (1), is
    neither damped nor held: viscous friction D v and a spring are what `modal_fit` needs in addition, and are removed
    from P̂. If that damping is the plant's own, the sum of both is still right. With `estimate_dead_time` dead time and
    a first-order lag of the thrust, if the records show one, are those with which that plant leaves least. Where there
    is a lag, the law is chosen again behind it: the metric `input_time_constant`.

    The covariances of P̂ and plant include that of the friction model. The interval of the Coulomb force is that of all
    laws that leave as little as the best one; with `law = "any"` it includes friction that weakens in sliding. Such
    friction counts as Coulomb force where it weakens only above the largest velocity that was measured, or much later
    than half a period of the lowest frequency. At the lowest frequencies the axis is a free body, unless the records
    contradict. The widest elements are left out where the law leaves hardly more without them.

    With `validation` the last segments are held out: the metric `validation error` is the part of their control input
    that the identified plant and friction do not explain along the measured motion.

    Segments that have not settled are left out. It is ok if the law explains the records, and what the plant leaves of
    P̂, the validation error, the scatter over the records, and the 95 % bands of plant and Coulomb force are within the
    accuracy of the study.

    `scatter before`, `scatter after` and `noise floor` are the medians over the lines of the relative scatter of P̂ over
    the records with and without friction, and of what noise explains; `ratio` is the residual over what is allowed for.

    It needs stepped sines at two amplitudes (`concatenated`), a factor of 2 apart, the larger of which overcomes
    friction, or realisations of a multisine that does. A choice among laws needs three amplitudes or more, from nearly
    still to gross sliding, as `fraexp measure --autonomous` records them. Do not use it for friction that depends on
    the position, nor for an axis that a spring holds.
    """

    law: Literal["elements", "any"] = param(
        "", "elements: a free set of elements; any: each law that fraexp has", "elements"
    )
    laws: tuple[type[FrictionModel], ...] = param("", "names of further laws that are tried, your own included", ())
    starts: tuple[FrictionModel, ...] = param("", "friction models to start from, of further laws that are tried", ())
    estimate_dead_time: bool = param("", "whether dead time is estimated, in addition to `input_dead_time`", False)
    resolution: float = param("m", "quantisation step of the encoder", 0.0, at_least=0, inherit="loop.resolution")
    noise: float = param("m", "standard deviation of the encoder's noise", 0.0, at_least=0, inherit="loop.noise")
    oversampling: int = param("1", "points per sample at which the motion drives friction", 4, at_least=1, at_most=64)
    model_error: float = param(
        "1", "relative error of the thrust that is allowed for besides noise", FORCE_FLOOR, above=0, below=1
    )
    modes: int | None = param(
        "1", "modes of the plant; chosen by an information criterion if not given", None, at_least=0
    )
    min_frequency: float = param("Hz", "lower limit of the frequency range of the plant fit", 0.0, at_least=0)
    max_frequency: float | None = param(
        "Hz", "upper limit of the frequency range of the plant fit; none if it is not given", None, above=0
    )
    plant_model_error: float = param(
        "1",
        "relative error of the plant model that is allowed for besides noise; less if it leaves less",
        3e-3,
        above=0,
    )
    mass: float | None = param("kg", "moving mass of the data sheet, with which k0 is compared", None, above=0)
    validation: int = param("1", "how many of the last segments are predicted instead of fitted", 0, at_least=0)

    expected_failures = dict.fromkeys(
        ("linear-plant", "result-units", "covariance", "outcome"),
        "It refuses a stepped sine at one amplitude, with which it is tried here.",
    )

    def model_post_init(self, context: object) -> None:
        """Check the frequency range by building the plant fit, and that a search for each law can begin."""
        self._modal()
        for law in self.laws:
            try:
                unit_law(law, 1.0, 1.0)
            except ParameterError as error:
                raise ParameterError("plant_and_friction.laws: ", *error.args, "; give a model in `starts`") from None

    def estimate(self, signals: Signals) -> Result:
        """Return P̂ with its band, plant, friction model and dead time."""
        signals.unit(self.input), signals.unit(self.output)
        if not signals.segments:
            return Result(signals.outcome, signals.findings)
        signals = remove_drift(signals, self.output)
        count = len(signals.segments) - self.validation
        fresh = replace(signals, segments=signals.segments[count:])
        used = usable_signals(replace(signals, segments=signals.segments[:count]), self.output, self.name)
        if used.outcome is Outcome.NOT_SETTLED:  # what has not settled is left out, and harms nothing
            used = replace(used, outcome=Outcome.OK)
        found = self._chosen(used)
        lag = self._lag(used, found) if self.estimate_dead_time else 0.0
        if lag:
            known = self.model_copy(update={"input_time_constants": (*self.input_time_constants, lag)})
            return known._result(used, fresh, known._chosen(used), lag)
        return self._result(used, fresh, found, lag)

    def _chosen(self, signals: Signals) -> LawChoice:
        """Return the law that explains records best."""
        selection = LawSelection(signals, self._observer(), self.model_error, self.estimate_dead_time)
        found = selection.choose((*self.laws, *self.starts), self.law == "any")
        self._check(found)
        return found

    def _lag(self, signals: Signals, found: LawChoice) -> float:
        """Return the time constant [s] of a lag in P̂; the dead time of the law has stood for it so far."""
        with suppress(RecordError):
            return self._plant(signals, found, self._modal(dead_time=None), may_lag=True).lag
        return 0.0

    def _observer(self) -> EffectiveInput:
        names = set(EffectiveInput.model_fields) & set(type(self).model_fields)
        return EffectiveInput(friction=Frictionless(), **{name: getattr(self, name) for name in names})

    def _modal(self, dead_time: float | None = 0.0) -> ModalFit:
        return ModalFit(
            method=Conventional(),
            modes=self.modes,
            min_frequency=self.min_frequency,
            max_frequency=self.max_frequency,
            dead_time=dead_time,
            model_error=self.plant_model_error,
        )

    def _check(self, found: LawChoice) -> None:
        """Raise RecordError if the records differ not as friction makes them differ, or by noise at one amplitude only.

        Records of several amplitudes that agree within their noise are those of an axis without friction.
        """
        before, explained = map(np.median, found.scatter(found.records.delayed(found.dead_time)))
        agree = before < MAX_NOISE_RATIO * explained
        if found.amplitude_ratio >= MIN_SIZE_RATIO if agree else found.forces.any():
            return
        remedy = "use amplitudes a factor of 2 apart"
        if not agree:
            remedy = "friction does not cause this: check the channels and their signs"
        raise RecordError(
            f"plant_and_friction: y'/u scatters by {before:.2g} over the records, of which noise explains "
            f"{explained:.2g}; {remedy}"
        )

    def _with_dead_time(self, signals: Signals, found: LawChoice) -> LawChoice:
        """Return the fit with the dead time that is left in P̂ no more; that of the law if no plant fits."""
        modal, start = self._modal(dead_time=None), found
        for _ in range(MAX_ITERATIONS):
            try:
                dead_time = max(found.dead_time + self._plant(signals, found, modal).dead_time, 0.0)
            except RecordError:
                return start
            step, found = dead_time - found.dead_time, replace(found, dead_time=dead_time)
            if abs(step) < CONVERGED * signals.segments[0].sample_time:
                break
        return found

    def _plant(self, signals: Signals, found: LawChoice, modal: ModalFit, may_lag: bool = False) -> IdentifiedPlant:
        """Return the plant in P̂ at the frequencies at which the records agree; RecordError if there is none."""
        scatter, _ = found.scatter(found.effective)
        response = found.response(signals, (self.input, self.output)).response
        assert response is not None
        if (scatter > MAX_LINE_SCATTER).all():
            raise RecordError(
                f"the records at several amplitudes differ by more than {MAX_LINE_SCATTER:.0%} in their plant at all "
                f"{scatter.size} frequencies"
            )
        usable = replace(response, settled=response.settled & (scatter <= MAX_LINE_SCATTER))
        with np.errstate(all="ignore"):  # where nothing is identifiable
            return identify_plant(found.inverse, usable, modal, may_lag)

    def _validation_error(self, fresh: Signals, found: LawChoice, plant: IdentifiedPlant) -> float:
        """Return the part of the thrust in fresh records that plant and friction do not explain."""
        records = LineRecords.of(fresh, self._observer(), self.model_error)
        (fit,) = plant.fit.fits
        spec = {key: value for key, value in fit.component.items() if key not in ("name", "version")}
        ground = {"viscous_coefficient": max(plant.viscous, 0.0), "ground_stiffness": max(plant.spring, 0.0)}
        modal = Modal.parse({**spec, **ground}, "plant")
        thrust = records.delayed(found.dead_time)
        left = thrust - records.deflection(found.best.law) @ found.forces
        left -= records.motion / modal.response(2 * np.pi * records.frequency)[:, None]
        at = records.known & records.is_excited[:, None]
        return float(np.sqrt(np.sum(np.abs(left[at]) ** 2) / np.sum(np.abs(thrust[at]) ** 2)))

    def _result(self, signals: Signals, fresh: Signals, found: LawChoice, lag: float) -> Result:
        """Return all that was found, with what makes it doubtful."""
        found = self._with_dead_time(signals, found) if self.estimate_dead_time else found
        remark, plant = "", None
        try:
            plant = self._plant(signals, found, self._modal())
        except RecordError as refusal:
            remark = f"no plant identified: {refusal}"
        fitted = found.response(signals, (self.input, self.output))
        before = (*fitted.findings, *found.left_out)
        fitted = plant.fit if plant else fitted
        report = LawReport(found, plant, self.input_dead_time, self.mass, lag)
        found_errors, validation = list(report.errors()), []
        if self.validation and plant:
            error = self._validation_error(fresh, found, plant)
            validation = [Metric("validation error", error, "1")]
            left = Quantity(100 * error, "%", "of the control input unexplained")
            remedy = "friction may depend on the position, or limits allow too little motion"
            found_errors.append(Finding("misfit", (left,), place="fresh records", remedy=remedy, error=error))
        metrics = (*report.metrics(), *validation)
        result = replace(
            fitted,
            outcome=signals.outcome,
            findings=(*before, *(each for each in fitted.findings if each.error), *found_errors, report.summary()),
            metrics=(*fitted.metrics[:2], *metrics, *fitted.metrics[2:]),
            curves=(*report.curves(), *fitted.curves),
            fits=(*fitted.fits, report.friction()),
        )
        if (doubt := found.doubt()) and result.response is not None:
            unknown = np.full_like(result.response.covariance, np.nan)
            response = replace(result.response, covariance=unknown, model_covariance=None)
            result = replace(result, response=response)
        return result.with_findings(remark, doubt, *report.contradictions(), is_doubt=True)
