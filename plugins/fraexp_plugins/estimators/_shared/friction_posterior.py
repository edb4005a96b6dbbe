"""What the harmonics of the motion tell of an uncertain friction model: the posterior of its errors.

A sine excites its own frequency only. What the axis does at a multiple of it, friction does. Where that multiple lies
among the measured frequencies the plant is known there, so y'/P, the force that must have moved the axis, is compared
with the effective input û_e, in which the friction model's force is most of what there is. Neither the amplitude nor
the plant needs to be known.

The errors of the model are counted in their prior standard deviations, so that their prior is a standard normal
distribution. Where no harmonic tells anything, the posterior is the prior.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    SIGNIFICANCE,
    Encoder,
    FrequencyResponse,
    Segment,
    circle_factor,
    degrees_of_freedom,
    phasor_variance,
    phasors,
    record_spectrum,
)
from fraexp_plugins.estimators._shared.delayed_estimator import DelayedEstimator
from fraexp_plugins.estimators._shared.effective_input_observer import is_from_rest

MAX_ORDER = 25
"""Highest harmonic that is examined: those of dry friction fall with the order, and hide in the encoder's noise."""
LAW_ERRORS = (1.0, 0.3, 0.1, 0.03, 0.01, 3e-3, 1e-3, 3e-4, 1e-4)
"""Errors of the law itself, over its force at a harmonic, one of which is the most probable. They are tried in this
order: of a law that may be off by 100 % all harmonics point to the right model, wherever one begins."""
NUMERICS = 1e-4
"""Error of the force at a harmonic by the interpolation of the motion, over that of dry friction there: even ones have
hardly any force of their own."""
ARBITRARY = 0.05
"""Probability of a harmonic that tells nothing, as one beside a mode between two frequencies: it may lack any force."""
STEP = 0.25
"""Half width of central differences, in prior standard deviations."""
STEP_PARTS = (1.0, 0.5, 0.25, 0.1)
"""Parts of a step of the search that are tried."""
STARTS = 12
"""Errors drawn from the prior, at the most probable of which the search begins: it is not unimodal."""
MAX_STEPS, SMALL_STEP = 4, 0.01
"""Steps with one error of the law, and the size of one that is not worth the way, in posterior standard deviations."""

MAX_FREQUENCY_RATIO = 1.5
"""Ratio of two neighbouring frequencies, at most, between which the plant is interpolated: more may hide a mode."""
MAX_BEND = 0.5
"""Distance of a value from the straight line between its neighbours, relative to the greatest of them, from which an
antiresonance may lie there."""

ForceTerms = Callable[[NDArray[np.float64]], Sequence[NDArray[np.complex128]]]
"""Returns all friction as thrust [N] for errors of the model, shape (p,): of each segment the terms at its excited line
and the multiples of that, shape (orders,)."""
Stiffness = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Returns the greatest change of the friction force by an error of the output [N/m], at ω [rad/s]."""


class FrictionPosterior(NamedTuple):
    """The errors of a friction model, in prior standard deviations."""

    mean: NDArray[np.float64]
    """Most probable errors, shape (p,)."""
    root: NDArray[np.float64]
    """Columns whose outer products add up to their covariance, shape (p, p)."""
    law_error: float = 0.0
    """Most probable error of the law itself, over the friction force: what such errors do not explain."""
    harmonics: int = 0
    """Number of harmonics from which this follows; 0 if the prior stands."""
    examined: int = 0
    """Number of harmonics between frequencies that are close enough for them to tell anything."""

    @classmethod
    def prior(cls, count: int) -> "FrictionPosterior":
        """Return the prior of a number of errors."""
        return cls(np.zeros(count), np.eye(count))

    @property
    def distance(self) -> float:
        """Distance of the errors from what is stated, in prior standard deviations."""
        return float(np.linalg.norm(self.mean))

    @property
    def is_far(self) -> bool:
        """Whether harmonics contradict what is stated: errors so great have at most the significance as probability.

        Of a law of another kind they are the nearest ones, and their covariance means nothing.
        """
        from scipy.special import chdtri  # slow to import: listing plugins must stay fast

        return bool(self.mean.size and self.distance**2 > chdtri(self.mean.size, SIGNIFICANCE))


class ForceErrors(NamedTuple):
    """Errors of the output and of all friction as thrust, at lines of a segment, shape (…, lines)."""

    output: NDArray[np.complex128]
    """[m]."""
    force: NDArray[np.complex128]
    """[N]."""


class MotionErrors(NamedTuple):
    """What the encoder hides of the motion in a segment, and so of the force, at its lines or at `harmonic_lines`."""

    motion: NDArray[np.complex128]
    """The most probable terms of the output [m], shape (lines,)."""
    mean: ForceErrors
    """Shape (lines,)."""
    deviations: ForceErrors
    """Errors whose squares add up to the variance, shape (k, lines)."""


class SineRecord(NamedTuple):
    """A record of sines, and the response that an estimator found of it with the stated friction model."""

    estimator: DelayedEstimator
    segments: Sequence[Segment]
    """One for each frequency."""
    encoder: Encoder
    """Noise and rounding of the estimator's output."""
    response: FrequencyResponse
    hidden: NDArray[np.float64]
    """Greatest amplitude of the force that standstill hides at a line of each segment [N], shape (segments,)."""
    errors: Sequence[MotionErrors] | None
    """What the encoder hides in each segment; if it is None noise and rounding act on the stiffest friction."""

    @property
    def has_harmonics(self) -> bool:
        """Whether harmonics of its sines may lie among its frequencies."""
        return len(self.segments) > 2 and all(map(_is_sine, self.segments))


class _Look(NamedTuple):
    """What the harmonics say of a friction model with certain errors, shape (n,) each."""

    errors: NDArray[np.float64]
    """Errors of the model, shape (p,)."""
    law_error: float
    """Error of the law itself, over its force."""
    lacking: NDArray[np.complex128]
    """Thrust less friction less what moves the plant [N]."""
    deviation: NDArray[np.float64]
    """Its standard deviation by encoder, plant and numerics [N]."""
    scale: NDArray[np.float64]
    """Force of the stated model at the harmonic [N]."""
    known: NDArray[np.bool_]
    """Where the plant is known, and the others tell nothing."""

    @property
    def size(self) -> NDArray[np.float64]:
        """What lacks, in its standard deviations."""
        return np.asarray(np.abs(self.lacking) / self.deviation)

    @property
    def densities(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The densities of what lacks where the harmonic tells something, and where it does not, times π scale²."""
        normal = np.exp(-(self.size**2)) * (self.scale / self.deviation) ** 2
        return np.where(self.known, (1 - ARBITRARY) * normal, 0.0), np.full(self.known.size, ARBITRARY)

    @property
    def weight(self) -> NDArray[np.float64]:
        """Probability that a harmonic tells something."""
        telling, arbitrary = self.densities
        return np.asarray(telling / (telling + arbitrary))

    @property
    def cost(self) -> float:
        """-ln of the posterior, but for a constant."""
        return float(-np.sum(np.log(np.add(*self.densities))) + self.errors @ self.errors / 2)


def friction_posterior(
    record: SineRecord, force_terms: ForceTerms, stiffness: Stiffness, count: int
) -> FrictionPosterior:
    """Return the posterior of `count` errors of a friction model; without any, the error of its law alone."""
    prior = FrictionPosterior.prior(count)
    if not record.has_harmonics:
        return prior
    harmonics = _Harmonics(record, force_terms, stiffness, count)
    errors = _nearest_start(harmonics, count)
    for law_error in LAW_ERRORS:
        known = harmonics.known(errors)
        errors = _most_probable(harmonics, errors, law_error, known).errors
    known = harmonics.known(errors)
    looks = (harmonics.look(errors, each, known) for each in reversed(LAW_ERRORS))  # the least one where all are alike
    found = min(looks, key=lambda look: look.cost)
    posterior = _posterior(harmonics, _most_probable(harmonics, errors, found.law_error, known))
    return posterior._replace(examined=int(harmonics.close.sum()))


def _nearest_start(harmonics: "_Harmonics", count: int) -> NDArray[np.float64]:
    """Return the most probable ones of the stated model and of errors drawn from the prior, if the law may be off."""
    drawn = np.random.default_rng(STARTS).standard_normal((STARTS, count)) if count else np.empty((0, 0))
    close = harmonics.close
    looks = [harmonics.look(errors, LAW_ERRORS[0], close) for errors in (np.zeros(count), *drawn)]
    return min(looks, key=lambda look: look.cost).errors


def _most_probable(
    harmonics: "_Harmonics", errors: NDArray[np.float64], law_error: float, known: NDArray[np.bool_]
) -> _Look:
    """Return the most probable errors near some, if the law itself has that error."""
    found = harmonics.look(errors, law_error, known)
    for _ in range(MAX_STEPS if errors.size else 0):
        gradient, curvature = harmonics.slopes(found)
        step = -np.linalg.solve(curvature, gradient)
        if -gradient @ step < SMALL_STEP**2:
            break
        tried = (harmonics.look(found.errors + part * step, law_error, known) for part in STEP_PARTS)
        following = next((look for look in tried if look.cost < found.cost), None)
        if following is None:
            break
        found = following
    return found


def _posterior(harmonics: "_Harmonics", found: _Look) -> FrictionPosterior:
    """Return the posterior around its maximum; harmonics that scatter more than they should tell less."""
    telling, count = round(found.weight.sum()), found.errors.size
    law_error = found.law_error if telling else 0.0
    if not count:
        return FrictionPosterior(found.errors, np.empty((0, 0)), law_error, telling)
    slope, counts = harmonics.slope(found), found.weight > 0
    information = (found.weight * np.sum(np.abs(slope) ** 2, axis=1))[counts] / found.deviation[counts] ** 2
    excess = np.sum(information * found.size[counts] ** 2) / max(np.sum(information), 1e-300)
    evidence = harmonics.slopes(found)[1] - np.eye(count)
    values, vectors = np.linalg.eigh(np.linalg.inv(evidence / max(excess, 1.0) + np.eye(count)))
    return FrictionPosterior(found.errors, vectors * np.sqrt(values), law_error, telling)


class _PlantCurve(NamedTuple):
    """The apparent mass -1/(ω² P) [kg] over ln ω, shape (n,): linear in friction, smooth but for antiresonances."""

    place: NDArray[np.float64]
    value: NDArray[np.complex128]
    deviation: NDArray[np.float64]
    """What its band has for radius [kg]; 0 where it is unknown."""

    @classmethod
    def of(cls, omega: NDArray[np.float64], inverse: NDArray[np.complex128], deviation: NDArray[np.float64]) -> Self:
        """Return the curve through 1/P [N/m] at ω [rad/s], with the radius of its band [N/m], shape (n,) each."""
        usable = np.isfinite(inverse) & ~np.isinf(deviation)
        omega, inverse, deviation = omega[usable], inverse[usable], deviation[usable]
        place, order = np.unique(np.log(omega), return_index=True)
        mass = -inverse[order] / omega[order] ** 2
        return cls(place, mass, np.nan_to_num(deviation[order], nan=0.0) / omega[order] ** 2)

    @property
    def has_close_frequencies(self) -> bool:
        """Whether the plant is known between any two frequencies, with others beside them."""
        return self.place.size > 2 and float(np.diff(self.place).min()) <= np.log(MAX_FREQUENCY_RATIO)

    def is_close(self, omega: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether frequencies [rad/s] lie between two that are close to each other, shape (k,)."""
        place = np.log(omega)
        inside = (place >= self.place[0]) & (place <= self.place[-1])
        return np.asarray(inside & (np.diff(self.place)[self._left(omega)] <= np.log(MAX_FREQUENCY_RATIO)))

    def is_known(self, omega: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether frequencies [rad/s] lie between two that are close, without a mode between them, shape (k,).

        An antiresonance between two frequencies bends the curve at both.
        """
        share = (self.place[1:-1] - self.place[:-2]) / (self.place[2:] - self.place[:-2])
        bend = np.abs(self.value[1:-1] - (1 - share) * self.value[:-2] - share * self.value[2:])
        greatest = np.abs(np.stack([self.value[1:-1], self.value[:-2], self.value[2:]])).max(axis=0)
        is_smooth = np.concatenate([[True], bend <= MAX_BEND * greatest, [True]])
        return np.asarray(self.is_close(omega) & (is_smooth[:-1] & is_smooth[1:])[self._left(omega)])

    def sharing(self, omega: NDArray[np.float64], counts: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return how many of the frequencies that count lie between the same two, and share their error, shape (k,)."""
        left = self._left(omega)
        return np.maximum(np.bincount(left[counts], minlength=self.place.size)[left], 1.0)

    def inverse(self, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return 1/P [N/m] by cubics whose slopes at both ends are those of parabolas, shape (k,)."""
        return np.asarray(-self._mass(np.log(omega)) * omega**2)

    def error(self, omega: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the standard deviation of that [N/m], shape (k,): of the values, and of the cubics between them.

        Towards a mode it grows by orders of magnitude, so that its logarithm is interpolated.
        """
        every = np.hypot(self.deviation, self._interpolation_error())
        return np.asarray(np.exp(np.interp(np.log(omega), self.place, np.log(every + 1e-300))) * omega**2)

    def _interpolation_error(self) -> NDArray[np.float64]:
        """Return the error of the cubics at each value [kg], shape (n,); the first and the last take their neighbour's.

        Without it the cubic through every second value is off by 2³ times as much: it is of third order.
        """
        error = np.zeros(self.place.size)
        for own, others in ((slice(1, -1, 2), slice(0, None, 2)), (slice(2, -1, 2), slice(1, None, 2))):
            if error[own].size:
                rest = _PlantCurve(self.place[others], self.value[others], self.deviation[others])
                error[own] = np.abs(self.value[own] - rest._mass(self.place[own])) / 2**3
        error[[0, -1]] = error[[1, -2]]
        return error

    def _mass(self, place: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the apparent mass [kg] at ln ω, shape (k,)."""
        from scipy.interpolate import CubicHermiteSpline  # slow to import: listing plugins must stay fast

        slope = np.gradient(self.value, self.place)
        return np.asarray(CubicHermiteSpline(self.place, self.value, slope)(place))

    def _left(self, omega: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the number of the value below each frequency [rad/s], of the first two or the last two beyond all."""
        return np.asarray(np.clip(np.searchsorted(self.place, np.log(omega)) - 1, 0, self.place.size - 2))


class _Harmonics:
    """The harmonics of all segments that lie among the measured frequencies, shape (n,) each."""

    def __init__(self, record: SineRecord, force_terms: ForceTerms, stiffness: Stiffness, count: int) -> None:
        self.response, self.hidden = record.response, record.hidden
        # The search returns to errors that it has just tried.
        self.force_terms = lru_cache(lambda errors: force_terms(np.array(errors)))
        highest = float(record.response.frequency.max())
        output = record.estimator.output
        self.orders = [_examined_orders(segment, output, highest) for segment in record.segments]
        alike = _rounded_alike(record)
        numbers = range(len(record.segments))
        parts = [_measured(record, stiffness, *each) for each in zip(numbers, self.orders, alike.tolist(), strict=True)]
        columns = (np.concatenate(each) for each in zip(*parts, strict=True))
        self.omega, self.motion, self.thrust, self.motion_deviation, self.force_deviation = columns
        self.unseen = np.repeat(record.hidden, [orders.size for orders in self.orders])
        self.output = np.array([phasors(segment, output)[:, 0].mean() for segment in record.segments])
        self.stated, force = self._forces(np.zeros(count))
        excited = [np.abs(each) / orders for each, orders in zip(self.stated, self.orders, strict=True)]
        self.force, self.numerics = np.abs(force), NUMERICS * np.concatenate(excited)
        self.scale = np.hypot(self.force, 10 * self.numerics)

    def _forces(self, errors: NDArray[np.float64]) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Return the terms of friction at the excited lines and at the harmonics [N]."""
        terms = self.force_terms(tuple(errors.tolist()))
        at_harmonics = [each[orders - 1] for each, orders in zip(terms, self.orders, strict=True)]
        return np.array([each[0] for each in terms]), np.concatenate(at_harmonics)

    def _plant(self, excited: NDArray[np.complex128]) -> _PlantCurve:
        """Return the plant that follows from such friction at the excited lines [N]."""
        found, settled = self.response, self.response.settled
        with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
            inverse = 1 / found.response + (self.stated - excited) / self.output
            radius = np.hypot(_relative_radius(found) / np.abs(found.response), self.hidden / np.abs(self.output))
        return _PlantCurve.of(2 * np.pi * found.frequency[settled], inverse[settled], radius[settled])

    @property
    def close(self) -> NDArray[np.bool_]:
        """Which harmonics lie between close frequencies."""
        plant = self._plant(self.stated)
        return plant.is_close(self.omega) if plant.has_close_frequencies else np.zeros(self.omega.size, dtype=bool)

    def known(self, errors: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return at which harmonics the plant is known that follows from such errors."""
        plant = self._plant(self._forces(errors)[0])
        return plant.is_known(self.omega) if plant.has_close_frequencies else np.zeros(self.omega.size, dtype=bool)

    def look(self, errors: NDArray[np.float64], law_error: float, known: NDArray[np.bool_]) -> _Look:
        """Return what the harmonics say of such errors, where the plant is known."""
        if not known.any():
            none = np.zeros(known.size, dtype=complex)
            return _Look(errors, law_error, none, np.ones(known.size), self.scale, known)
        excited, force = self._forces(errors)
        plant = self._plant(excited)
        inverse = plant.inverse(self.omega)
        by_plant = np.abs(self.motion) * plant.error(self.omega) * np.sqrt(plant.sharing(self.omega, known))
        by_motion, by_law = self.motion_deviation * np.abs(inverse), law_error * self.force
        parts = (by_plant, by_motion, self.force_deviation, by_law, self.unseen, self.numerics)
        deviation = np.linalg.norm(parts, axis=0)
        return _Look(errors, law_error, self.thrust - force - self.motion * inverse, deviation, self.scale, known)

    def slope(self, place: _Look) -> NDArray[np.complex128]:
        """Return the derivative of what lacks by the errors [N], shape (n, p)."""
        steps = STEP * np.eye(place.errors.size)
        sides = [
            [self.look(place.errors + side * step, place.law_error, place.known).lacking for side in (1.0, -1.0)]
            for step in steps
        ]
        return np.stack([(above - below) / (2 * STEP) for above, below in sides], axis=1)

    def slopes(self, place: _Look) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return gradient and curvature of the cost at a place, shape (p,) and (p, p)."""
        counts = place.weight > 0
        slope, weight = self.slope(place)[counts], (2 * place.weight / place.deviation**2)[counts]
        gradient = np.real(slope.conj().T @ (weight * place.lacking[counts])) + place.errors
        curvature = np.real(slope.conj().T @ (weight[:, None] * slope)) + np.eye(place.errors.size)
        return gradient, curvature


def harmonic_lines(segment: Segment) -> NDArray[np.int64]:
    """Return the excited line of a sine and its multiples below the Nyquist frequency, shape (orders,)."""
    line = int(segment.lines[0])
    return line * np.arange(1, max(min(MAX_ORDER, (segment.samples - 1) // (2 * line)), 1) + 1)


def _is_sine(segment: Segment) -> bool:
    return segment.lines.size == 1 and segment.periodic and not segment.stated and not is_from_rest(segment)


def _examined_orders(segment: Segment, output: str, highest: float) -> NDArray[np.int64]:
    """Return the orders of the harmonics up to the highest frequency [Hz]; none where it stands, or has not settled."""
    if (segment.settling is not None and not segment.settling.settled) or not np.ptp(segment.channels[output]):
        return np.empty(0, dtype=np.int64)
    count = min(harmonic_lines(segment).size, int(highest / segment.frequency[0] * (1 + 1e-9)))
    return np.arange(2, count + 1)


def _rounded_alike(record: SineRecord) -> NDArray[np.int64]:
    """Return of each segment how many move as far but for a step of the encoder: they share their rounding error."""
    sizes = np.array([np.ptp(segment.channels[record.estimator.output]) for segment in record.segments]) / 2
    return np.asarray(np.sum(np.abs(sizes[:, None] - sizes) <= record.encoder.resolution, axis=1))


def _measured(
    record: SineRecord, stiffness: Stiffness, number: int, orders: NDArray[np.int64], alike: int
) -> tuple[NDArray[np.float64] | NDArray[np.complex128], ...]:
    """Return frequency [rad/s], motion [m] and thrust [N] at harmonics of a segment, and deviations, (k,) each.

    Those are of the motion [m] and of friction [N], by the encoder. What that does to the force in the mean is taken
    off the thrust. Drawn motions take weak terms for nothing: what noise hides of a term acts on the stiffest friction.
    """
    segment, estimator, places = record.segments[number], record.estimator, orders - 1
    lines = orders * int(segment.lines[0])
    omega, thrust = line_omega(segment, lines), thrust_terms(estimator, segment)[places]
    motion = record_terms(segment, estimator.output, lines)
    shown, stated = _term_deviations(segment, estimator.output, record.encoder, alike)
    by_force = shown * stiffness(omega)
    if record.errors is not None:
        likely, *errors = record.errors[number]
        mean, deviations = (each.force[..., places] for each in errors)
        motion, thrust = likely[places], thrust - mean
        by_force = np.maximum(by_force, shown / stated * np.linalg.norm(deviations, axis=0))
    return omega, motion, thrust, np.full(lines.size, shown), by_force


def thrust_terms(estimator: DelayedEstimator, segment: Segment) -> NDArray[np.complex128]:
    """Return the terms of G_di G_do u [N] at the excited line of a sine and at its multiples, shape (orders,)."""
    lines = harmonic_lines(segment)
    omega = line_omega(segment, lines)
    path = estimator.input_path(omega, segment.sample_time) * estimator.output_path(omega)
    return np.asarray(path * record_terms(segment, estimator.input, lines))


def line_omega(segment: Segment, lines: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the frequencies of lines of a period [rad/s], shape (k,)."""
    return np.asarray(2 * np.pi / (segment.samples * segment.sample_time) * lines, dtype=float)


def record_terms(segment: Segment, channel: str, lines: NDArray[np.int64]) -> NDArray[np.complex128]:
    """Return the Fourier terms of a channel at lines of a period, shape (k,)."""
    periods = segment.channels[channel]
    return record_spectrum(segment, channel)[lines * len(periods)] * (2 / periods.size)


def _term_deviations(segment: Segment, channel: str, encoder: Encoder, alike: int) -> tuple[float, float]:
    """Return the standard deviation of a term of y' [m], and that of a stated encoder in a segment by itself.

    Segments that are `alike` share their rounding, and a record may show more noise than the encoder has: between the
    terms of a periodic motion is noise alone; of a single period the upper half of the terms is mostly so.
    """
    y = segment.channels[channel]
    rounding, noise = phasor_variance(segment, encoder._replace(noise=0.0), channel)[0], 4 * encoder.noise**2 / y.size
    terms = record_spectrum(segment, channel)
    between = terms[terms.size // 2 :] if len(y) == 1 else terms[np.arange(terms.size) % len(y) != 0]
    shown = (between.real**2 + between.imag**2).mean() * (2 / y.size) ** 2
    return float(np.sqrt(max(alike * rounding + noise, shown))), float(np.sqrt(rounding + noise))


def _relative_radius(response: FrequencyResponse) -> NDArray[np.float64]:
    """Return the radius of the 95 % circle relative to the response, shape (n,); NaN where it is unknown."""
    with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
        return np.asarray(
            circle_factor(degrees_of_freedom(response)) * response.standard_deviation / np.abs(response.response)
        )
