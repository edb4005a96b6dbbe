"""The feedback-compensated FRA method: friction is compensated by feedback of its model during the experiment."""

from typing import ClassVar

import numpy as np

from fraexp.api import Metric, RecordError, Result, Segment, Signals, param, phasors, response_result
from fraexp_plugins.estimators.delayed import DelayedEstimator


class FeedbackCompensated(DelayedEstimator, name="feedback_compensated", version=1):
    """P̂ = y'/(u - α f̂), where α f̂(y') is what the loop adds to the control input u against friction.

    The method with a friction model-based compensation that is the paper's reference [10], as it is described there
    (paper, section I, and section IV below eq 5). To the first harmonic P̂ = P/(1 + P(N - αN̂ G_di G_do)): with α = 0
    it is the conventional method. With α = 1 and the right model P̂ is P but for the delay of the compensation, and the
    loop may be unstable; on the paper's machine at 12 N, 1 ms of dead time and the hold leave -4.6 dB at 39 Hz and
    -5 dB at 80 Hz, where the modes are. A greater amplitude helps.

    Not to be used without having looked at several gains and amplitudes: the response does not tell which α is right.
    """

    takes_friction_off: ClassVar[bool] = True
    """During the experiment; an observer would take off once more what is left."""

    compensation: str = param("", "channel of the compensating force α f̂ that is part of the input", "compensation")
    remove_delay: bool = param("", "whether to divide by G_di G_do and the hold, to compare with P(jω)", False)

    expected_failures: ClassVar[dict[str, str]] = dict.fromkeys(
        ("linear-plant", "result-units", "covariance", "outcome"),
        "It refuses a loop without compensation, with which it is tried here.",
    )

    def estimate(self, signals: Signals) -> Result:
        """Return y'/(u - α f̂), frequency by frequency, and the greatest compensating force."""
        if self.compensation not in signals.units:
            raise RecordError(
                f"feedback_compensated needs the channel '{self.compensation}', which the signals lack: give the study "
                "a section [compensation], or the record the force that was fed back"
            )
        units = (signals.unit(self.input), signals.unit(self.output))
        inputs = [self._excitation(segment) for segment in signals.segments]
        outputs = [phasors(segment, self.output) for segment in signals.segments]
        name = f"{self.input}-{self.compensation}"
        found = response_result(signals, inputs, outputs, names=(name, self.output), units=units)
        greatest = [float(np.max(np.abs(segment.channels[self.compensation]))) for segment in signals.segments]
        metric = Metric("peak compensation", max(greatest, default=0.0), signals.unit(self.compensation))
        return Result(found.outcome, found.message, found.response, metrics=(metric,))

    def _excitation(self, segment: Segment) -> np.ndarray:
        """Return the phasors of the input less the compensation per period, shape (periods, lines)."""
        left = phasors(segment, self.input) - phasors(segment, self.compensation)
        if not self.remove_delay:
            return left
        omega = 2 * np.pi * segment.frequency
        return left * (self.input_path(omega, segment.sample_time) * self.output_path(omega))
