"""Records whose odd harmonics show the force of friction, beside their excited lines, and what a law leaves of them."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Motion, Segment, Signals, fourier_sums
from fraexp_plugins.identification._shared.usable_records import FORCE_FLOOR, with_harmonics
from fraexp_plugins.identification.autonomous._autonomous_elements import FREE_BODY_TERMS, ProjectedProblem
from fraexp_plugins.identification.autonomous._autonomous_lines import (
    ElementObserver,
    SpectralLines,
    delayed_lines,
    spectral_lines,
)
from fraexp_plugins.identification.autonomous._law_elements import LawElements

MIN_HARMONIC_SAMPLES = 50
"""Samples of a cycle of the highest harmonic."""
MIN_LEVELS = 3
"""Fewest records of a frequency that count in the search for a law."""
NOISE_SEEDS = 12
"""Other errors of the encoder from which the error of friction follows: of few a record may seem to have hardly any, as
most of them change nothing where an element only just slips."""
FREE_BODY_RANGE = 3.05
"""Frequencies over the lowest one up to which an axis may be a free body: the third harmonic of the lowest one too."""
COLUMNS_AT_ONCE = 16
"""Columns whose forces are in memory."""
HOLD_WEIGHT = 1e4
"""Weight of the equation that holds a Coulomb force, over that of a column."""


class LawSolution(NamedTuple):
    """Sizes of the forces of a law, and what they leave."""

    sizes: NDArray[np.float64]
    """Force of each column [N], shape (N,)."""
    residual: NDArray[np.float64]
    """Weighted residuals, shape (2 L M,), and then those of the equations of a free body, shape (2 K,)."""
    problem: ProjectedProblem


@dataclass(frozen=True)
class LawRecords:
    """Records with harmonics, the motions that drive friction in them, and their errors."""

    signals: Signals
    lines: SpectralLines
    motions: tuple[Motion, ...]
    variance: NDArray[np.float64]
    """E|e|² of G U - F̂ - Y/P̂ [N²], shape (L, M)."""
    deviations: NDArray[np.float64]
    """Standard deviation of the mean position of each record [m], shape (segments,)."""
    free_lines: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    """Places of lines far below the first mode, where 1/P̂ is that of a free body, shape (K,)."""

    @classmethod
    def from_signals(
        cls,
        signals: Signals,
        observer: ElementObserver,
        inverse: tuple[NDArray[np.float64], NDArray[np.complex128]],
        step: int = 1,
    ) -> "LawRecords":
        """Return the records of every `step`th frequency; `inverse` has frequencies [Hz] and 1/P̂ [N/m] there."""
        chosen = _chosen_segments(signals.segments, step)
        own = replace(signals, segments=tuple(with_harmonics(segment, MIN_HARMONIC_SAMPLES) for segment in chosen))
        return cls.at_lines(own, observer, inverse)

    @classmethod
    def at_lines(
        cls, own: Signals, observer: ElementObserver, inverse: tuple[NDArray[np.float64], NDArray[np.complex128]]
    ) -> "LawRecords":
        """Return the records at the lines of their segments, of all of these."""
        lines = spectral_lines(own, observer)
        motions = [observer.with_drift(observer.periodic_motion(segment), segment) for segment in own.segments]
        periods = np.array([len(segment.channels[observer.output]) for segment in own.segments])
        samples = np.array([segment.samples for segment in own.segments])
        # rounding repeats itself from period to period, noise does not
        deviations = np.hypot(observer.noise / np.sqrt(periods), observer.resolution / np.sqrt(12))
        order = np.argsort(inverse[0])  # they come as they were played
        known = np.log(inverse[0][order]), np.log(np.abs(inverse[1][order]))
        stiffness = np.exp(np.interp(np.log(lines.frequency), *known))
        amplitudes = [np.sqrt(2 * np.mean(segment.channels[observer.input] ** 2)) for segment in own.segments]
        floor = FORCE_FLOOR * _by_line(lines, own, np.array(amplitudes))
        noise = stiffness[:, None] * _by_line(lines, own, deviations * np.sqrt(2 / samples))
        variance = np.where(lines.known, floor**2 + noise**2, 1.0)
        return cls(own, lines, tuple(motions), variance, deviations)

    @property
    def equations(self) -> int:
        """Number of real equations once 1/P̂ is eliminated."""
        return max(self.lines.equations + self.free_equations, 1)

    @property
    def free_equations(self) -> int:
        """How many of them say that the axis is a free body."""
        return max(2 * self.free_lines.size - FREE_BODY_TERMS, 0)

    def as_free_body(self) -> "LawRecords":
        """Return the records of an axis whose lowest frequencies are far below its first mode.

        Elements that slip in hardly any record are a spring in the others, and 1/P̂ of each line hides a spring: one of
        1.2 N that slips after 21 mm was a part of the Coulomb force.
        """
        frequency = self.lines.frequency
        return replace(self, free_lines=np.flatnonzero(frequency <= FREE_BODY_RANGE * frequency.min()))

    def deflection(self, elements: LawElements, motions: Sequence[Motion] = ()) -> NDArray[np.complex128]:
        """Return the phasors of each column [N/N], complex, shape (L, M, N)."""
        found = np.zeros((*self.lines.thrust.shape, elements.is_coulomb.size), dtype=complex)
        columns, begin = elements.forces(motions or self.motions), 0
        while part := list(islice(columns, COLUMNS_AT_ONCE)):
            for place, (rows, record) in self.lines.places(self.signals):
                forces = np.stack([column[place] for column in part])
                sums = fourier_sums(forces, self.signals.segments[place].lines)
                found[rows, record, begin : begin + len(part)] = sums.T
            begin += len(part)
        return found

    def solve(
        self, deflection: NDArray[np.complex128], dead_time: float, held: tuple[NDArray[np.bool_], float] | None = None
    ) -> LawSolution:
        """Return the sizes >= 0 of the columns by least squares, with a 1/P̂ at each line and this dead time [s].

        With `held` some columns have this sum [N].
        """
        from scipy.optimize import nnls  # slow to import: only when something is estimated

        lines = delayed_lines(replace(self.lines, deflection=deflection), dead_time)
        problem = ProjectedProblem.of_lines(lines, self.variance)
        if self.free_lines.size:
            problem = problem.with_free_body(lines.frequency, self.free_lines)
        scale = np.linalg.norm(problem.matrix, axis=0)
        scale = np.where(scale > 0, scale, 1.0)
        matrix, target = problem.matrix / scale, problem.target
        if held is not None:
            row = np.where(held[0], 1 / scale, 0.0)
            weight = HOLD_WEIGHT / row.max()
            matrix, target = np.concatenate([matrix, weight * row[None]]), np.append(target, weight * held[1])
        sizes, _ = nnls(matrix, target, maxiter=100 * scale.size)
        sizes = sizes / scale
        return LawSolution(sizes, problem.target - problem.matrix @ sizes, problem)

    def with_friction_noise(self, elements: LawElements, sizes: NDArray[np.float64]) -> "LawRecords":
        """Return the records with the errors that the encoder causes by way of friction in their variance.

        A small motion turns back at another time with another error: its records count less.
        """
        return replace(self, variance=self.variance + self.friction_noise(elements, sizes))

    def friction_noise(self, elements: LawElements, sizes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return E|e|² of the friction force by the encoder's errors [N²], shape (L, M)."""
        law, acting = elements.acting(sizes)
        force = self.deflection(law) @ acting
        changes = [self.deflection(law, self.shaken_motions(seed)) @ acting - force for seed in range(NOISE_SEEDS)]
        return np.where(self.lines.known, np.mean(np.abs(changes) ** 2, axis=0), 0.0)

    def shaken_motions(self, seed: int) -> list[Motion]:
        """Return the motions with another error of the encoder."""
        generator = np.random.default_rng(seed)
        return [
            motion._replace(displacement=_shaken(motion, deviation, segment.samples, generator))
            for motion, deviation, segment in zip(self.motions, self.deviations, self.signals.segments, strict=True)
        ]


def _shaken(motion: Motion, deviation: float, samples: int, generator: np.random.Generator) -> NDArray[np.float64]:
    """Return a displacement with noise in those terms of its Fourier series that it has; its drift is no part of it."""
    size = motion.displacement.size
    drift = motion.displacement[0] - motion.lead_in[-size] if motion.lead_in.size else 0.0
    ramp = drift / size * np.arange(size)
    bins = np.fft.rfft(motion.displacement - ramp)
    noise = np.fft.rfft(deviation * generator.normal(size=samples)) * (size / samples)
    noise = np.concatenate([noise, np.zeros(bins.size)])[: bins.size]
    kept = np.abs(bins) > 1e-9 * np.abs(bins[1:]).max()
    return np.asarray(np.fft.irfft(bins + np.where(kept, noise, 0.0), size) + ramp)


def _chosen_segments(segments: Sequence[Segment], step: int) -> list[Segment]:
    """Return the records of every `step`th frequency of those that have several levels."""
    sines = [segment for segment in segments if segment.lines.size == 1]
    counts: dict[float, int] = {}
    for segment in sines:
        key = round(float(segment.frequency[0]), 3)
        counts[key] = counts.get(key, 0) + 1
    usable = sorted(key for key, count in counts.items() if count >= MIN_LEVELS)[::step]
    return [segment for segment in sines if round(float(segment.frequency[0]), 3) in usable]


def _by_line(lines: SpectralLines, signals: Signals, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a value of each segment at each of its lines, shape (L, M)."""
    found = np.zeros(lines.thrust.shape)
    for place, (rows, record) in lines.places(signals):
        found[rows, record] = values[place]
    return found
