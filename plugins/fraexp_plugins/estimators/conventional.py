"""The conventional FRA method: measured position over control input."""

import numpy as np

from fraexp.api import Result, Segment, Signals, param, phasors, response_result
from fraexp_plugins.estimators.delayed import DelayedEstimator


class Conventional(DelayedEstimator, name="conventional", version=1):
    """P̂ = y'/u by Fourier sums over whole periods, averaged (paper, Fig 3).

    It answers with the describing function of plant, friction and delays together: with friction it depends on
    the amplitude. Not to be used as a plant model unless friction is negligible at the amplitude at hand.
    """

    remove_delay: bool = param("", "whether to divide by G_di G_do and the hold, to compare with P(jω)", False)

    def estimate(self, signals: Signals) -> Result:
        """Return y'/u, or y'/(G_di G_do u), frequency by frequency."""
        units = (signals.unit(self.input), signals.unit(self.output))
        inputs = [phasors(segment, self.input) * self._path(segment) for segment in signals.segments]
        outputs = [phasors(segment, self.output) for segment in signals.segments]
        return response_result(signals, inputs, outputs, names=(self.input, self.output), units=units)

    def _path(self, segment: Segment) -> np.ndarray:
        """Return what lies between control input and measured position besides the plant, shape (lines,)."""
        if not self.remove_delay:
            return np.ones(segment.lines.size)
        omega = 2 * np.pi * segment.frequency
        return self.input_path(omega, segment.sample_time) * self.output_path(omega)
