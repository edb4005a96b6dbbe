"""Plant and friction model from frequency response records, without any known friction parameter."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    Curve,
    Finding,
    Fit,
    FrictionModel,
    Metric,
    Quantity,
    RecordError,
    Result,
    Signals,
    param,
    remarks,
)
from fraexp_plugins.estimators._shared.delayed_estimator import DelayedEstimator
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.friction.none import Frictionless
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.identification._shared.friction_curves import NORMAL_QUANTILE, virgin_curve
from fraexp_plugins.identification._shared.usable_records import usable_signals
from fraexp_plugins.identification.autonomous._autonomous_elements import (
    AutonomousElements,
    fit_elements,
    relative_scatter,
)
from fraexp_plugins.identification.autonomous._autonomous_lines import (
    ElementObserver,
    SpectralLines,
    noise_variances,
    spectral_lines,
)
from fraexp_plugins.identification.autonomous._autonomous_plant import (
    IdentifiedPlant,
    identify_plant,
    response_of,
)
from fraexp_plugins.identification.plant.modal_fit import ModalFit

NOISE_PASSES = 2
"""Passes that estimate the noise with the friction model of the pass before."""
INITIAL_RELATIVE_ERROR = 1e-3
"""Relative error of the thrust in the first pass."""
THRESHOLD_SPAN = 1e4
"""Ratio of the largest to the smallest threshold."""
MAX_THRESHOLD_RATIO = 0.9
"""Largest threshold over the largest motion: an element that hardly slips acts as a spring."""
MIN_SCATTER_RATIO = 3.0
"""Scatter of the records over that by noise from which friction is identifiable."""
MAX_NOISE_SCATTER = 0.2
"""Relative scatter by noise above which the motion is hidden."""
MAX_RATIO = 2.0
"""Root of the excess of the squares up to which noise explains the residuals."""
MAX_GAIN_STD = 0.05 / NORMAL_QUANTILE
"""Relative standard deviation of the rigid-body gain up to which it is identifiable."""
SLIDING_RATIO, MAX_UNCERTAIN_FORCE = 0.5, 0.05
"""Threshold over the largest motion from which an element hardly slips, and the part of ΣF_m allowed there."""
WIDTH_FORCE_RATIO = 1 - np.exp(-1)
"""Part of ΣF_m at the width of a virgin curve."""


class PlantAndFriction(DelayedEstimator, name="plant_and_friction", version=4):
    """Friction elements, P̂ and the plant of eq (1) together, such that P̂ is the same at all amplitudes and phases.

    With f̂ = Σ K_i z_i of stop operators z_i (elasto-slide elements, eqs 6-11) at a grid of thresholds the error law is
    linear: G_di G_do U_a = Y_a/P + Σ K_i Z_i,a for each record a and line. Least squares over K_i >= 0 and a 1/P for
    each line is convex (non-negative least squares: C. L. Lawson and R. J. Hanson, Solving Least Squares Problems,
    1974, ch. 23, doi 10.1137/1.9781611971217) and needs no start values. The weights are those of noise in thrust and
    position and by way of the friction model, from the scatter of the periods and from other rounding errors.

    This does not separate a force that is linear in the motion from the plant. A rigid body with modes, eq (1), is
    neither damped nor held: viscous friction D v and the stiffness of elements that never slip are what `modal_fit`
    needs in addition, and are removed from P̂. If that damping is the plant's own, the sum of both is still right.

    The confidence band of P̂ and the intervals of the plant's parameters include the covariance of the friction model
    with all elements of the grid. Metrics besides those of `modal_fit`: `scatter before` and `scatter after` are the
    medians over the lines of the relative scatter of y'/u and y'/û_e over the records; `noise floor` is the part that
    noise explains; `ratio` is the root of the sum of squares over its expectation. The verdict is 1 if the ratio is not
    above 2, or the scatter after is within `scatter_tolerance`, and a plant fits with a gain that is known to 5 %.
    Otherwise it is 0, and the message gives the reason: friction of another kind (rate or position dependent), or wrong
    delays or gains.

    It needs stepped sines at two amplitudes (`concatenated`), a factor of 2 apart, the larger of which overcomes
    friction, or realisations of a multisine that does. If all motion stays in presliding it identifies the plant but
    not the Coulomb force, and says so. Do not use it for friction that is nonlinear in the velocity, nor for an axis
    that a spring holds.
    """

    resolution: float = param("m", "quantisation step of the encoder", 0.0, at_least=0, inherit="loop.resolution")
    noise: float = param("m", "standard deviation of the encoder's noise", 0.0, at_least=0, inherit="loop.noise")
    oversampling: int = param(
        "1", "points per sample at which the motion drives the elements", 4, at_least=1, at_most=64
    )
    threshold_count: int = param(
        "1", "number of thresholds on the grid, spaced logarithmically", 300, at_least=10, at_most=2000
    )
    model_error: float = param(
        "1", "relative error of the thrust that is allowed for besides noise", 1e-4, above=0, below=1
    )
    scatter_tolerance: float = param("1", "relative scatter that is acceptable", 2e-3, at_least=0)
    modes: int | None = param(
        "1", "modes of the plant; chosen by an information criterion if not given", None, at_least=0
    )
    min_frequency: float = param("Hz", "lower limit of the frequency range of the plant fit", 0.0, at_least=0)
    max_frequency: float | None = param(
        "Hz", "upper limit of the frequency range of the plant fit; none if it is not given", None, above=0
    )
    plant_model_error: float = param(
        "1", "relative error of the plant model that is allowed for besides noise", 1e-3, above=0
    )

    expected_failures = dict.fromkeys(
        ("linear-plant", "result-units", "covariance", "outcome"),
        "It refuses a stepped sine at one amplitude, with which it is tried here.",
    )

    def model_post_init(self, context: object) -> None:
        """Check the frequency range by building the plant fit."""
        self._modal()

    def estimate(self, signals: Signals) -> Result:
        """Return P̂ with its band, plant and friction model, scatter and verdict."""
        signals.unit(self.input), signals.unit(self.output)
        if not signals.segments:
            return Result(signals.outcome, signals.findings)
        used = usable_signals(signals, self.output, self.name)
        lines, elements = self._elements(used)
        self._check(lines, elements)
        found, inverse = response_of(used, (self.input, self.output), lines, elements)
        assert found.response is not None
        try:
            with np.errstate(all="ignore"):  # where nothing is identifiable
                plant, remark = identify_plant(inverse, found.response, self._modal()), ""
        except RecordError as error:
            plant, remark = None, f"no plant identified: {error}"
        return self._result(found, used, lines, elements, plant, remark)

    def _modal(self) -> ModalFit:
        return ModalFit(
            method=Conventional(),
            modes=self.modes,
            min_frequency=self.min_frequency,
            max_frequency=self.max_frequency,
            dead_time=0.0,
            model_error=self.plant_model_error,
        )

    def _observer(self, friction: FrictionModel) -> ElementObserver:
        fields = set(ElementObserver.model_fields) & set(type(self).model_fields)
        return ElementObserver(friction=friction, **{name: getattr(self, name) for name in fields})

    def _elements(self, signals: Signals) -> tuple[SpectralLines, AutonomousElements]:
        """Return the records at each line, and the elements in them."""
        bare = self._observer(Frictionless())
        grid = self._grid(signals, bare)
        lines = spectral_lines(signals, bare, grid)
        if not lines.equations:
            raise RecordError(
                "plant_and_friction: each line is in one record; expected several: record two amplitudes, a factor of "
                "2 apart (excitation 'concatenated'), or realisations of a multisine"
            )
        power, peak = np.abs(lines.thrust) ** 2, _largest_swing(signals, self.input)
        elements = fit_elements(lines, grid, INITIAL_RELATIVE_ERROR**2 * power, peak)
        for _ in range(NOISE_PASSES):
            observer = self._observer(elements.model()) if elements.stiffness.any() else bare
            noise = noise_variances(signals, lines, observer, elements.inverse)
            elements = fit_elements(lines, grid, noise + self.model_error**2 * power, peak)
        return lines, elements

    def _grid(self, signals: Signals, observer: ElementObserver) -> NDArray[np.float64]:
        """Return thresholds [m] from below the smallest line's amplitude to the largest motion."""
        bare = spectral_lines(signals, observer)
        largest = _largest_swing(signals, self.output)
        smallest = max(float(np.abs(bare.motion[bare.known]).min()), 2 * self.resolution, 2 * self.noise)
        return np.geomspace(
            max(min(smallest / 2, largest / 10), largest / THRESHOLD_SPAN),
            MAX_THRESHOLD_RATIO * largest,
            self.threshold_count,
        )

    def _check(self, lines: SpectralLines, elements: AutonomousElements) -> None:
        """Raise RecordError if the records differ by noise only, or not as friction makes them differ."""
        before, explained = _median(relative_scatter(lines, lines.thrust)), _median(elements.noise_floor)
        if before >= MIN_SCATTER_RATIO * explained and elements.stiffness.any():
            return
        remedy = "use amplitudes a factor of 2 apart; if that does not help there is no friction to identify"
        if explained > MAX_NOISE_SCATTER:
            remedy = "noise hides the motion: raise the amplitude, or use a finer encoder"
        elif before >= MIN_SCATTER_RATIO * explained:
            remedy = "friction does not cause this: check the channels and their signs"
        raise RecordError(
            f"plant_and_friction: y'/u scatters by {before:.2g} over the records, of which noise explains "
            f"{explained:.2g}; {remedy}"
        )

    def _result(
        self,
        found: Result,
        signals: Signals,
        lines: SpectralLines,
        elements: AutonomousElements,
        plant: IdentifiedPlant | None,
        remark: str,
    ) -> Result:
        quality = _Quality(lines, elements, self.scatter_tolerance)
        doubts = [*quality.remarks(), *([remark] if remark else []), *(_plant_doubts(plant) if plant else ())]
        hints = _hints(elements, plant, _largest_swing(signals, self.output))
        plants = plant.fit.metrics if plant else ()
        verdict = Metric("verdict", float(not doubts), "1")
        viscous = (plant.viscous, plant.viscous_std) if plant else (0.0, 0.0)
        spring = (plant.spring, _largest_swing(signals, self.output)) if plant else (0.0, 0.0)
        return replace(
            found,
            findings=(*found.findings, *remarks(*doubts), *hints),
            response=plant.fit.response if plant else found.response,
            metrics=(verdict, *plants[:2], *_friction_metrics(elements, viscous), *quality.metrics(), *plants[2:]),
            curves=(
                virgin_curve(elements.thresholds, *elements.virgin_curve(elements.thresholds)),
                quality.curve(),
                *(plant.fit.curves if plant else ()),
            ),
            fits=(*(plant.fit.fits if plant else ()), _fit(elements, viscous, spring)),
        )


@dataclass(frozen=True)
class _Quality:
    """How well the records agree with the friction elements."""

    lines: SpectralLines
    elements: AutonomousElements
    scatter_tolerance: float

    @property
    def scatter_before(self) -> NDArray[np.float64]:
        return relative_scatter(self.lines, self.lines.thrust)

    @property
    def ratio(self) -> float:
        return float(np.sqrt(self.elements.excess))

    @property
    def is_explained(self) -> bool:
        """Whether noise, or the accepted scatter, explains the residuals."""
        return self.ratio <= MAX_RATIO or _median(self.elements.scatter) <= self.scatter_tolerance

    def metrics(self) -> tuple[Metric, ...]:
        return (
            Metric("scatter before", _median(self.scatter_before), "1"),
            Metric("scatter after", _median(self.elements.scatter), "1"),
            Metric("noise floor", _median(self.elements.noise_floor), "1"),
            Metric("ratio", self.ratio, "1"),
        )

    def remarks(self) -> Iterator[str]:
        """Yield reasons to doubt the friction model."""
        if not self.is_explained:
            yield (
                "friction elements do not explain the records: y'/û_e scatters by "
                f"{_median(self.elements.scatter):.2g}, of which noise explains "
                f"{_median(self.elements.noise_floor):.2g}; check delays and gains, or friction depends on velocity or "
                "position"
            )

    def curve(self) -> Curve:
        order = np.argsort(self.lines.frequency, kind="stable")
        columns = {
            "frequency": self.lines.frequency,
            "scatter before": self.scatter_before,
            "scatter after": self.elements.scatter,
            "noise floor": self.elements.noise_floor,
        }
        units = dict.fromkeys(columns, "1") | {"frequency": "Hz"}
        return Curve("agreement of the records", {name: column[order] for name, column in columns.items()}, units)


def _median(values: NDArray[np.float64]) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else float("nan")


def _largest_swing(signals: Signals, channel: str) -> float:
    """Return half the largest swing of a channel [its unit]."""
    return float(max(np.ptp(segment.channels[channel]) for segment in signals.segments)) / 2


def _friction_metrics(elements: AutonomousElements, viscous: tuple[float, float]) -> tuple[Metric, ...]:
    force, std = elements.coulomb
    return (
        Metric("Coulomb force", force, "N"),
        Metric("Coulomb force, 95 %", NORMAL_QUANTILE * std, "N"),
        Metric("width at 63 %", _width(elements), "m"),
        Metric("viscous coefficient", viscous[0], "N s/m"),
        Metric("viscous coefficient, 95 %", NORMAL_QUANTILE * viscous[1], "N s/m"),
        Metric("elements", float(len(elements.merge_matrix)), "1"),
    )


def _width(elements: AutonomousElements) -> float:
    """Return the displacement [m] at which the virgin curve reaches 1 - 1/e of ΣF_m."""
    x = np.concatenate([[0.0], elements.thresholds])  # straight lines between them
    force = elements.virgin_curve(x)[0]
    return float(np.interp(WIDTH_FORCE_RATIO * force[-1], force, x))


def _fit(elements: AutonomousElements, viscous: tuple[float, float], spring: tuple[float, float]) -> Fit:
    """Return the friction model with the covariance of its parameters.

    A stiffness that never slips is an element that slips beyond the largest motion: its force is fixed, not known.
    """
    stiffness, force = np.split(elements.model_values, 2)
    count, coefficient = stiffness.size, max(viscous[0], 0.0)
    if spring[0]:
        stiffness, force = np.append(stiffness, spring[0]), np.append(force, spring[0] * spring[1])
    model = Rolling(stiffness=stiffness.tolist(), limit_force=force.tolist(), viscous_coefficient=coefficient)
    names = [f"{name}.{place}" for name in ("stiffness", "limit_force") for place in range(stiffness.size)]
    covariance = np.zeros((len(names) + 1, len(names) + 1))
    known = np.concatenate([np.arange(count), stiffness.size + np.arange(count)])
    covariance[np.ix_(known, known)] = elements.model_covariance
    covariance[-1, -1] = viscous[1] ** 2
    return Fit(
        "friction",
        model.spec(),
        (*names, "viscous_coefficient"),
        (*["N/m"] * stiffness.size, *["N"] * stiffness.size, "N s/m"),
        np.concatenate([stiffness, force, [coefficient]]),
        covariance,
    )


def _plant_doubts(plant: IdentifiedPlant) -> Iterator[str]:
    """Yield reasons to doubt the plant."""
    cost = next(metric.value for metric in plant.fit.metrics if metric.name == "cost")
    if cost > MAX_RATIO**2:
        yield plant.fit.message or "the plant model does not fit: try more modes or a narrower frequency range"
    (fit,) = plant.fit.fits
    relative = float(fit.standard_deviation[0] / fit.values[0])
    if relative > MAX_GAIN_STD:
        yield (
            f"the rigid-body gain is uncertain by {NORMAL_QUANTILE * relative:.0%}: raise the amplitude, or record "
            "more lines"
        )


def _hints(elements: AutonomousElements, plant: IdentifiedPlant | None, motion: float) -> Iterator[Finding]:
    """Yield what is not identifiable from the records."""
    uncertain = float(elements.forces[elements.thresholds > SLIDING_RATIO * motion].sum()) / max(
        elements.coulomb[0], 1e-300
    )
    if uncertain > MAX_UNCERTAIN_FORCE or (plant and plant.spring):
        spring = Quantity(plant.spring if plant else 0.0, "N/m", "stiffness that never slips")
        found = (Quantity(motion, "m", "motion that hardly leaves presliding"), *([spring] if spring.value else []))
        yield Finding("not identifiable", found, place="Coulomb force", remedy="raise the amplitude")
