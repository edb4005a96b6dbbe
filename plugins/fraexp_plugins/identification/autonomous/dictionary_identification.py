"""Plant and friction of a machine of which nothing is known, whatever its friction law."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Fit, FrequencyResponse, FrictionModel, Metric, Outcome, RecordError, Result, Signals, param
from fraexp_plugins.estimators._shared.delayed_estimator import DelayedEstimator
from fraexp_plugins.estimators._shared.effective_input_observer import EFFECTIVE_INPUT
from fraexp_plugins.estimators._shared.realisations import Part, circular_covariance, combine_parts
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.friction.dahl import Dahl
from fraexp_plugins.friction.none import Frictionless
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.identification._shared.friction_curves import NORMAL_QUANTILE, virgin_curve
from fraexp_plugins.identification._shared.usable_signals import usable_signals
from fraexp_plugins.identification.autonomous._shared.autonomous_elements import fit_elements
from fraexp_plugins.identification.autonomous._shared.autonomous_lines import (
    ElementObserver,
    StopElements,
    spectral_lines,
)
from fraexp_plugins.identification.autonomous._shared.autonomous_plant import (
    IdentifiedPlant,
    InverseResponse,
    identify_plant,
)
from fraexp_plugins.identification.autonomous._shared.dictionary_fit import (
    DictionaryFit,
    Weights,
    delayed_lines,
    fit_dictionary,
    rough_dead_time,
    scatter_noise,
)
from fraexp_plugins.identification.autonomous._shared.force_dictionary import ForceDictionary
from fraexp_plugins.identification.plant.modal_fit import ModalFit
from fraexp_plugins.plants.modal import Modal

MIN_LINES, MIN_EQUATIONS = 8, 24
"""Fewest frequencies, and real equations beyond one response each, from which a friction force can be chosen."""
MAX_LINE_SCATTER = 0.1
"""Relative scatter of P̂ over the amplitudes up to which a frequency counts for the plant."""
PLANT_MODEL_ERROR = 3e-3
"""Relative error of P̂ that the plant's fit allows for: that of the dictionary."""
MAX_GAIN_ERROR, MAX_MODE_ERROR, MAX_FORCE_ERROR = 0.01, 0.2, 0.03
"""Half-width of the 95 % intervals of k0 (relative), f1 [Hz] and ΣF_m (relative) above which the verdict is not ok."""
MIN_STRIBECK_SHARE = 0.075
"""Stribeck force over the Coulomb force from which the summary mentions it."""
MAX_DEAD_TIME_STEPS, DEAD_TIME_TOLERANCE = 4, 5e-3
"""Fits of the dead time, each with the friction of the one before, and the step [samples] that is the last one."""
CURVE_POINTS = 60


class DictionaryIdentification(DelayedEstimator, name="dictionary_identification", version=2):
    """P̂, plant, friction force and dead time from records at several amplitudes; the friction law need not be known.

    The friction force is a sum of forces of a dictionary, each driven by the measured position: stop operators (rolling
    elements), Dahl bristles of many widths, dampers beside the elements (D_i, σ1), Stribeck peaks, and elements that
    weaken in sliding. The error law is linear in their sizes: G_di G_do U_a = Y_a/P + Σ c_j Z_j,a for each record a and
    line. As in `plant_and_friction`, least squares over c_j >= 0 and a 1/P for each line is convex and needs no start
    (C. L. Lawson and R. J. Hanson, Solving Least Squares Problems, 1974, ch. 23, doi 10.1137/1.9781611971217). What no
    column repeats, as near breakaway, counts less in a second and third pass (iteratively reweighted least squares: P.
    W. Holland and R. E. Welsch, Communications in Statistics A6(9), 1977, doi 10.1080/03610927708827533). The dead time
    is the one with which friction explains most.

    A rigid body with modes and viscous friction is then fitted to P̂ as `modal_fit` does. With `validation` the last
    segments are held out: the metric `validation error` is the part of their control input that the identified plant
    and friction do not explain along the measured motion.

    Friction that weakens in sliding and Coulomb force can be told apart only where the axis slides faster than the
    Stribeck velocity. The interval of the Coulomb force is therefore a profile: the least and the greatest force with
    which some other friction explains the records as well. Friction that weakens only above the largest velocity that
    was measured, or at velocities that last for less than its lag, counts as Coulomb force.

    The verdict is 1 if the plant explains P̂, the validation error is not above `validation_tolerance`, and the 95 %
    intervals are within 1 % for k0, 0.2 Hz for f1 and 3 % for ΣF_m. Otherwise it is 0, the outcome is inaccurate, and
    the message gives the reason.

    It needs three amplitudes or more at each of some fifteen frequencies, from nearly still to gross sliding, as
    `fraexp measure --autonomous` records them. The friction model that it returns is `rolling`, or `dahl` if most of
    the force is that of bristles; forces of dampers and peaks are in no component. Do not use it for friction that
    depends on the position.
    """

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
            return Result(signals.outcome, signals.message)
        count = len(signals.segments) - self.validation
        fresh = replace(signals, segments=signals.segments[count:])
        used = usable_signals(replace(signals, segments=signals.segments[:count]), self.output, self.name)
        found = self._fit(used)
        plant, remark = self._plant(used, found)
        return self._result(used, found, plant, remark, self._validation_error(fresh, found, plant))

    def _observer(self) -> ElementObserver:
        names = set(ElementObserver.model_fields) & set(type(self).model_fields)
        return ElementObserver(friction=Frictionless(), **{name: getattr(self, name) for name in names})

    def _fit(self, signals: Signals) -> DictionaryFit:
        observer = self._observer()
        bare = spectral_lines(signals, observer, StopElements(np.empty(0)))
        if len(bare.frequency) < MIN_LINES or bare.equations < MIN_EQUATIONS:
            raise RecordError(
                f"dictionary_identification: {bare.frequency.size} frequencies give {bare.equations} equations for "
                f"friction; expected {MIN_LINES} frequencies and {MIN_EQUATIONS} equations or more: record each "
                "frequency at three amplitudes"
            )
        swings = [float(np.ptp(segment.channels[self.output])) / 2 for segment in signals.segments]
        speeds = 2 * np.pi * bare.frequency[:, None] * np.abs(bare.motion)
        smallest = max(float(np.abs(bare.motion[bare.known]).min()), 2 * self.resolution, 2 * self.noise)
        dictionary = ForceDictionary.spanning(min(smallest, max(swings)), max(swings), float(speeds.max()))
        lines = spectral_lines(signals, observer, dictionary)
        peak = max(float(np.abs(segment.channels[self.input]).max()) for segment in signals.segments)
        total = self.model_error**2 * np.abs(lines.thrust) ** 2
        inverse = fit_elements(lines, dictionary.widths, total, peak).inverse
        weights = Weights(scatter_noise(signals, lines, observer, inverse), self.model_error, peak)
        if not self.estimate_dead_time:
            return fit_dictionary(lines, dictionary, weights, 0.0)
        sample_time = signals.segments[0].sample_time
        found = fit_dictionary(lines, dictionary, weights, rough_dead_time(lines, dictionary, weights, sample_time))
        for _ in range(MAX_DEAD_TIME_STEPS):
            step = self._dead_time_in(signals, found)
            found = fit_dictionary(lines, dictionary, weights, max(found.dead_time + step, 0.0))
            if abs(step) < DEAD_TIME_TOLERANCE * sample_time:
                break
        return found

    def _dead_time_in(self, signals: Signals, found: DictionaryFit) -> float:
        """Return the dead time [s] that is left in P̂; 0 if no plant fits."""
        _, response = self._inverse(signals, found)
        modal = self._modal().model_copy(update={"dead_time": None, "fit_viscous": True})
        try:
            with np.errstate(all="ignore"):
                (fit,) = modal.fit_response(response).fits
        except RecordError:
            return 0.0
        return float(fit.values[fit.parameters.index("dead_time")])

    def _modal(self) -> ModalFit:
        return ModalFit(method=Conventional(), modes=self.modes, dead_time=0.0, model_error=PLANT_MODEL_ERROR)

    def _inverse(self, signals: Signals, found: DictionaryFit) -> tuple[InverseResponse, FrequencyResponse]:
        """Return 1/P̂ with its errors, and P̂ at the frequencies that count for the plant as settled ones."""
        response, elements = self._response(signals, found).response, found.elements
        assert response is not None
        inverse = InverseResponse(found.lines.frequency, elements.inverse, elements.noise, elements.inverse_columns)
        is_known = elements.scatter <= MAX_LINE_SCATTER
        return inverse, replace(response, settled=response.settled & is_known)

    def _plant(self, signals: Signals, found: DictionaryFit) -> tuple[IdentifiedPlant | Result, str]:
        """Return the plant in P̂, or P̂ alone with the reason."""
        inverse, usable = self._inverse(signals, found)
        try:
            with np.errstate(all="ignore"):  # where nothing is identifiable
                return identify_plant(inverse, usable, self._modal()), ""
        except RecordError as error:
            return self._response(signals, found), f"no plant identified: {error}"

    def _response(self, signals: Signals, found: DictionaryFit) -> Result:
        """Return P̂ before linear forces are removed."""
        lines, elements = found.lines, found.elements
        effective = np.abs(lines.thrust - lines.deflection @ elements.stiffness)
        response, count = 1 / elements.inverse, lines.known.sum(axis=1)
        variance = np.abs(response) ** 4 * elements.noise
        parts, begin = [], 0
        for group in lines.groups:
            segments = tuple(signals.segments[place] for place in group)
            rows = slice(begin, begin + segments[0].lines.size)
            begin = rows.stop
            amplitudes = (
                (np.where(lines.known, effective, 0.0).sum(axis=1) / count)[rows],
                (np.abs(lines.motion).sum(axis=1) / count)[rows],
            )
            band = circular_covariance(variance[rows])
            parts.append(Part(segments, lines.frequency[rows], response[rows], band, np.inf, *amplitudes))
        units = signals.unit(self.input), signals.unit(self.output)
        result = combine_parts(signals, parts, names=(EFFECTIVE_INPUT, self.output), units=units)
        assert result.response is not None
        inverse = InverseResponse(lines.frequency, elements.inverse, elements.noise, elements.inverse_columns)
        return replace(result, response=replace(result.response, model_covariance=inverse.friction_covariance()))

    def _validation_error(self, fresh: Signals, found: DictionaryFit, plant: IdentifiedPlant | Result) -> float | None:
        """Return the part of the thrust in fresh records that plant and friction do not explain; None without any."""
        if not fresh.segments or isinstance(plant, Result):
            return None
        lines = delayed_lines(spectral_lines(fresh, self._observer(), found.dictionary), found.dead_time)
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
        found: DictionaryFit,
        plant: IdentifiedPlant | Result,
        remark: str,
        error: float | None,
    ) -> Result:
        """Return all that was found, with the verdict."""
        fitted = plant.fit if isinstance(plant, IdentifiedPlant) else plant
        report = _Report(found, plant)
        doubts = [remark] if remark else [*report.doubts()]
        if self.validation and not remark and (error is None or error > self.validation_tolerance):
            share = "no fresh record" if error is None else f"{error:.1%} of the control input of fresh records"
            doubts.append(
                f"plant and friction leave {share} unexplained; expected {self.validation_tolerance:.1%} or less: "
                "friction may depend on the position, or limits allow too little motion"
            )
        verdict = Metric("verdict", float(not doubts), "1")
        validation = () if error is None else (Metric("validation error", error, "1"),)
        start, size = float(max(found.dictionary.stops[0], 1e-12)), float(found.dictionary.stops[-1])
        x = np.geomspace(start, size, CURVE_POINTS)
        return replace(
            fitted,
            outcome=Outcome.INACCURATE if doubts and fitted.outcome is Outcome.OK else fitted.outcome,
            message="; ".join(doubts) or report.summary(),
            metrics=(verdict, *fitted.metrics[:2], *report.metrics(), *validation, *fitted.metrics[2:]),
            curves=(virgin_curve(x, *found.virgin_curve(x)), *fitted.curves),
            fits=(*fitted.fits, report.friction()),
        )


@dataclass(frozen=True)
class _Report:
    """What a fit says of friction, and how far it is to be believed."""

    found: DictionaryFit
    plant: IdentifiedPlant | Result

    @property
    def viscous(self) -> tuple[float, float]:
        """Viscous coefficient [N s/m] and its standard deviation."""
        return (0.0, 0.0) if isinstance(self.plant, Result) else (self.plant.viscous, self.plant.viscous_std)

    @property
    def shares(self) -> tuple[float, float, float, float]:
        """Forces of stop operators, bristles, dampers and of what weakens over the Coulomb force."""
        forces, total = self.found.forces, max(self.found.coulomb, 1e-300)
        first, second, third, fourth = (float(forces[part].sum()) / total for part in self.found.dictionary.parts)
        return first, second, third, fourth

    def metrics(self) -> Iterator[Metric]:
        """Yield the numbers of friction and of the agreement of the records."""
        yield Metric("Coulomb force", self.found.coulomb, "N")
        yield Metric("Coulomb force, 95 %", self.found.coulomb_error, "N")
        yield Metric("viscous coefficient", self.viscous[0], "N s/m")
        yield Metric("viscous coefficient, 95 %", NORMAL_QUANTILE * self.viscous[1], "N s/m")
        yield Metric("input_dead_time", self.found.dead_time, "s")
        for name, share in zip(("rolling", "dahl"), self.shares, strict=False):
            yield Metric(f"force of {name}", share, "1")
        yield Metric("Stribeck force", self.shares[3], "1")
        yield Metric("scatter after", float(np.nanmedian(self.found.elements.scatter)), "1")

    def summary(self) -> str:
        """Return the law in words."""
        stops, bristles, _, peaks = self.shares
        stribeck = f", and {peaks:.0%} more at standstill" if peaks > MIN_STRIBECK_SHARE else ""
        return f"friction acts like rolling elements ({stops:.0%}) and Dahl bristles ({bristles:.0%}){stribeck}"

    def doubts(self) -> Iterator[str]:
        """Yield reasons not to believe plant or friction."""
        assert isinstance(self.plant, IdentifiedPlant)
        if self.plant.fit.outcome is not Outcome.OK:
            yield f"a rigid body with modes does not explain the response: {self.plant.fit.message}"
        (fit,) = self.plant.fit.fits
        errors = NORMAL_QUANTILE * fit.standard_deviation
        if errors[0] > MAX_GAIN_ERROR * fit.values[0]:
            yield f"the rigid-body gain is known to {errors[0] / fit.values[0]:.1%} only; raise the limits"
        for name, value, error in zip(fit.parameters, fit.values, errors, strict=True):
            if name == "frequencies.0" and error > MAX_MODE_ERROR:
                yield f"the first mode, {value:.4g} Hz, is known to {error:.2g} Hz only; record more near it"
        force, error = self.found.coulomb, self.found.coulomb_error
        if not error <= MAX_FORCE_ERROR * force:
            low, high = self.found.coulomb_interval
            yield (
                f"the Coulomb force, {force:.4g} N, may be any from {low:.4g} to {high:.4g} N, since friction that "
                f"weakens in sliding may be a part of it; expected {MAX_FORCE_ERROR:.0%} or better: let the axis move "
                "faster at low frequencies, by a softer controller"
            )

    def friction(self) -> Fit:
        """Return the friction model, with the covariance of its parameters."""
        coefficient = max(self.viscous[0], 0.0)
        stops, bristles, _, _ = self.shares
        model, names, units, values, columns = (
            self._dahl(coefficient) if bristles > stops else self._rolling(coefficient)
        )
        covariance = np.zeros((values.size + 1, values.size + 1))
        covariance[:-1, :-1] = columns @ self.found.force_covariance @ columns.T
        covariance[-1, -1] = self.viscous[1] ** 2
        return Fit(
            "friction",
            model.spec(),
            (*names, "viscous_coefficient"),
            (*units, "N s/m"),
            np.append(values, coefficient),
            covariance,
        )

    def _dahl(self, viscous: float) -> "_Component":
        forces, dictionary = self.found.forces, self.found.dictionary
        coulomb = dictionary.is_coulomb
        columns = np.array([np.where(coulomb, 1 / dictionary.widths, 0.0), np.where(coulomb, 1.0, 0.0)])
        values = columns @ forces
        model = Dahl(stiffness=float(values[0]), coulomb_force=float(values[1]), viscous_coefficient=viscous)
        return model, ("stiffness", "coulomb_force"), ("N/m", "N"), values, columns

    def _rolling(self, viscous: float) -> "_Component":
        """Return elements of the virgin curve: bristles of a width count as elements of twice that threshold."""
        forces, dictionary = self.found.forces, self.found.dictionary
        places = np.flatnonzero(dictionary.is_coulomb & (forces > 0))
        stops = dictionary.parts[0]
        widths = dictionary.widths[places] * np.where(places < stops.stop, 1.0, 2.0)
        unit = np.eye(forces.size)[places]
        columns = np.concatenate([unit / widths[:, None], unit])
        values = columns @ forces
        stiffness, force = np.split(values, 2)
        model = Rolling(stiffness=stiffness.tolist(), limit_force=force.tolist(), viscous_coefficient=viscous)
        names = [f"{name}.{place}" for name in ("stiffness", "limit_force") for place in range(places.size)]
        return model, tuple(names), ("N/m",) * places.size + ("N",) * places.size, values, columns


_Component = tuple[FrictionModel, tuple[str, ...], tuple[str, ...], NDArray[np.float64], NDArray[np.float64]]
"""A friction model; names, units and values of its parameters; and how they follow from the forces of the columns."""
