"""The H1, H2 and Hv estimates from averaged spectra of input and output, for records without an excitation channel."""

from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Signals, param, remarks
from fraexp_plugins.estimators._shared.hann_windows import (
    independent_windows,
    window_bins,
    window_phasors,
    window_samples,
)
from fraexp_plugins.estimators._shared.leakage import WindowedResponse, total_variance, with_leakage
from fraexp_plugins.estimators._shared.realisations import BroadbandEstimator, Group, Part, sum_of_squares

ONE_WINDOW = (
    "one window spans the whole record, so nothing shows noise or leakage: give a shorter 'window', such as a tenth of "
    "the record (--set estimator.window=SECONDS)"
)
"""What a record that does not repeat itself is told without a shorter window."""


class H1H2Hv(BroadbandEstimator, name="h1_h2_hv", version=5):
    """H1 = Ŝ_yu/Ŝ_uu, H2 = Ŝ_yy/Ŝ_uy or Hv = √(H1 H2) from Hann windows with 50 % overlap, and the coherence.

    H1 is unbiased by noise at the output, H2 by noise at the input, Hv if both are equally noisy for their size
    (G. T. Rocklin, J. Crowley, H. Vold, IMAC 1985). From the coherence γ² = |S_yu|²/(S_uu S_yy) of n independent
    windows follows E|dĤ|² = |Ĥ|² (1 - γ²)/(γ² (n - 1)), ν = 2(n - 1); along Hv it is γ² times as small. J. S. Bendat
    and A. G. Piersol, Random Data, 4th ed. 2010, sections 6.2 and 9.2, doi:10.1002/9781118032428.

    Periods that repeat count as one window: a single one, without others to compare, has no confidence band.

    For random excitation that was not recorded. Do not use it otherwise. Windows leak, which biases sharp resonances
    and a free mass at low frequencies. The bias is estimated from windows of twice the length (half of it if the record
    is short); where it is more than noise it is part of the covariance, and above 1 % the outcome is `INACCURATE`.
    In closed loop the noise that the controller feeds back biases the response towards -1/C (use
    `joint_input_output`). For a periodic record use `best_linear_approximation`, whose whole periods do not leak. None
    of them removes the bias by friction.
    """

    variant: Literal["h1", "h2", "hv"] = param("", "h1: noise at the output; h2: at the input; hv: at both", "h1")
    window: float = param("s", "length of the windows; 0 for the period, or block, of the record", 0.0, at_least=0)

    def part(self, signals: Signals, group: Group) -> Part:
        """Return the response of a group of records, at the excited lines, or at the windows' lines."""
        segment = group[0]
        samples = window_samples(group, self.window, self.name) if self.window else segment.samples
        bins = window_bins(group, samples) if self.window else segment.lines
        spectra = self._spectra(group, samples, bins, samples)
        response, covariance = spectra.response(self.variant), spectra.covariance(self.variant)
        part = Part(
            group,
            bins / (samples * segment.sample_time),
            response,
            covariance,
            2.0 * max(spectra.independent - 1, 0.0),
            np.sqrt(spectra.uu / spectra.windows),
            np.sqrt(spectra.yy / spectra.windows),
            coherence=spectra.coherence,
        )
        if not all(one.periodic for one in group) and spectra.independent <= 1:
            return replace(part, doubts=remarks(ONE_WINDOW))
        windowed = partial(self._windowed, group)
        return with_leakage(part, group, self.input, samples, bins, windowed, is_inverse=self.variant == "h2")

    def _windowed(self, group: Group, samples: int, bins: NDArray[np.int64], transform: int) -> WindowedResponse:
        """Return the response from windows of so many samples, for comparison: 1/H2, which noise leaves unbiased."""
        spectra = self._spectra(group, samples, bins, transform)
        response, variance = spectra.response(self.variant), total_variance(spectra.covariance(self.variant))
        if self.variant == "h2":
            return WindowedResponse(1 / response, variance / np.abs(response) ** 4)
        return WindowedResponse(response, variance)

    def _spectra(self, group: Group, samples: int, bins: NDArray[np.int64], transform: int) -> "_Spectra":
        sample_time = group[0].sample_time
        path = self.path(bins / (transform * sample_time), sample_time)
        u = window_phasors(group, self.input, samples, bins, transform) * path
        y = window_phasors(group, self.output, samples, bins, transform)
        cross = np.add.reduce(y * np.conj(u), axis=0)
        return _Spectra(
            sum_of_squares(u), sum_of_squares(y), cross, len(u), independent_windows(group, self.input, samples)
        )


@dataclass(frozen=True)
class _Spectra:
    """Sums over windows, each of shape (n,)."""

    uu: NDArray[np.float64]
    yy: NDArray[np.float64]
    yu: NDArray[np.complex128]
    windows: int
    independent: float
    """Number of independent windows."""

    @property
    def coherence(self) -> NDArray[np.float64]:
        """γ², NaN for a single window."""
        if self.independent <= 1:
            return np.full(self.uu.size, np.nan)
        return np.asarray(np.abs(self.yu) ** 2 / (self.uu * self.yy))

    def response(self, variant: str) -> NDArray[np.complex128]:
        """Return H1, H2 or Hv."""
        if variant == "h1":
            return self.yu / self.uu
        if variant == "h2":
            return self.yy / self.yu.conj()
        gain: NDArray[np.float64] = np.sqrt(self.yy / self.uu)
        size: NDArray[np.float64] = np.abs(self.yu)
        return gain * self.yu / size

    def covariance(self, variant: str) -> NDArray[np.float64]:
        """Return the covariance (n, 2, 2): its parts along and across the response are those of gain and phase."""
        if self.independent <= 1:
            return np.full((self.uu.size, 2, 2), np.nan)
        coherence, response = self.coherence, self.response(variant)
        across = np.maximum(1 - coherence, 0) / (2 * coherence * (self.independent - 1))
        along = across * coherence if variant == "hv" else across
        real, imaginary = response.real, response.imag
        mixed = real * imaginary * (along - across)
        rows = [[real**2 * along + imaginary**2 * across, mixed], [mixed, imaginary**2 * along + real**2 * across]]
        return np.moveaxis(np.array(rows), -1, 0)
