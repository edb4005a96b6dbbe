"""The paper's FRA method: measured position over the effective control input that a friction model leaves."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from fraexp.api import (
    FrictionModel,
    Motion,
    Result,
    Segment,
    Signals,
    fourier_sums,
    param,
    path_response,
    phasors,
    response_result,
    spectrum_of,
)
from fraexp_plugins.estimators.delayed import DelayedEstimator

TABULATED = 4096
"""Samples of a record up to which the shifts of its Fourier series are kept: many sweeps have the same ones."""
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
        "1", "points per sample at which the friction model is driven", 4, at_least=1, at_most=64
    )

    def estimate(self, signals: Signals) -> Result:
        """Return y'/û_e, frequency by frequency."""
        if not signals.segments:
            return Result(signals.outcome, signals.message)
        units = (signals.unit(self.input), signals.unit(self.output))
        outputs = [phasors(segment, self.output) for segment in signals.segments]
        inputs = self._effective_inputs(signals.segments, outputs)
        return response_result(signals, inputs, outputs, names=("u_e", self.output), units=units)

    def _effective_inputs(self, segments: Sequence[Segment], outputs: list[np.ndarray]) -> list[np.ndarray]:
        """Return the phasors of û_e [N] per segment and period, eq (2)."""
        counts = [segment.lines.size for segment in segments]
        omega = 2 * np.pi * np.concatenate([segment.frequency for segment in segments])
        times = {segment.sample_time for segment in segments}
        sample_time = times.pop() if len(times) == 1 else np.repeat([s.sample_time for s in segments], counts)
        path = self.input_path(omega, sample_time) * self.output_path(omega)
        viscous = 1j * omega * self.friction.viscous
        factors = zip(*(np.split(factor, np.cumsum(counts)[:-1]) for factor in (path, viscous)), strict=True)
        forces = self._friction_phasors(segments)
        return [
            delayed * phasors(segment, self.input) - damping * output - force
            for segment, (delayed, damping), output, force in zip(segments, factors, outputs, forces, strict=True)
        ]

    def _friction_phasors(self, segments: Sequence[Segment]) -> list[np.ndarray]:
        """Return the phasors of the friction model's force [N] per segment, each of shape (periods, lines)."""
        found = []
        forces = self.friction.forces([self._motion(segment) for segment in segments])
        for segment, force in zip(segments, forces, strict=True):
            periods = force.reshape(-1, segment.samples * self.interpolation)
            lagged = path_response(2 * np.pi * segment.frequency, 0.0, self.output_lags)
            found.append(fourier_sums(periods, segment.lines) * (self.force_scale * lagged))
        return found

    def _motion(self, segment: Segment) -> Motion:
        """Return what the friction model sees of a segment: all its periods, after what came before."""
        fine = self._interpolated(segment)
        before = np.empty(0) if self.friction.forgets else segment.lead_in.get(self.output, np.empty(0))
        time_step = segment.sample_time / self.interpolation
        if self.width_scale != 1.0:
            fine, before = fine / self.width_scale, before / self.width_scale
        return Motion(fine, time_step, True, before, segment.sample_time)

    def _interpolated(self, segment: Segment) -> np.ndarray:
        """Return all periods of a record, one after another, at `interpolation` times as many points.

        First-order lags in G_do are undone: they would change the shape of the motion that friction sees.
        """
        periods, samples = segment.channels[self.output].shape
        size = periods * samples
        bins = spectrum_of(segment, self.output)
        # rounding repeats itself from period to period and adds up, noise does not
        scatter = self.noise**2 * periods + self.resolution**2 / 12 * periods**2
        if scatter:
            bins = np.where(np.abs(bins) < CLEAR * np.sqrt(scatter * samples), 0, bins)
        if self.output_lags:
            omega = 2 * np.pi * np.fft.rfftfreq(size, segment.sample_time)
            bins = bins / path_response(omega, 0.0, self.output_lags)
        return _between(bins, size, self.interpolation)


def _between(bins: np.ndarray, samples: int, points: int) -> np.ndarray:
    """Return a Fourier series at `points` points per sample, shape (samples points,)."""
    if samples <= TABULATED:  # as many transforms of a record's own length, whose factors are known to be small
        found: np.ndarray = np.fft.irfft(bins * _shifts(samples, points), samples, axis=1).T.ravel()
        return found
    if samples % 2 == 0:
        bins = np.append(bins[:-1], bins[-1] / 2)  # the Nyquist line stands for two
    return np.fft.irfft(bins, samples * points) * points


@lru_cache(512)
def _shifts(samples: int, points: int) -> np.ndarray:
    """Return what moves a Fourier series by 0, 1… of `points` parts of a sample, shape (points, samples // 2 + 1)."""
    parts = np.arange(points)[:, None] / points
    shifts: np.ndarray = np.exp(2j * np.pi * parts * np.arange(samples // 2 + 1) / samples)
    return shifts
