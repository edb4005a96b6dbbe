"""The joint input-output estimate: input and output are both responses to the excitation."""

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Signals, param, phasors
from fraexp_plugins.estimators._shared.hann_windows import (
    independent_windows,
    window_bins,
    window_phasors,
    window_samples,
)
from fraexp_plugins.estimators._shared.leakage import WindowedResponse, total_variance, with_leakage
from fraexp_plugins.estimators._shared.realisations import (
    Group,
    Part,
    ReferencedEstimator,
    circular_covariance,
    mean,
    sum_of_squares,
)


class JointInputOutput(ReferencedEstimator, name="joint_input_output", version=5):
    """Ĝ = Ŝ_yr/Ŝ_ur with the excitation r: unbiased in closed loop for every r that is independent of the noise.

    The sums run over n blocks: the means of realisations if there are several; otherwise periods, or for a random
    excitation Hann windows of `window`. The covariance C of the residuals of [y; u] on r gives
    σ² = [1 -Ĝ] C [1 -Ĝ]ᴴ/(|Ŝ_ur/Ŝ_rr|² Σ|r|²), ν = 2(n - 1). P. E. Wellstead, Automatica 17(1) 1981, "Non-parametric
    methods of system identification"; R. Pintelon and J. Schoukens, System Identification: A Frequency Domain
    Approach, 2nd ed. 2012, section 2.6, doi:10.1002/9781118287422. The direct estimate Ŝ_yu/Ŝ_uu tends to
    (GΦ_r - C̄Φ_v)/(Φ_r + |C|²Φ_v) instead, where Φ_v is the output's noise and C the controller.

    It removes the bias by noise in the loop, not that by friction: it estimates plant and friction together at this
    amplitude. The periods of a single realisation identify the noise only. Do not use it without a record of r (use
    `h1_h2_hv`), nor with windows shorter than the decay of the plant's vibration: leakage biases them. The bias
    is estimated from windows of twice the length (half of it if the record is short); where it is more than noise it is
    part of the covariance, and above 1 % the outcome is `INACCURATE`.
    """

    window: float = param("s", "length of Hann windows for a random excitation; 0 for whole periods", 0.0, at_least=0)

    def part(self, signals: Signals, group: Group) -> Part:
        """Return Ŝ_yr/Ŝ_ur of a group of realisations."""
        self.check_excitation(signals)
        if not self.window:
            return self._part(group, self._periods(group))
        samples = window_samples(group, self.window, self.name)
        bins = window_bins(group, samples)
        part = self._part(group, self._windows(group, samples, bins, samples))
        return with_leakage(part, group, self.excitation_channel, samples, bins, partial(self._windowed, group))

    def _part(self, group: Group, blocks: "_Blocks") -> Part:
        """Return the response of blocks."""
        frequency, (u, y, r), independent = blocks
        u = u * self.path(frequency, group[0].sample_time)
        s_rr, s_ur, s_yr = sum_of_squares(r), _sum(u * np.conj(r)), _sum(y * np.conj(r))
        response = s_yr / s_ur
        residual = sum_of_squares(y - response * u)  # [1 -Ĝ] C [1 -Ĝ]ᴴ, without the part that r explains
        variance = np.full(response.size, np.nan)
        if independent > 1:
            variance = residual * s_rr / ((independent - 1) * np.abs(s_ur) ** 2)
        scale = np.sqrt(s_rr * len(r))
        return Part(
            group,
            frequency,
            response,
            circular_covariance(variance),
            2.0 * max(independent - 1, 0.0),
            np.abs(s_ur) / scale,
            np.abs(s_yr) / scale,
        )

    def _channels(self) -> tuple[str, str, str]:
        return self.input, self.output, self.excitation_channel

    def _periods(self, group: Group) -> "_Blocks":
        """Return the mean of each realisation, or the periods of a single one."""
        if len(group) > 1:
            blocks = [np.stack([mean(phasors(s, channel)) for s in group]) for channel in self._channels()]
        else:
            blocks = [phasors(group[0], channel) for channel in self._channels()]
        return _Blocks(group[0].frequency, blocks, float(len(blocks[0])))

    def _windowed(self, group: Group, samples: int, bins: NDArray[np.int64], transform: int) -> WindowedResponse:
        """Return the response from windows of so many samples, for comparison."""
        part = self._part(group, self._windows(group, samples, bins, transform))
        return WindowedResponse(part.response, total_variance(part.covariance))

    def _windows(self, group: Group, samples: int, bins: NDArray[np.int64], transform: int) -> "_Blocks":
        """Return the Hann windows of all realisations."""
        blocks = [window_phasors(group, channel, samples, bins, transform) for channel in self._channels()]
        frequency = bins / (transform * group[0].sample_time)
        return _Blocks(frequency, blocks, independent_windows(group, self.excitation_channel, samples))


class _Blocks(NamedTuple):
    """Phasors of the channels in blocks."""

    frequency: NDArray[np.float64]
    """Frequency [Hz], shape (lines,)."""
    phasors: list[NDArray[np.complex128]]
    """Of input, output and excitation, each of shape (blocks, lines)."""
    independent: float
    """Number of independent blocks."""


def _sum(values: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the sum over blocks, in their order: the same bits everywhere."""
    return np.add.reduce(values, axis=0)
