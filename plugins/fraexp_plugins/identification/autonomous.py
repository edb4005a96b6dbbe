"""Plant and friction model from frequency response records alone, no friction parameter given."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from fraexp.api import Curve, Fit, FrictionModel, Metric, RecordError, Result, Signals, param
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.estimators.delayed import DelayedEstimator
from fraexp_plugins.estimators.effective_input import EFFECTIVE_INPUT
from fraexp_plugins.estimators.realisations import Part, circular, combined
from fraexp_plugins.friction.frictionless import Frictionless
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.identification.autonomous_elements import AutonomousElements, fitted, scatter_of
from fraexp_plugins.identification.autonomous_lines import ElementObserver, SpectralLines, lines_of, usable, variances
from fraexp_plugins.identification.autonomous_plant import Inverse, PlantFound, plant_of
from fraexp_plugins.identification.friction_report import virgin_curve
from fraexp_plugins.identification.modal_fit import ModalFit

NORMAL = 1.959963984540054
"""Standard deviations on either side of a 95 % interval."""
PASSES = 2
"""Times that the noise is found with the friction model of the pass before."""
FIRST_ERROR = 1e-3
"""Relative error of the thrust that the first pass assumes."""
SPAN = 1e4
"""Greatest threshold over the least."""
TOP = 0.9
"""Greatest threshold over the greatest motion: what slips but a little there is a spring."""
VISIBLE = 3.0
"""How many times more than noise records must differ to tell friction."""
HIDDEN = 0.2
"""Relative scatter by noise that hides the motion."""
MARGIN = 2.0
"""Root of the excess of the squares up to which noise explains what is left."""
TOLD = 0.05 / NORMAL
"""Relative standard deviation of the plant's gain up to which it counts as told."""
SLIPS, REST = 0.5, 0.05
"""Share of the greatest motion beyond which thresholds hardly slip, and the share of ΣF_m that may lie there."""
MEAN_WIDTH = 1 - np.exp(-1)
"""Share of ΣF_m at the width of a virgin curve."""


class Autonomous(DelayedEstimator, name="autonomous", version=2):
    """Friction elements, P̂ and the plant of eq (1) together: P̂ must be the same at all amplitudes and phases.

    With f̂ = Σ K_i z_i of stop operators z_i (elasto-slide elements, eqs 6-11) at a grid of thresholds the error law is
    linear: G_di G_do U_a = Y_a/P + Σ K_i Z_i,a for each record a and line. Least squares over K_i >= 0 and a 1/P for
    each line is convex (non-negative least squares: C. L. Lawson and R. J. Hanson, Solving Least Squares Problems,
    1974, ch. 23, doi 10.1137/1.9781611971217) and needs no start values. The weights are those of noise in thrust and
    position and by way of the friction model, from the scatter of the periods and from other rounding errors.

    A force that is linear in the motion is in no way told from the plant by that. A rigid body with modes, eq (1), is
    neither damped nor held: viscous friction D v, and the stiffness of what never slips, are what `modal_fit` needs
    beside it, and are taken off P̂. If that damping is the plant's own, the two together are right all the same.

    The band of P̂ has the covariance of the friction model in it, all elements of the grid being allowed for; so have
    the intervals of the plant's parameters. Metrics besides those of `modal_fit`: `scatter before` and `after` are the
    medians over the lines of the relative scatter of y'/u and y'/û_e from record to record, `noise floor` what noise
    explains of it, `ratio` the root of the sum of squares over its expectation. The verdict is 1 where the ratio is at
    most 2 or the scatter after is within `tolerance`, and a plant fits with a gain that is told to 5 %; otherwise 0,
    with the reason: friction of another kind (rate dependent, position dependent), or delays or gains that are not
    those stated.

    It takes stepped sines at two amplitudes (`sequence`), a factor of 2 apart, of which the greater overcomes friction,
    or realisations of a multisine that does. Where all motion stays in presliding it tells the plant and not the
    Coulomb force, and says so. Not to be used for friction that depends on the velocity other than linearly, nor for an
    axis that a spring holds.
    """

    resolution: float = param("m", "resolution of the scale", 0.0, at_least=0, inherit="loop.resolution")
    noise: float = param("m", "standard deviation of the scale's noise", 0.0, at_least=0, inherit="loop.noise")
    interpolation: int = param("1", "points per sample at which elements are driven", 4, at_least=1, at_most=64)
    thresholds: int = param("1", "thresholds on the grid, spaced logarithmically", 300, at_least=10, at_most=2000)
    floor: float = param("1", "relative error of the thrust allowed for besides noise", 1e-4, above=0, below=1)
    tolerance: float = param("1", "relative scatter that does no harm", 2e-3, at_least=0)
    modes: int | None = param("1", "modes of the plant; by an information criterion if none is given", None, at_least=0)
    lowest: float = param("Hz", "lower limit of the band of the plant fit", 0.0, at_least=0)
    highest: float | None = param(
        "Hz", "upper limit of the band of the plant fit; none if none is given", None, above=0
    )
    plant_floor: float = param("1", "relative error of the plant model allowed for besides noise", 1e-3, above=0)

    expected_failures = dict.fromkeys(
        ("linear-plant", "result-units", "covariance", "outcome"),
        "It refuses a stepped sine at one amplitude, with which it is tried here.",
    )

    def model_post_init(self, context: object) -> None:
        """Check the band by building what fits the plant."""
        self._modal()

    def estimate(self, signals: Signals) -> Result:
        """Return P̂ with its band, plant and friction model, scatter and verdict."""
        signals.unit(self.input), signals.unit(self.output)
        if not signals.segments:
            return Result(signals.outcome, signals.message)
        used = usable(signals, self.output)
        lines, elements = self._elements(used)
        self._check(lines, elements)
        found = self._response(used, lines, elements)
        assert found.response is not None
        inverse = Inverse(lines.frequency, elements.inverse, elements.noise, elements.inverse_columns)
        try:
            with np.errstate(all="ignore"):  # where nothing is told
                plant, remark = plant_of(inverse, found.response, self._modal()), ""
        except RecordError as error:
            plant, remark = None, f"no plant is found: {error}"
        return self._result(found, used, lines, elements, plant, remark)

    def _modal(self) -> ModalFit:
        return ModalFit(
            method=Conventional(),
            modes=self.modes,
            lowest=self.lowest,
            highest=self.highest,
            dead_time=0.0,
            floor=self.plant_floor,
        )

    def _observer(self, friction: FrictionModel) -> ElementObserver:
        fields = set(ElementObserver.model_fields) & set(type(self).model_fields)
        return ElementObserver(friction=friction, **{name: getattr(self, name) for name in fields})

    def _elements(self, signals: Signals) -> tuple[SpectralLines, AutonomousElements]:
        """Return what the records tell at each line, and the elements in them."""
        bare = self._observer(Frictionless())
        grid = self._grid(signals, bare)
        lines = lines_of(signals, bare, grid)
        if not lines.equations:
            raise RecordError(
                "autonomous needs each line in several records, but there is one of each: record two amplitudes, a "
                "factor of 2 apart (excitation 'sequence'), or realisations of a multisine"
            )
        power, peak = np.abs(lines.thrust) ** 2, _greatest(signals, self.input)
        elements = fitted(lines, grid, FIRST_ERROR**2 * power, peak)
        for _ in range(PASSES):
            observer = self._observer(elements.model()) if elements.stiffness.any() else bare
            noise = variances(signals, lines, observer, elements.inverse)
            elements = fitted(lines, grid, noise + self.floor**2 * power, peak)
        return lines, elements

    def _grid(self, signals: Signals, observer: ElementObserver) -> np.ndarray:
        """Return thresholds [m] from below the smallest line's amplitude to the greatest motion."""
        bare = lines_of(signals, observer, np.empty(0))
        greatest = _greatest(signals, self.output)
        smallest = max(float(np.abs(bare.motion[bare.known]).min()), 2 * self.resolution, 2 * self.noise)
        return np.geomspace(max(min(smallest / 2, greatest / 10), greatest / SPAN), TOP * greatest, self.thresholds)

    def _check(self, lines: SpectralLines, elements: AutonomousElements) -> None:
        """Raise RecordError for records that differ no more than noise does, or not as friction has it."""
        before, explained = _median(scatter_of(lines, lines.thrust)), _median(elements.floor)
        if before >= VISIBLE * explained and elements.stiffness.any():
            return
        remedy = "take amplitudes a factor of 2 apart; if it stays so there is no friction to be found"
        if explained > HIDDEN:
            remedy = "the motion is hidden by noise: raise the amplitude, or take a finer scale"
        elif before >= VISIBLE * explained:
            remedy = "no friction does that: look at the channels and their signs"
        raise RecordError(
            f"autonomous: y'/u differs by {before:.2g} from record to record, where noise explains {explained:.2g}: "
            f"{remedy}"
        )

    def _response(self, signals: Signals, lines: SpectralLines, elements: AutonomousElements) -> Result:
        """Return P̂ before anything linear is taken off."""
        effective = np.abs(lines.thrust - lines.deflection @ elements.stiffness)
        response = 1 / elements.inverse
        variance = np.abs(response) ** 4 * elements.noise
        count = lines.known.sum(axis=1)
        parts, begin = [], 0
        for group in lines.groups:
            segments = tuple(signals.segments[place] for place in group)
            rows = slice(begin, begin + segments[0].lines.size)
            begin = rows.stop
            parts.append(
                Part(
                    segments,
                    lines.frequency[rows],
                    response[rows],
                    circular(variance[rows]),
                    np.inf,
                    (np.where(lines.known, effective, 0.0).sum(axis=1) / count)[rows],
                    (np.abs(lines.motion).sum(axis=1) / count)[rows],
                )
            )
        units = signals.unit(self.input), signals.unit(self.output)
        found = combined(signals, parts, names=(EFFECTIVE_INPUT, self.output), units=units)
        assert found.response is not None
        inverse = Inverse(lines.frequency, elements.inverse, elements.noise, elements.inverse_columns)
        return replace(found, response=replace(found.response, model_covariance=inverse.of_friction()))

    def _result(
        self,
        found: Result,
        signals: Signals,
        lines: SpectralLines,
        elements: AutonomousElements,
        plant: PlantFound | None,
        remark: str,
    ) -> Result:
        quality = _Quality(lines, elements, self.tolerance)
        against = [*quality.remarks(), *([remark] if remark else []), *(_of_plant(plant) if plant else ())]
        remarks = [found.message, *against, *_hints(elements, plant, _greatest(signals, self.output))]
        plants = plant.fit.metrics if plant else ()
        verdict = Metric("verdict", float(not against), "1")
        viscous = (plant.viscous, plant.viscous_deviation) if plant else (0.0, 0.0)
        spring = (plant.spring, _greatest(signals, self.output)) if plant else (0.0, 0.0)
        return replace(
            found,
            message="; ".join(text for text in remarks if text),
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
    """How well the records agree."""

    lines: SpectralLines
    elements: AutonomousElements
    tolerance: float

    @property
    def before(self) -> np.ndarray:
        return scatter_of(self.lines, self.lines.thrust)

    @property
    def ratio(self) -> float:
        return float(np.sqrt(self.elements.excess))

    @property
    def explained(self) -> bool:
        """Whether noise, or `tolerance`, explains what is left."""
        return self.ratio <= MARGIN or _median(self.elements.scatter) <= self.tolerance

    def metrics(self) -> tuple[Metric, ...]:
        return (
            Metric("scatter before", _median(self.before), "1"),
            Metric("scatter after", _median(self.elements.scatter), "1"),
            Metric("noise floor", _median(self.elements.floor), "1"),
            Metric("ratio", self.ratio, "1"),
        )

    def remarks(self) -> Iterator[str]:
        """Yield what speaks against the friction model."""
        if not self.explained:
            yield (
                "friction elements do not explain the records: y'/û_e scatters by "
                f"{_median(self.elements.scatter):.2g} where noise explains {_median(self.elements.floor):.2g}: look "
                "at delays and gains; or friction depends on velocity or position"
            )

    def curve(self) -> Curve:
        order = np.argsort(self.lines.frequency, kind="stable")
        columns = {
            "frequency": self.lines.frequency,
            "scatter before": self.before,
            "scatter after": self.elements.scatter,
            "noise floor": self.elements.floor,
        }
        units = dict.fromkeys(columns, "1") | {"frequency": "Hz"}
        return Curve("agreement of the records", {name: column[order] for name, column in columns.items()}, units)


def _median(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else float("nan")


def _greatest(signals: Signals, channel: str) -> float:
    """Return half the greatest swing of a channel [its unit]."""
    return float(max(np.ptp(segment.channels[channel]) for segment in signals.segments)) / 2


def _friction_metrics(elements: AutonomousElements, viscous: tuple[float, float]) -> tuple[Metric, ...]:
    force, deviation = elements.coulomb
    return (
        Metric("Coulomb force", force, "N"),
        Metric("Coulomb force, 95 %", NORMAL * deviation, "N"),
        Metric("width at 63 %", _width(elements), "m"),
        Metric("viscous coefficient", viscous[0], "N s/m"),
        Metric("viscous coefficient, 95 %", NORMAL * viscous[1], "N s/m"),
        Metric("elements", float(len(elements.merging)), "1"),
    )


def _width(elements: AutonomousElements) -> float:
    """Return the displacement [m] at which the virgin curve reaches 1 - 1/e of ΣF_m."""
    x = np.concatenate([[0.0], elements.thresholds])  # straight lines between them
    force = elements.virgin_curve(x)[0]
    return float(np.interp(MEAN_WIDTH * force[-1], force, x))


def _fit(elements: AutonomousElements, viscous: tuple[float, float], spring: tuple[float, float]) -> Fit:
    """Return the friction model with the covariance of its parameters.

    A stiffness that never slips is an element that slips beyond the greatest motion: its force is held, not known.
    """
    stiffness, force = np.split(elements.model_values, 2)
    count, held = stiffness.size, max(viscous[0], 0.0)
    if spring[0]:
        stiffness, force = np.append(stiffness, spring[0]), np.append(force, spring[0] * spring[1])
    model = Rolling(stiffness=stiffness.tolist(), limit_force=force.tolist(), viscous_coefficient=held)
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
        np.concatenate([stiffness, force, [held]]),
        covariance,
    )


def _of_plant(plant: PlantFound) -> Iterator[str]:
    """Yield what speaks against the plant."""
    cost = next(metric.value for metric in plant.fit.metrics if metric.name == "cost")
    if cost > MARGIN**2:
        yield plant.fit.message or "the plant model does not fit: try more modes or a narrower band"
    (fit,) = plant.fit.fits
    relative = float(fit.standard_deviation[0] / fit.values[0])
    if relative > TOLD:
        yield f"the plant's gain is told to {NORMAL * relative:.0%} only: raise the amplitude, or record more lines"


def _hints(elements: AutonomousElements, plant: PlantFound | None, greatest: float) -> Iterator[str]:
    """Yield what the records cannot tell."""
    rest = float(elements.forces[elements.thresholds > SLIPS * greatest].sum()) / max(elements.coulomb[0], 1e-300)
    if rest > REST or (plant and plant.spring):
        held = (
            f", and {plant.spring:.3g} N/m never slip: they are taken for an element that slips beyond it"
            if plant and plant.spring
            else ""
        )
        yield (
            f"the motion, {greatest:.2g} m at most, hardly leaves presliding, so that the Coulomb force is not told"
            f"{held}; raise the amplitude"
        )
