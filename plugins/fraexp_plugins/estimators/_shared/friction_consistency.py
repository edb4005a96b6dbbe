"""The friction model against the harmonics of the motion: a wrong one makes another plant of them than of the sines.

A sine excites its own frequency only. What the axis does at a multiple of it, friction does. Where that multiple lies
among the measured frequencies the plant is known there, so y'/P, the force that must have moved the axis, is compared
with the effective input û_e, in which the friction model's force is most of what there is. Their difference over the
friction force is the relative error of the model. Neither the amplitude nor the plant needs to be known.

Friction may act at several contacts. Each force counts as the thrust that moves the output as it does.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Encoder, FrequencyResponse, Segment, phasor_variance, record_spectrum
from fraexp_plugins.estimators._shared.delayed_estimator import DelayedEstimator
from fraexp_plugins.estimators._shared.effective_input_observer import ObserverEstimator, is_from_rest
from fraexp_plugins.estimators._shared.model_covariance import relative_radius

MAX_ORDER = 25
"""Highest harmonic that is examined."""
MIN_HARMONICS = 3
"""Number of harmonics, at least, from which a friction model is judged."""
MIN_CONTRADICTIONS, CONTRADICTING_SHARE = 2, 0.15
"""Harmonics that contradict a friction model, at least, and their share of those that count: a few may be wrong by
a mode between two frequencies."""
UNCERTAINTIES = 2.0
"""Error of the force at a harmonic, over its uncertainty, from which it contradicts."""
MAX_SEGMENTS = 10
"""Segments that are examined, at most."""
MAX_UNCERTAINTY = 0.1
"""Relative uncertainty of the force at a harmonic, by encoder and by the plant between two measured frequencies, up to
which it counts."""
MIN_MODEL_ERROR = 0.005
"""Relative error of a friction model that counts as one: below it are the numerics of the motion."""
STATED_STDS = 2.0
"""Standard deviations of what is stated as uncertain that count as uncertainty of the force."""
CLEAR_STDS = 3.0
"""Size of a harmonic, in its standard deviations by the encoder, from which it is examined."""
MAX_FREQUENCY_RATIO = 1.5
"""Ratio of two neighbouring frequencies, at most, between which the plant is interpolated: more may hide a mode."""
MAX_BEND = 0.5
"""Distance of ln P from the straight line between the frequencies beside it, from which there may be a mode."""
MIN_FORCE_RATIO = 1e-3
"""Friction force at a harmonic over that at the fundamental, from which it is examined."""


class ModelError(NamedTuple):
    """How wrong a friction model is, as the harmonics show it."""

    size: float
    """Relative error of its force: the median over the harmonics."""
    force: NDArray[np.float64]
    """Amplitude of the friction force at the excited frequencies [N], shape (n,)."""

    def response_error(self, found: FrequencyResponse) -> NDArray[np.float64]:
        """Return the relative error of the response to û_e that follows from it, shape (n,)."""
        with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
            return np.nan_to_num(self.size * self.force / found.input_amplitude, posinf=np.inf)


class ContactFriction(NamedTuple):
    """The friction model's force at a contact along a record, and how it acts on the measured position."""

    observer: ObserverEstimator
    """Its `output` is the channel of the contact's displacement."""
    segments: Sequence[Segment]
    """The record with that channel."""
    forces: Sequence[NDArray[np.float64]]
    """The model's force along each segment, as the observer gives it."""
    thrust_ratio: Callable[[NDArray[np.float64]], NDArray[np.complex128] | NDArray[np.float64]]
    """Returns the thrust that moves the output as a unit of the force does, at ω [rad/s]."""
    error_ratio: Callable[[NDArray[np.float64]], NDArray[np.float64]]
    """Returns the error of the displacement over that of a measured position, at ω [rad/s]."""

    @classmethod
    def of_output(
        cls, observer: ObserverEstimator, segments: Sequence[Segment], forces: Sequence[NDArray[np.float64]]
    ) -> Self:
        """Return it for the one contact of a machine, whose displacement is the output."""

        def one(omega: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.ones(omega.size)

        return cls(observer, segments, forces, one, one)

    def terms(self, number: int, lines: NDArray[np.int64]) -> NDArray[np.complex128]:
        """Return the Fourier terms of all its friction as thrust [N] in the segment of this number, shape (k,)."""
        observer, segment, force = self.observer, self.segments[number], self.forces[number]
        mean = force[0] if len(force) == 1 else np.add.reduce(force, axis=0) / len(force)
        omega = _omega(segment, lines)
        found = np.fft.rfft(mean)[lines] * (2 / mean.size) * observer.force_factor(omega)
        found += 1j * omega * observer.friction.viscous * _terms(segment, observer.output, lines)
        return np.asarray(self.thrust_ratio(omega) * found)

    def force_deviation(self, omega: NDArray[np.float64], deviation: float) -> NDArray[np.float64]:
        """Return the standard deviation of the terms [N], from that of a position's term [m], shape (k,)."""
        observer = self.observer
        stiffness = observer.friction.max_stiffness * observer.force_scale / observer.displacement_scale
        return np.asarray(np.abs(self.thrust_ratio(omega)) * stiffness * self.error_ratio(omega) * deviation)


class StatedDeviation(NamedTuple):
    """Friction as it would be if something stated as uncertain were greater, and less."""

    above: Sequence[ContactFriction]
    below: Sequence[ContactFriction]
    steps: float
    """How many standard deviations greater and less."""

    def deviation(self, number: int, lines: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the standard deviation of the terms of all friction [N] in the segment of this number, shape (k,)."""
        above, below = (np.add.reduce(_contact_terms(each, number, lines), axis=0) for each in self[:2])
        return np.asarray(np.abs(above - below) / (2 * self.steps))


class _Harmonics(NamedTuple):
    """Harmonics of a motion that friction causes, shape (k,) each."""

    omega: NDArray[np.float64]
    """Frequencies [rad/s]."""
    sample_time: NDArray[np.float64]
    """Sample time of the segment [s]."""
    motion: NDArray[np.complex128]
    """Terms of y' [m]."""
    input: NDArray[np.complex128]
    """Terms of the control input [N]."""
    force: NDArray[np.complex128]
    """Terms of all friction as thrust [N]."""
    motion_deviation: NDArray[np.float64]
    """Standard deviation of the terms of y' [m]."""
    force_deviation: NDArray[np.float64]
    """Standard deviation of the terms of all friction [N]."""
    shares: NDArray[np.float64]
    """Size of each contact's force over that of all friction, shape (k, contacts)."""


class _ForceErrors(NamedTuple):
    """How far the friction force is off at harmonics, shape (k,)."""

    error: NDArray[np.float64]
    """Relative to the force."""
    uncertainty: NDArray[np.float64]
    """What encoder and plant contribute to it."""
    shares: NDArray[np.float64]
    """Size of each contact's force over that of all friction, shape (k, contacts)."""


class _PlantCurve(NamedTuple):
    """ln(-ω² P) over ln ω, shape (n,): smooth but for the modes."""

    place: NDArray[np.float64]
    value: NDArray[np.complex128]
    radius: NDArray[np.float64]
    """Relative radius of the confidence band; 0 where it is unknown."""

    @classmethod
    def of(cls, found: FrequencyResponse) -> Self:
        usable = found.settled & np.isfinite(found.response) & (found.response != 0)
        omega, ratio = 2 * np.pi * found.frequency[usable], found.response[usable]
        order = np.argsort(omega, kind="stable")
        omega, ratio = omega[order], ratio[order]
        value = np.log(np.abs(ratio) * omega**2) + 1j * np.unwrap(np.angle(-ratio))
        radius = np.nan_to_num(relative_radius(found)[usable][order], nan=0.0, posinf=np.inf)
        place, first = np.unique(np.log(omega), return_index=True)
        return cls(place, value[first], radius[first])

    @property
    def has_close_frequencies(self) -> bool:
        """Whether the plant is known between any two frequencies, with others beside them."""
        return self.place.size > 2 and float(np.diff(self.place).min()) <= np.log(MAX_FREQUENCY_RATIO)

    def is_known(self, omega: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether frequencies [rad/s] lie between two that are close to each other, without a mode, shape (k,).

        A mode between two frequencies bends the curve at both.
        """
        place = np.log(omega)
        inside = (place >= self.place[0]) & (place <= self.place[-1])
        left, right = self._ends(omega)
        is_close = self.place[right] - self.place[left] <= np.log(MAX_FREQUENCY_RATIO)
        share = (self.place[1:-1] - self.place[:-2]) / (self.place[2:] - self.place[:-2])
        bend = np.abs(self.value[1:-1] - (1 - share) * self.value[:-2] - share * self.value[2:])
        is_smooth = np.concatenate([[True], bend <= MAX_BEND, [True]])
        return np.asarray(inside & is_close & is_smooth[left] & is_smooth[right])

    def response(self, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return P(jω) [m/N] by cubics whose slopes at both ends are those of parabolas, shape (k,)."""
        straight, begin, end = self._parts(omega)
        return np.asarray(-np.exp(straight + begin - end) / omega**2)

    def error(self, omega: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the relative error of the interpolated response, shape (k,).

        It is the band's, and the distance to straight lines: how far they are off bounds how far the cubic is. Where a
        mode bends the curve at both ends alike the cubic crosses the line, and is no better there: sizes are added.
        """
        _, begin, end = self._parts(omega)
        left, right = self._ends(omega)
        return np.asarray(np.abs(begin) + np.abs(end) + np.maximum(self.radius[left], self.radius[right]))

    def _parts(self, omega: NDArray[np.float64]) -> tuple[NDArray[np.complex128], ...]:
        """Return the straight lines, and what the slopes at the left and at the right end of each add, shape (k,)."""
        left, right = self._ends(omega)
        slope, step = np.gradient(self.value, self.place), self.place[right] - self.place[left]
        part = (np.log(omega) - self.place[left]) / step
        rise = self.value[right] - self.value[left]
        height = part * (1 - part)
        begin, end = (1 - part) * (step * slope[left] - rise), part * (step * slope[right] - rise)
        return self.value[left] + part * rise, height * begin, height * end

    def _ends(self, omega: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the numbers of the frequencies between which others lie."""
        right = np.clip(np.searchsorted(self.place, np.log(omega)), 1, self.place.size - 1)
        return right - 1, right


def model_error(
    estimator: DelayedEstimator,
    encoder: Encoder,
    segments: Sequence[Segment],
    contacts: Sequence[ContactFriction],
    found: FrequencyResponse,
    stated: Sequence[StatedDeviation] = (),
) -> ModelError | None:
    """Return how wrong the friction model is; None if the harmonics agree with it, or do not tell.

    `encoder` is that of the estimator's `output`. Each segment must be a periodic sine. What is stated as uncertain
    besides the friction model counts as uncertainty of the force.
    """
    has_friction = any(contact.observer.friction.state_size for contact in contacts)
    if not has_friction or any(not _is_sine(segment) for segment in segments):
        return None
    plant = _PlantCurve.of(found)
    if not plant.has_close_frequencies:
        return None
    parts = [_harmonics(estimator, encoder, segments[at], at, contacts, stated) for at in _examined(segments)]
    if not parts:
        return None
    errors = _force_errors(estimator, parts, plant)
    size = max(_clear_error(errors, shares) for shares in errors.shares.T)
    if not size:
        return None
    each = [_contact_terms(contacts, number, segment.lines) for number, segment in enumerate(segments)]
    return ModelError(size, np.abs(np.add.reduce(np.concatenate(each, axis=1), axis=0)))


def _is_sine(segment: Segment) -> bool:
    return segment.lines.size == 1 and segment.periodic and not segment.stated and not is_from_rest(segment)


def _examined(segments: Sequence[Segment]) -> list[int]:
    """Return the numbers of the segments that are examined, of those whose harmonics may lie within the others.

    A motion that has not settled contains more than what friction does.
    """
    frequency = np.array([segment.frequency[0] for segment in segments])
    settled = np.array([segment.settling is None or segment.settling.settled for segment in segments])
    able = np.flatnonzero(settled & (2 * frequency <= frequency.max()))
    able = able[np.argsort(frequency[able], kind="stable")]
    chosen = np.unique(np.linspace(0, able.size - 1, min(MAX_SEGMENTS, able.size)).round().astype(int))
    return [int(number) for number in able[chosen]]


def _harmonics(
    estimator: DelayedEstimator,
    encoder: Encoder,
    segment: Segment,
    number: int,
    contacts: Sequence[ContactFriction],
    stated: Sequence[StatedDeviation],
) -> _Harmonics:
    """Return the harmonics of a segment below its Nyquist frequency that stand out of the noise."""
    line = int(segment.lines[0])
    lines = line * np.arange(1, min(MAX_ORDER, (segment.samples - 1) // (2 * line)) + 1)
    motion = _terms(segment, estimator.output, lines)
    each = _contact_terms(contacts, number, lines)
    force = np.add.reduce(each, axis=0)
    deviation = _term_deviation(segment, estimator.output, encoder)
    is_clear = (np.abs(motion) > CLEAR_STDS * deviation) & (np.abs(force) > MIN_FORCE_RATIO * abs(force[0]))
    is_clear[0] = False
    lines, motion, force, each = lines[is_clear], motion[is_clear], force[is_clear], each[:, is_clear]
    omega, force_deviation = _omega(segment, lines), np.zeros(lines.size)
    for contact in contacts:
        force_deviation += contact.force_deviation(omega, deviation)
    for other in stated:
        force_deviation += STATED_STDS * other.deviation(number, lines)
    sample_time, motion_deviation = np.multiply.outer((segment.sample_time, deviation), np.ones(lines.size))
    given = _terms(segment, estimator.input, lines)
    shares = (np.abs(each) / np.abs(force)).T  # exactly 1 for a single contact
    return _Harmonics(omega, sample_time, motion, given, force, motion_deviation, force_deviation, shares)


def _force_errors(estimator: DelayedEstimator, parts: Sequence[_Harmonics], plant: _PlantCurve) -> _ForceErrors:
    """Return how far the friction force at harmonics is off, where the plant is known."""
    joined = [np.concatenate(each) for each in zip(*parts, strict=True)]
    known = plant.is_known(joined[0])
    omega, _, motion, _, force, motion_deviation, force_deviation, _ = (each[known] for each in joined)
    response, size = plant.response(omega), np.abs(force)
    by_plant = np.abs(motion / response) * plant.error(omega)
    uncertainty = (by_plant + motion_deviation / np.abs(response) + force_deviation) / size
    counts = np.flatnonzero(uncertainty < MAX_UNCERTAINTY)
    omega, sample_time, motion, given, force, _, _, shares = (each[known][counts] for each in joined)
    thrust = estimator.input_path(omega, sample_time) * estimator.output_path(omega) * given
    lacking = thrust - force - motion / response[counts]
    return _ForceErrors(np.abs(lacking) / size[counts], uncertainty[counts], shares)


def _clear_error(errors: _ForceErrors, shares: NDArray[np.float64]) -> float:
    """Return the error that those harmonics show in which a contact has the greater shares; 0 if it is not clear."""
    chosen = np.flatnonzero(shares >= np.median(shares)) if shares.size else np.empty(0, dtype=int)
    error, uncertainty = errors.error[chosen], errors.uncertainty[chosen]
    contradicting = np.count_nonzero(error > UNCERTAINTIES * uncertainty + MIN_MODEL_ERROR)
    if error.size < MIN_HARMONICS or contradicting < max(MIN_CONTRADICTIONS, CONTRADICTING_SHARE * error.size):
        return 0.0
    return float(np.median(error))


def _contact_terms(
    contacts: Sequence[ContactFriction], number: int, lines: NDArray[np.int64]
) -> NDArray[np.complex128]:
    """Return the terms of the friction at each contact as thrust [N], shape (contacts, k)."""
    return np.stack([contact.terms(number, lines) for contact in contacts])


def _terms(segment: Segment, channel: str, lines: NDArray[np.int64]) -> NDArray[np.complex128]:
    """Return the Fourier terms of a channel at lines of a period, shape (k,)."""
    periods = segment.channels[channel]
    return record_spectrum(segment, channel)[lines * len(periods)] * (2 / periods.size)


def _omega(segment: Segment, lines: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the frequencies of lines of a period [rad/s], shape (k,)."""
    return np.asarray(2 * np.pi / (segment.samples * segment.sample_time) * lines, dtype=np.float64)


def _term_deviation(segment: Segment, channel: str, encoder: Encoder) -> float:
    """Return the standard deviation of a term of y' [m]: of the stated encoder, or as the record shows it if greater.

    Between the terms of a periodic motion is noise alone; of a single period the upper half of the terms is mostly so.
    """
    y = segment.channels[channel]
    stated = phasor_variance(segment, encoder._replace(noise=encoder.noise / np.sqrt(len(y))))[0]
    terms = record_spectrum(segment, channel)
    noise = terms[terms.size // 2 :] if len(y) == 1 else terms[np.arange(terms.size) % len(y) != 0]
    shown = (noise.real**2 + noise.imag**2).mean() * (2 / y.size) ** 2
    return float(np.sqrt(max(stated, shown)))
