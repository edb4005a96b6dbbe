"""The feedback-compensated FRA method: the loop compensates friction by its model during the experiment."""

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Metric, RecordError, Result, Segment, Signals, param, phasors, response_result
from fraexp_plugins.estimators._shared.delayed_estimator import PlantReferredEstimator


class FeedbackCompensated(PlantReferredEstimator, name="feedback_compensated", version=3):
    """P̂ = y'/(u - α f̂), where the loop adds α f̂(y') to the control input u to compensate friction.

    The method with a friction model-based compensation that is the paper's reference [10], as it is described there
    (paper, section I, and section IV below eq 5). To the first harmonic P̂ = P/(1 + P(N - αN̂ G_di G_do)): with α = 0
    it is the conventional method. With α = 1 and the right model P̂ is P except for the delay of the compensation, and
    the loop may be unstable; on the paper's machine at 12 N, 1 ms of dead time and the hold leave -4.6 dB at 39 Hz and
    -5 dB at 80 Hz, where the modes are. A larger amplitude helps.

    Compare several gains and amplitudes before you use it: the response does not show which α is right.
    """

    compensates_friction: ClassVar[bool] = True
    """The loop compensates friction during the experiment; an observer would subtract the remainder again."""

    compensation: str = param("", "channel of the compensating force α f̂ that is part of the input", "compensation")

    expected_failures: ClassVar[dict[str, str]] = dict.fromkeys(
        ("linear-plant", "result-units", "covariance", "outcome"),
        "It refuses a loop without compensation, with which it is tried here.",
    )

    def estimate(self, signals: Signals) -> Result:
        """Return y'/(u - α f̂) at each frequency, and the peak compensating force."""
        if self.compensation not in signals.units:
            raise RecordError(
                f"feedback_compensated: the signals lack the channel '{self.compensation}'; give the study a section "
                "[compensation], or the record the force that was fed back"
            )
        units = (signals.unit(self.input), signals.unit(self.output))
        inputs = [self._uncompensated_input(segment) for segment in signals.segments]
        outputs = [phasors(segment, self.output) for segment in signals.segments]
        name = f"{self.input}-{self.compensation}"
        found = response_result(signals, inputs, outputs, names=(name, self.output), units=units)
        peaks = [float(np.max(np.abs(segment.channels[self.compensation]))) for segment in signals.segments]
        metric = Metric("peak compensation", max(peaks, default=0.0), signals.unit(self.compensation))
        return Result(found.outcome, found.findings, found.response, metrics=(metric,))

    def _uncompensated_input(self, segment: Segment) -> NDArray[np.complex128]:
        """Return the phasors of the input less the compensation in each period, shape (periods, lines)."""
        difference = phasors(segment, self.input) - phasors(segment, self.compensation)
        if not self.refer_to_plant:
            return difference
        return difference * self.path(segment.frequency, segment.sample_time)
