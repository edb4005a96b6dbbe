"""The friction model against the harmonics of the motion: a wrong one makes another plant of them than of the sines.

A sine excites its own frequency only. What the axis does at a multiple of it, friction does. Where that multiple lies
among the measured frequencies the plant is known there, so y'/P, the force that must have moved the axis, is compared
with the effective input û_e, in which the friction model's force is most of what there is. Their difference over the
friction force is the relative error of the model. Neither the amplitude nor the plant needs to be known.
"""

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Encoder, FrequencyResponse, Segment, phasor_variance, record_spectrum
from fraexp_plugins.estimators._shared.effective_input_observer import ObserverEstimator, is_from_rest

MAX_ORDER = 25
"""Highest harmonic that is examined."""
MIN_HARMONICS = 6
"""Number of harmonics, at least, from which a friction model is judged."""
MAX_SEGMENTS = 10
"""Segments that are examined, at most."""
SUREST_SHARE = 4
"""One of so many harmonics, those with the least uncertainty, tell the error."""
MAX_UNCERTAINTY = 0.05
"""Relative uncertainty of the force at a harmonic, by encoder and by the plant between two measured frequencies, up to
which it counts."""
MIN_MODEL_ERROR = 0.005
"""Relative error of a friction model that counts as one: below it are the numerics of the motion."""
CLEAR_STDS = 3.0
"""Size of a harmonic, in its standard deviations by the encoder, from which it is examined."""
MAX_FREQUENCY_RATIO = 1.5
"""Ratio of two neighbouring frequencies, at most, between which the plant is interpolated: more may hide a mode."""
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
    """Terms of all friction [N]."""
    deviation: NDArray[np.float64]
    """Standard deviation of the terms of y' [m]."""
    fundamental: NDArray[np.float64]
    """Size of the friction force at the fundamental [N]."""


REAL, COMPLEX = (0, 1, 5, 6), (2, 3, 4)
"""Places of its real and its complex fields."""


class _PlantCurve(NamedTuple):
    """ln(-ω² P) over ln ω, shape (n,): smooth but for the modes."""

    place: NDArray[np.float64]
    value: NDArray[np.complex128]

    @classmethod
    def of(cls, found: FrequencyResponse) -> Self:
        usable = found.settled & np.isfinite(found.response) & (found.response != 0)
        omega, ratio = 2 * np.pi * found.frequency[usable], found.response[usable]
        order = np.argsort(omega, kind="stable")
        omega, ratio = omega[order], ratio[order]
        value = np.log(np.abs(ratio) * omega**2) + 1j * np.unwrap(np.angle(-ratio))
        place, first = np.unique(np.log(omega), return_index=True)
        return cls(place, value[first])

    def is_known(self, omega: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether frequencies [rad/s] lie between two that are close to each other, shape (k,)."""
        place, right = np.log(omega), np.searchsorted(self.place, np.log(omega))
        inside = (right > 0) & (place <= self.place[-1])
        spacing = np.diff(self.place, prepend=-np.inf, append=np.inf)[right]
        return np.asarray(inside & (spacing <= np.log(MAX_FREQUENCY_RATIO)))

    def response(self, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return P(jω) [m/N] by monotone cubic interpolation, shape (k,)."""
        from scipy.interpolate import PchipInterpolator  # slow to import: listing plugins must stay fast

        parts = np.column_stack([self.value.real, self.value.imag])
        size, angle = PchipInterpolator(self.place, parts)(np.log(omega)).T
        return np.asarray(-np.exp(size + 1j * angle) / omega**2)

    def straight(self, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the same by straight lines: how far they are off bounds how far the cubic is."""
        return np.asarray(-np.exp(np.interp(np.log(omega), self.place, self.value)) / omega**2)


def model_error(
    observer: ObserverEstimator,
    segments: Sequence[Segment],
    forces: Sequence[NDArray[np.float64]],
    found: FrequencyResponse,
) -> ModelError | None:
    """Return how wrong the friction model is; None if the harmonics agree with it, or do not tell.

    `forces` are the model's along the segments, as the observer gives them. Each segment must be a periodic sine.
    """
    if not observer.friction.state_size or any(not _is_sine(segment) for segment in segments):
        return None
    plant = _PlantCurve.of(found)
    if plant.place.size < MIN_HARMONICS:
        return None
    each = [_harmonics(observer, segments[at], forces[at]) for at in _examined(segments)]
    error, uncertainty = _force_errors(observer, each, plant) if each else (np.empty(0), np.empty(0))
    surest = np.argsort(uncertainty)[: max(MIN_HARMONICS, error.size // SUREST_SHARE)]
    if error.size < MIN_HARMONICS or np.median((error - uncertainty)[surest]) <= MIN_MODEL_ERROR:
        return None
    friction = observer.friction_phasors(segments, forces)
    return ModelError(float(np.median(error[surest])), np.array([np.abs(part.mean()) for part in friction]))


def _is_sine(segment: Segment) -> bool:
    return segment.lines.size == 1 and segment.periodic and not segment.stated and not is_from_rest(segment)


def _examined(segments: Sequence[Segment]) -> list[int]:
    """Return the numbers of the segments that are examined, of those whose harmonics may lie within the others."""
    frequency = np.array([segment.frequency[0] for segment in segments])
    able = np.flatnonzero(2 * frequency <= frequency.max())
    able = able[np.argsort(frequency[able], kind="stable")]
    chosen = np.unique(np.linspace(0, able.size - 1, min(MAX_SEGMENTS, able.size)).round().astype(int))
    return [int(number) for number in able[chosen]]


def _harmonics(observer: ObserverEstimator, segment: Segment, force: NDArray[np.float64]) -> _Harmonics:
    """Return the harmonics of a segment below its Nyquist frequency."""
    y, line = segment.channels[observer.output], int(segment.lines[0])
    lines = line * np.arange(1, min(MAX_ORDER, (segment.samples - 1) // (2 * line)) + 1)
    motion, thrust = (
        record_spectrum(segment, name)[lines * len(y)] * (2 / y.size) for name in (observer.output, observer.input)
    )
    omega = np.asarray(2 * np.pi / (segment.samples * segment.sample_time) * lines, dtype=np.float64)
    mean = force[0] if len(force) == 1 else np.add.reduce(force, axis=0) / len(force)
    friction = np.fft.rfft(mean)[lines] * (2 / mean.size) * observer.force_factor(omega)
    friction += 1j * omega * observer.friction.viscous * motion
    alike = (segment.sample_time, _term_deviation(observer, segment), abs(friction[0]))
    sample_time, deviation, fundamental = np.multiply.outer(alike, np.ones(lines.size - 1))
    return _Harmonics(omega[1:], sample_time, motion[1:], thrust[1:], friction[1:], deviation, fundamental)


def _force_errors(
    observer: ObserverEstimator, parts: Sequence[_Harmonics], plant: _PlantCurve
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the relative errors of the friction force at harmonics, and what encoder and plant contribute to them.

    Those count that stand out of the noise, at frequencies at which the plant is known.
    """
    omega, sample_time, deviation, fundamental = (np.concatenate([part[at] for part in parts]).real for at in REAL)
    motion, thrust, force = (np.concatenate([part[at] for part in parts]) for at in COMPLEX)
    is_clear = (np.abs(motion) > CLEAR_STDS * deviation) & (np.abs(force) > MIN_FORCE_RATIO * fundamental)
    known = np.flatnonzero(is_clear & plant.is_known(omega))
    omega, motion, force, deviation = omega[known], motion[known], force[known], deviation[known]
    response, size = plant.response(omega), np.abs(force)
    stiffness = observer.friction.max_stiffness * observer.force_scale / observer.displacement_scale
    between = np.abs(motion * (1 / response - 1 / plant.straight(omega)))
    uncertainty = (between + deviation * (1 / np.abs(response) + stiffness)) / size
    counts = np.flatnonzero(uncertainty < MAX_UNCERTAINTY)
    at, times = omega[counts], sample_time[known[counts]]
    linear = observer.input_path(at, times) * observer.output_path(at) * thrust[known[counts]]
    lacking = linear - force[counts] - motion[counts] / response[counts]
    return np.abs(lacking) / size[counts], uncertainty[counts]


def _term_deviation(observer: ObserverEstimator, segment: Segment) -> float:
    """Return the standard deviation of a term of y' [m]: of the stated encoder, or as the record shows it if greater.

    Between the terms of a periodic motion is noise alone; of a single period the upper half of the terms is mostly so.
    """
    y = segment.channels[observer.output]
    stated = phasor_variance(segment, Encoder(observer.noise / np.sqrt(len(y)), observer.resolution))[0]
    power = np.abs(record_spectrum(segment, observer.output) * (2 / y.size)) ** 2
    shown = power[power.size // 2 :] if len(y) == 1 else power[np.arange(power.size) % len(y) != 0]
    return float(np.sqrt(max(stated, shown.mean())))
