"""Spectral analysis: a response from averaged spectra of input and output, for records without a reference."""

from typing import Literal

import numpy as np

from fraexp.api import Signals, param
from fraexp_plugins.estimators.realisations import BroadbandEstimator, Group, Part, power
from fraexp_plugins.estimators.windows import independent_windows, window_bins, window_phasors, window_samples


class Spectral(BroadbandEstimator, name="spectral", version=1):
    """H1 = Ŝ_yu/Ŝ_uu, H2 = Ŝ_yy/Ŝ_uy or Hv = √(H1 H2) from Hann windows that overlap by half, with coherence.

    H1 is unbiased by noise at the output, H2 by noise at the input, Hv if both are equally noisy for their size
    (G. T. Rocklin, J. Crowley, H. Vold, IMAC 1985). From the coherence γ² = |S_yu|²/(S_uu S_yy) of n independent
    windows follows E|dĤ|² = |Ĥ|² (1 - γ²)/(γ² (n - 1)), ν = 2(n - 1); along Hv it is γ² times as small. J. S. Bendat
    and A. G. Piersol, Random Data, 4th ed. 2010, sections 6.2 and 9.2, doi:10.1002/9781118032428.

    Periods that repeat themselves count as one: of a single one without others to compare, no band is known.

    For random excitation without any record of what was injected. Not to be used otherwise: windows leak, which
    biases sharp resonances and a free mass at low frequencies; in closed loop the noise that the controller feeds
    back biases it towards -1/C (see joint_input_output); a periodic record is better served by
    best_linear_approximation, whose whole periods do not leak. Neither says anything about friction.
    """

    form: Literal["h1", "h2", "hv"] = param("", "h1, h2 or hv: where the noise is", "h1")
    window: float = param("s", "length of the windows; 0 for the period, or block, of the record", 0.0, at_least=0)

    def part(self, signals: Signals, group: Group) -> Part:
        """Return the response of a group of records, at the excited lines or the windows' own."""
        segment = group[0]
        samples = window_samples(group, self.window, self.name) if self.window else segment.samples
        bins = window_bins(group, samples) if self.window else segment.lines
        frequency = bins / (samples * segment.sample_time)
        u = window_phasors(group, self.input, samples, bins) * self.path(frequency, segment.sample_time)
        y = window_phasors(group, self.output, samples, bins)
        s_uu, s_yy = power(u), power(y)
        s_yu = np.add.reduce(y * np.conj(u), axis=0)
        response = self._response(s_uu, s_yy, s_yu)
        independent = independent_windows(group, self.input, samples)
        coherence = np.abs(s_yu) ** 2 / (s_uu * s_yy) if independent > 1 else np.full(bins.size, np.nan)
        return Part(
            group,
            frequency,
            response,
            self._covariance(response, coherence, independent),
            2.0 * max(independent - 1, 0.0),
            np.sqrt(s_uu / len(u)),
            np.sqrt(s_yy / len(y)),
            coherence=coherence,
        )

    def _response(self, s_uu: np.ndarray, s_yy: np.ndarray, s_yu: np.ndarray) -> np.ndarray:
        if self.form == "h1":
            return s_yu / s_uu
        if self.form == "h2":
            return s_yy / np.conj(s_yu)
        return np.sqrt(s_yy / s_uu) * s_yu / np.abs(s_yu)

    def _covariance(self, response: np.ndarray, coherence: np.ndarray, independent: float) -> np.ndarray:
        """Return the covariance (n, 2, 2): its parts along and across the response are those of gain and phase."""
        if independent <= 1:
            return np.full((response.size, 2, 2), np.nan)
        across = np.maximum(1 - coherence, 0) / (2 * coherence * (independent - 1))
        along = across * coherence if self.form == "hv" else across
        real, imaginary = response.real, response.imag
        mixed = real * imaginary * (along - across)
        rows = [
            [real**2 * along + imaginary**2 * across, mixed],
            [mixed, imaginary**2 * along + real**2 * across],
        ]
        return np.moveaxis(np.array(rows), -1, 0)
