"""How far a machine creeps under a force that should hold it."""

import numpy as np

from fraexp.api import Curve, Estimator, Metric, Result, Signals, param


class Drift(Estimator, name="drift", version=1):
    """The change of the mean position from the second to the last period (drift test of P. Dupont et al., 2002).

    The first period does not count, because the machine deflects elastically in it. doi:10.1109/TAC.2002.1000274.
    """

    displacement: str = param("", "channel of the displacement", "displacement")

    def estimate(self, signals: Signals) -> Result:
        """Return the drift, and the mean position of each period."""
        unit = signals.unit(self.displacement)
        curves, metrics = [], []
        for segment in signals.segments:
            means = np.mean(segment.channels[self.displacement], axis=1)
            time = (np.arange(means.size) + 0.5) * segment.samples * segment.sample_time
            curves.append(Curve("drift", {"time": time, "position": means}, {"time": "s", "position": unit}))
            metrics.append(Metric("drift", float(means[-1] - means[min(1, means.size - 1)]), unit))
        return Result(signals.outcome, signals.findings, curves=tuple(curves), metrics=tuple(metrics))
