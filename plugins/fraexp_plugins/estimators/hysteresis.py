"""The hysteresis loop of friction: force over displacement."""

import numpy as np

from fraexp.api import Curve, Estimator, Metric, Result, Segment, Signals, param


class Hysteresis(Estimator, name="hysteresis", version=1):
    """Friction force over displacement (paper, Fig 2), the loop's energy and its describing function.

    W = ∮ f dy per cycle, and N = F₁/Y₁ of the fundamentals (Gelb and Vander Velde, Multiple-Input Describing
    Functions and Nonlinear System Design, 1968, section 2.2).
    """

    displacement: str = param("", "channel of the displacement", "displacement")
    force: str = param("", "channel of the friction force", "friction")

    def estimate(self, signals: Signals) -> Result:
        """Return the loop of the last period of each segment, and the metrics of each."""
        units = {"displacement": signals.unit(self.displacement), "force": signals.unit(self.force)}
        loops = [self._loop(segment) for segment in signals.segments]
        curves = tuple(Curve("hysteresis", loop, units) for loop in loops)
        metrics = tuple(metric for loop in loops for metric in _metrics(loop, units))
        return Result(signals.outcome, signals.message, curves=curves, metrics=metrics)

    def _loop(self, segment: Segment) -> dict[str, np.ndarray]:
        return {"displacement": segment.channels[self.displacement][-1], "force": segment.channels[self.force][-1]}


def _metrics(loop: dict[str, np.ndarray], units: dict[str, str]) -> list[Metric]:
    y, f = loop["displacement"], loop["force"]
    centred = y - np.mean(y)
    first = int(np.argmax(np.abs(np.fft.rfft(centred))))
    describing = np.fft.rfft(f)[first] / np.fft.rfft(y)[first]
    energy = float(np.sum((f + np.roll(f, -1)) / 2 * (np.roll(y, -1) - y)))
    stiffness = f"{units['force']}/{units['displacement']}"
    return [
        Metric("displacement amplitude", float(np.ptp(y) / 2), units["displacement"]),
        Metric("peak force", float(np.max(np.abs(f))), units["force"]),
        Metric("energy per cycle", energy, f"{units['force']} {units['displacement']}"),
        Metric("describing function, real", float(describing.real), stiffness),
        Metric("describing function, imaginary", float(describing.imag), stiffness),
    ]
