"""The joint input-output estimate: input and output are both responses to an injected signal."""

import numpy as np

from fraexp.api import Signals, param, phasors
from fraexp_plugins.estimators.realisations import Group, Part, ReferencedEstimator, circular, mean, power
from fraexp_plugins.estimators.windows import independent_windows, window_bins, window_phasors, window_samples


class JointInputOutput(ReferencedEstimator, name="joint_input_output", version=1):
    """Ĝ = Ŝ_yr/Ŝ_ur with the injected signal r: unbiased in closed loop, whatever r is, if noise does not know it.

    Sums run over n blocks: the means of realisations if there are several, else periods, else, for a random
    excitation, Hann windows of `window`. The covariance C of the residuals of [y; u] on r carries over by
    σ² = [1 -Ĝ] C [1 -Ĝ]ᴴ/(|Ŝ_ur/Ŝ_rr|² Σ|r|²), ν = 2(n - 1). P. E. Wellstead, Automatica 17(1) 1981, "Non-parametric
    methods of system identification"; R. Pintelon and J. Schoukens, System Identification: A Frequency Domain
    Approach, 2nd ed. 2012, section 2.6, doi:10.1002/9781118287422. The direct estimate Ŝ_yu/Ŝ_uu tends to
    (GΦ_r - C̄Φ_v)/(Φ_r + |C|²Φ_v) instead, where Φ_v is the output's noise and C the controller.

    It takes away the bias by noise in the loop, not that by friction: it finds plant and friction together at this
    amplitude. The periods of a single realisation tell the noise alone. Not to be used without a record of r (see
    spectral), nor with windows that are shorter than the plant rings: leakage biases them.
    """

    window: float = param("s", "length of Hann windows for a random excitation; 0 for whole periods", 0.0, at_least=0)

    def part(self, signals: Signals, group: Group) -> Part:
        """Return Ŝ_yr/Ŝ_ur of a group of realisations."""
        self.check_reference(signals)
        frequency, (u, y, r), independent = self._windows(group) if self.window else self._periods(group)
        u = u * self.path(frequency, group[0].sample_time)
        s_rr, s_ur, s_yr = power(r), _sum(u * np.conj(r)), _sum(y * np.conj(r))
        response = s_yr / s_ur
        residual = power(y - response * u)  # [1 -Ĝ] C [1 -Ĝ]ᴴ: what r explains is in neither
        variance = np.full(response.size, np.nan)
        if independent > 1:
            variance = residual * s_rr / ((independent - 1) * np.abs(s_ur) ** 2)
        scale = np.sqrt(s_rr * len(r))
        return Part(
            group,
            frequency,
            response,
            circular(variance),
            2.0 * max(independent - 1, 0.0),
            np.abs(s_ur) / scale,
            np.abs(s_yr) / scale,
        )

    def _channels(self) -> tuple[str, str, str]:
        return self.input, self.output, self.reference_channel

    def _periods(self, group: Group) -> tuple[np.ndarray, list[np.ndarray], float]:
        """Return frequencies, phasors of each channel, each of shape (blocks, lines), and the blocks' number."""
        if len(group) > 1:
            blocks = [np.stack([mean(phasors(s, channel)) for s in group]) for channel in self._channels()]
        else:
            blocks = [phasors(group[0], channel) for channel in self._channels()]
        return group[0].frequency, blocks, float(len(blocks[0]))

    def _windows(self, group: Group) -> tuple[np.ndarray, list[np.ndarray], float]:
        samples = window_samples(group, self.window, self.name)
        bins = window_bins(group, samples)
        blocks = [window_phasors(group, channel, samples, bins) for channel in self._channels()]
        return (
            bins / (samples * group[0].sample_time),
            blocks,
            independent_windows(group, self.reference_channel, samples),
        )


def _sum(values: np.ndarray) -> np.ndarray:
    found: np.ndarray = np.add.reduce(values, axis=0)
    return found
