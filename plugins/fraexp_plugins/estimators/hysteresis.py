"""The hysteresis loop of friction: force over displacement and velocity."""

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Curve, Estimator, FrictionModel, Metric, Result, Segment, Signals, param


class Hysteresis(Estimator, name="hysteresis", version=1):
    """Friction force over displacement (paper, Fig 2), the loop's energy and its describing function.

    W = ∮ f dy per cycle, and N = F₁/Y₁ of the fundamentals (A. Gelb and W. E. Vander Velde, Multiple-Input Describing
    Functions and Nonlinear System Design, 1968, section 2.2). If the signals hold no force, as with a measured
    displacement, the force is that of a friction model. Do not use it on a record that is not periodic.
    """

    displacement: str = param("", "channel of the displacement", "displacement")
    force: str = param(
        "", "channel of the friction force; if it is missing, the friction model gives the force", "friction"
    )
    friction: FrictionModel | None = param("", "friction model for signals without a force", None, inherit="friction")

    def estimate(self, signals: Signals) -> Result:
        """Return the loop of the last period of each segment, and its metrics."""
        measured = self.force in signals.units or self.friction is None
        units = {
            "displacement": signals.unit(self.displacement),
            "force": signals.unit(self.force) if measured else "N",
            "velocity": f"{signals.unit(self.displacement)}/s",
        }
        loops = [self._loop(segment, measured) for segment in signals.segments]
        curves = tuple(Curve("hysteresis", loop, units) for loop in loops)
        metrics = tuple(metric for loop in loops for metric in _metrics(loop, units))
        return Result(signals.outcome, signals.findings, curves=curves, metrics=metrics)

    def _loop(self, segment: Segment, measured: bool) -> dict[str, NDArray[np.float64]]:
        displacement = segment.channels[self.displacement][-1]
        velocity = _velocity(displacement, segment.sample_time)
        if measured or self.friction is None:
            force = segment.channels[self.force][-1]
        else:
            force = self.friction.force(displacement, segment.sample_time, periodic=True)
            force = force + self.friction.viscous * velocity
        return {"displacement": displacement, "force": force, "velocity": velocity}


def _velocity(displacement: NDArray[np.float64], sample_time: float) -> NDArray[np.float64]:
    """Return the central difference of a periodic displacement."""
    return (np.roll(displacement, -1) - np.roll(displacement, 1)) / (2 * sample_time)


def _metrics(loop: dict[str, NDArray[np.float64]], units: dict[str, str]) -> list[Metric]:
    y, f = loop["displacement"], loop["force"]
    first = int(np.argmax(np.abs(np.fft.rfft(y - np.mean(y)))))
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
