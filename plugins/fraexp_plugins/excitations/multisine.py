"""Random-phase multisine: many harmonics of one period at once."""

from typing import Literal

import numpy as np

from fraexp.api import ParameterError, Period, param
from fraexp_plugins.excitations.broadband import BroadbandExcitation
from fraexp_plugins.excitations.crest import compressed
from fraexp_plugins.excitations.sampling import LEAST_CYCLES, even_samples
from fraexp_plugins.excitations.shaping import MEANING, Shape, check_shape, shaped

FIRST_AND_STEP = {"odd": (1, 2), "even": (2, 2), "full": (1, 1)}
"""First harmonic that may be excited, and the distance to the next."""


class Multisine(BroadbandExcitation, name="multisine", version=1):
    """u = Σ A_k cos(2πk f0 t + φ_k) with independent φ_k, uniform over a turn.

    J. Schoukens, M. Vaes and R. Pintelon, IEEE Control Systems 36(3), 2016, doi:10.1109/MCS.2016.2535918; R. Pintelon
    and J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., Wiley 2012, sections 4.2 and 4.3.

    Odd lines alone are excited, so that even harmonics show even nonlinearities only, and friction none of them
    unless the motion is one-sided. With `detection` = k, of every k neighbouring lines of the grid one, drawn at
    random, is left out: there odd nonlinearities show. All realisations have the same lines and amplitudes and
    differ in their phases. The period is an even number of samples whose transform is fast; the line spacing is
    moved accordingly.

    To be used for a best linear approximation, its noise and its nonlinear distortion, in the time of a few
    periods. Not to be used where the response at one amplitude of one sine is asked for: what friction does depends
    on the whole spectrum, and the force is shared among the lines.

    `crest_iterations` lowers the peak force at the same root mean square, and makes the wave's distribution far from
    Gaussian. The best linear approximation of the robust method, an expectation over independent random phases, is
    then another one: it is refused with several realisations.
    """

    rms: float = param("N", "root mean square value", above=0)
    resolution: float = param("Hz", "spacing f0 of the harmonics: one over the period", 0.5, above=0)
    harmonics: Literal["odd", "even", "full"] = param("", "harmonics that may be excited: odd, even or full", "odd")
    points: int = param(
        "1", "lines asked for, spaced logarithmically; 0 for all in the band", 0, at_least=0, at_most=100_000
    )
    detection: int = param("1", "neighbouring lines of which one is left out; 0 for none", 4, at_least=0, at_most=1000)
    realisations: int = param("1", "realisations of the phases, run one after another", 1, at_least=1, at_most=1000)
    shape: Shape = param("Hz", MEANING, ())
    crest_iterations: int = param(
        "1", "iterations that lower the crest factor; 0 for random phases", 0, at_least=0, at_most=20_000
    )
    seed: int = param("1", "seed of phases and of lines left out", 0, at_least=0)

    def model_post_init(self, context: object) -> None:
        """Check the band, its shape and what belongs together."""
        super().model_post_init(context)
        check_shape(self.name, self.shape)
        if self.detection == 1:
            raise ParameterError("multisine.detection is 1, which leaves out all lines; expected 0, or 2 at least")
        if self.crest_iterations and self.realisations > 1:
            raise ParameterError(
                f"multisine has crest_iterations and {self.realisations} realisations, whose phases must stay random; "
                "give one of both"
            )

    def check(self, sample_time: float) -> None:
        """Refuse a band without lines, or too few for detection, and what exceeds Nyquist frequency or memory."""
        self.check_size(1 / max(self.resolution * sample_time, LEAST_CYCLES), sample_time, self.realisations)
        there = self.grid().size
        if 0 < there < self.detection:
            raise ParameterError(
                f"multisine.detection is {self.detection}, which leaves no line out of the {there} between "
                f"{self.lowest:g} and {self.highest:g} Hz: lower it, or take 0 for none; or take more lines, by "
                "'resolution' or 'points'"
            )
        self.check_lines(self.lines(), even_samples(1 / self.resolution, sample_time), sample_time)

    def grid(self) -> np.ndarray:
        """Return the harmonics that are excited or, for detection, left out, ascending, shape (n,)."""
        first, step = FIRST_AND_STEP[self.harmonics]
        least, most = self.band(1 / self.resolution)
        grid = np.arange(first + step * max(-((first - least) // step), 0), most + 1, step)
        if self.points and grid.size:
            wanted = np.geomspace(self.lowest, self.highest, self.points) / self.resolution
            grid = grid[np.unique(np.clip(np.round((wanted - grid[0]) / step).astype(int), 0, grid.size - 1))]
        return grid

    def lines(self) -> np.ndarray:
        """Return the excited harmonics, ascending, shape (lines,)."""
        grid = self.grid()
        if not self.detection:
            return grid
        groups = grid.size // self.detection
        generator = np.random.default_rng([self.seed, 0])
        omitted = self.detection * np.arange(groups) + generator.integers(self.detection, size=groups)
        return np.delete(grid, omitted)

    def periods(self, sample_time: float) -> tuple[Period, ...]:
        """Return one period per realisation."""
        lines, samples = self.lines(), even_samples(1 / self.resolution, sample_time)
        amplitudes = shaped(self.shape, lines / (samples * sample_time))
        amplitudes *= self.rms / np.sqrt(np.sum(amplitudes**2) / 2)
        return tuple(
            Period(self._wave(number, lines, amplitudes, samples), lines) for number in range(self.realisations)
        )

    def _wave(self, number: int, lines: np.ndarray, amplitudes: np.ndarray, samples: int) -> np.ndarray:
        """Return the samples of a realisation [N], shape (samples,)."""
        generator = np.random.default_rng([self.seed, 1, number])  # a realisation more leaves the others as they are
        phases = np.exp(2j * np.pi * generator.random(lines.size))
        spectrum = np.zeros(samples // 2 + 1, dtype=complex)
        spectrum[lines] = amplitudes * phases * (samples / 2)
        if self.crest_iterations:
            spectrum = compressed(spectrum, samples, self.crest_iterations)
        wave = np.fft.irfft(spectrum, samples)
        if self.harmonics == "odd":  # to the last bit: even lines are empty
            wave[samples // 2 :] = -wave[: samples // 2]
        return wave
