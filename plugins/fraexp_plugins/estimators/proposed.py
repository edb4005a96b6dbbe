"""The paper's FRA method: measured position over the effective control input that a friction model leaves."""

import numpy as np

from fraexp.api import FrictionModel, Result, Segment, Signals, param, path_response, phasors, response_result
from fraexp_plugins.estimators.delayed import DelayedEstimator

CLEAR = 3.0
"""How many standard deviations of its scatter a term of the Fourier series must have to be kept."""


class Proposed(DelayedEstimator, name="proposed", version=1):
    """P̂ = y'/û_e with û_e = G_di G_do u - f̂: the effective control input observer, eqs (2)-(5).

    The friction model is driven by y' in the time domain, the delays are applied at each frequency. Between its
    samples y' is interpolated by its Fourier series, which is exact for a periodic response; a friction model fed
    with the samples alone would miss the peaks by A(1 - cos(ωTs/2)). Terms of the series that the scale's
    resolution and noise hide are left out: the model would take them for reversals.

    With the right friction model P̂ is P at any amplitude; the error of a wrong one is 1/P̂ - 1/P = N - N̂, largest
    where 1/P is small. Not to be used where the friction model is only guessed.
    """

    friction: FrictionModel = param("", "friction model FM of the observer", inherit="friction")
    force_scale: float = param("1", "factor on the model's force, such as 1.1 for a ΣF_m 10 % too large", 1.0, above=0)
    width_scale: float = param("1", "factor on the model's deflections Y_m, at the same ΣF_m", 1.0, above=0)
    resolution: float = param("m", "resolution of the scale", 0.0, at_least=0, inherit="loop.resolution")
    noise: float = param("m", "standard deviation of the scale's noise", 0.0, at_least=0, inherit="loop.noise")
    interpolation: int = param(
        "1", "points per sample at which the friction model is driven", 8, at_least=1, at_most=64
    )

    def estimate(self, signals: Signals) -> Result:
        """Return y'/û_e, frequency by frequency."""
        units = (signals.unit(self.input), signals.unit(self.output))
        inputs = [self._effective_input(segment) for segment in signals.segments]
        outputs = [phasors(segment, self.output) for segment in signals.segments]
        return response_result(signals, inputs, outputs, names=("u_e", self.output), units=units)

    def _effective_input(self, segment: Segment) -> np.ndarray:
        """Return the phasors of û_e [N] per period, eq (2)."""
        omega = 2 * np.pi * segment.frequency
        delayed = self.input_path(omega, segment.sample_time) * self.output_path(omega) * phasors(segment, self.input)
        viscous = 1j * omega * self.friction.viscous * phasors(segment, self.output)
        return delayed - viscous - self._friction_phasors(segment)

    def _friction_phasors(self, segment: Segment) -> np.ndarray:
        """Return the phasors of the friction model's force [N] per period, shape (periods, lines)."""
        record = segment.channels[self.output]
        fine = self._interpolated(record, segment.sample_time) / self.width_scale
        before = segment.lead_in.get(self.output, np.empty(0)) / self.width_scale
        force = self.friction.force(
            fine, segment.sample_time / self.interpolation, periodic=True, lead_in=(before, segment.sample_time)
        )
        periods = (self.force_scale * force).reshape(record.shape[0], -1)
        lagged = path_response(2 * np.pi * segment.frequency, 0.0, self.output_lags)
        return lagged * np.fft.rfft(periods, axis=1)[:, segment.lines] * (2 / periods.shape[1])

    def _interpolated(self, record: np.ndarray, sample_time: float) -> np.ndarray:
        """Return all periods of a record, shape (periods, n), at `interpolation` times as many points, as one row.

        First-order lags in G_do are undone: they would change the shape of the motion that friction sees.
        """
        periods, samples = record.shape
        bins = np.fft.rfft(record.ravel())
        # rounding repeats itself from period to period and adds up, noise does not
        scatter = self.noise**2 * periods + self.resolution**2 / 12 * periods**2
        bins[np.abs(bins) < CLEAR * np.sqrt(scatter * samples)] = 0
        bins /= path_response(2 * np.pi * np.fft.rfftfreq(record.size, sample_time), 0.0, self.output_lags)
        if record.size % 2 == 0:
            bins[-1] /= 2  # the Nyquist line stands for two
        return np.fft.irfft(bins, record.size * self.interpolation) * self.interpolation
