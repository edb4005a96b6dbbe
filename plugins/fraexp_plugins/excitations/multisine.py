"""Random-phase multisine: many harmonics of one period at once."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fraexp.api import ParameterError, Period, param
from fraexp_plugins.excitations._shared.sampling import (
    MIN_CYCLES_PER_SAMPLE,
    PROFILE_MEANING,
    AmplitudeProfile,
    even_samples,
    relative_amplitude,
)
from fraexp_plugins.excitations._shared.settled_excitation import BroadbandExcitation

FIRST_CLIPPING_LEVEL, LAST_CLIPPING_LEVEL = 0.75, 0.98
"""Level of clipping over the peak at the first and at the last iteration: these need the fewest iterations."""


def compress_peaks(spectrum: NDArray[np.complex128], samples: int, iterations: int) -> NDArray[np.complex128]:
    """Return a spectrum of equal magnitudes whose wave of `samples` samples has a lower peak.

    Time-frequency domain swapping: clip the wave, take the phases of the result, and keep the magnitudes
    (E. Van der Ouderaa, J. Schoukens and J. Renneboog, IEEE Trans. Instrumentation and Measurement 37(1), 1988, pp.
    145-147). A dense flat spectrum gets below 1.5 in 1000 iterations, random phases have about 3.3; L_p norms
    (P. Guillaume et al., same journal 40(6), 1991, pp. 982-989) get somewhat lower, for much more work.
    """
    magnitudes = np.abs(spectrum)
    lines = magnitudes > 0
    wave = np.fft.irfft(spectrum, samples)
    best, lowest_peak = spectrum, float(np.max(np.abs(wave)))
    for level in np.linspace(FIRST_CLIPPING_LEVEL, LAST_CLIPPING_LEVEL, iterations):
        limit = level * np.max(np.abs(wave))
        clipped = np.fft.rfft(np.clip(wave, -limit, limit))
        size = np.abs(clipped)
        phase_factor = np.where(size > 0, clipped / np.where(size > 0, size, 1), 1)
        current = np.where(lines, magnitudes * phase_factor, 0)
        wave = np.fft.irfft(current, samples)
        peak = float(np.max(np.abs(wave)))
        if peak < lowest_peak:
            best, lowest_peak = current, peak
    return best


FIRST_AND_STEP = {"odd": (1, 2), "even": (2, 2), "full": (1, 1)}
"""First harmonic that may be excited, and the distance to the next."""


class Multisine(BroadbandExcitation, name="multisine", version=1):
    """u = Σ A_k cos(2πk f0 t + φ_k) with independent φ_k, uniform over a turn.

    J. Schoukens, M. Vaes and R. Pintelon, IEEE Control Systems 36(3), 2016, doi:10.1109/MCS.2016.2535918; R. Pintelon
    and J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., Wiley 2012, sections 4.2 and 4.3.

    By default only odd lines are excited, so that even harmonics show even nonlinearities only, and friction none of
    them unless the motion is one-sided. With `detection_group_size` = k, one of every k neighbouring lines of the grid,
    drawn at random, is a detection line and not excited: there odd nonlinearities show. All realisations have the same
    lines and amplitudes and differ in their phases. The period is an even number of samples whose transform is fast;
    the line spacing is adjusted accordingly.

    Use it for a best linear approximation, its noise and its nonlinear distortion, in the time of a few periods. It
    does not give the response at one amplitude of one sine: the friction force depends on the whole spectrum, and the
    force is shared among the lines.

    `crest_iterations` lowers the peak force at the same root mean square, and makes the wave's distribution far from
    Gaussian. The best linear approximation of the robust method, an expectation over independent random phases, is
    then another one: it is refused with several realisations.
    """

    rms: float = param("N", "root mean square value", above=0)
    line_spacing: float = param("Hz", "spacing f0 of the harmonics: one over the period", 0.5, above=0)
    harmonics: Literal["odd", "even", "full"] = param("", "harmonics that may be excited: odd, even or full", "odd")
    points: int = param(
        "1", "lines asked for, spaced logarithmically; 0 for all in the frequency range", 0, at_least=0, at_most=100_000
    )
    detection_group_size: int = param(
        "1", "neighbouring lines of which one is a detection line; 0 for none", 4, at_least=0, at_most=1000
    )
    realisations: int = param("1", "realisations of the phases, run one after another", 1, at_least=1, at_most=1000)
    amplitude_profile: AmplitudeProfile = param("Hz", PROFILE_MEANING, ())
    crest_iterations: int = param(
        "1", "iterations that lower the crest factor; 0 for random phases", 0, at_least=0, at_most=20_000
    )
    seed: int = param("1", "seed of phases and detection lines", 0, at_least=0)

    def model_post_init(self, context: object) -> None:
        """Check the frequency range, the amplitude profile and what belongs together."""
        super().model_post_init(context)
        if self.detection_group_size == 1:
            raise ParameterError(
                "multisine.detection_group_size is 1, which leaves no line to excite; expected 0, or 2 or more"
            )
        if self.crest_iterations and self.realisations > 1:
            raise ParameterError(
                f"multisine has crest_iterations and {self.realisations} realisations, whose phases must stay random; "
                "give one of both"
            )

    def check(self, sample_time: float) -> None:
        """Refuse a range without lines, or too few for detection, and what exceeds Nyquist frequency or memory."""
        self.check_size(1 / max(self.line_spacing * sample_time, MIN_CYCLES_PER_SAMPLE), sample_time, self.realisations)
        available = self.grid().size
        if 0 < available < self.detection_group_size:
            raise ParameterError(
                f"multisine.detection_group_size is {self.detection_group_size}, but there are only {available} lines "
                f"between {self.min_frequency:g} and {self.max_frequency:g} Hz, too few for a detection line: lower "
                "it, or take 0 for none; or take more lines, by 'line_spacing' or 'points'"
            )
        self.check_lines(self.lines(), even_samples(1 / self.line_spacing, sample_time), sample_time)

    def grid(self) -> NDArray[np.int64]:
        """Return the harmonics that are excited or detection lines, ascending, shape (n,)."""
        first, step = FIRST_AND_STEP[self.harmonics]
        lowest, highest = self.harmonic_range(1 / self.line_spacing)
        grid = np.arange(first + step * max(-((first - lowest) // step), 0), highest + 1, step)
        if self.points and grid.size:
            wanted = np.geomspace(self.min_frequency, self.max_frequency, self.points) / self.line_spacing
            grid = grid[np.unique(np.clip(np.round((wanted - grid[0]) / step).astype(int), 0, grid.size - 1))]
        return grid

    def lines(self) -> NDArray[np.int64]:
        """Return the excited harmonics, ascending, shape (lines,)."""
        grid = self.grid()
        size = self.detection_group_size
        if not size:
            return grid
        groups = grid.size // size
        generator = np.random.default_rng([self.seed, 0])
        detection_lines = size * np.arange(groups) + generator.integers(size, size=groups)
        return np.delete(grid, detection_lines)

    def periods(self, sample_time: float) -> tuple[Period, ...]:
        """Return one period per realisation."""
        lines, samples = self.lines(), even_samples(1 / self.line_spacing, sample_time)
        amplitudes = relative_amplitude(self.amplitude_profile, lines / (samples * sample_time))
        amplitudes *= self.rms / np.sqrt(np.sum(amplitudes**2) / 2)
        return tuple(
            Period(self._wave(number, lines, amplitudes, samples), lines) for number in range(self.realisations)
        )

    def _wave(
        self, number: int, lines: NDArray[np.int64], amplitudes: NDArray[np.float64], samples: int
    ) -> NDArray[np.float64]:
        """Return the samples of a realisation [N], shape (samples,)."""
        # seeded by number, so that one more realisation leaves the others as they are
        generator = np.random.default_rng([self.seed, 1, number])
        phases = np.exp(2j * np.pi * generator.random(lines.size))
        spectrum = np.zeros(samples // 2 + 1, dtype=complex)
        spectrum[lines] = amplitudes * phases * (samples / 2)
        if self.crest_iterations:
            spectrum = compress_peaks(spectrum, samples, self.crest_iterations)
        wave = np.fft.irfft(spectrum, samples)
        if self.harmonics == "odd":  # to the last bit: even lines are empty
            wave[samples // 2 :] = -wave[: samples // 2]
        return wave
