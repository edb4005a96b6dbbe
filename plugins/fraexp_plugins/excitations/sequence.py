"""Several excitations, one after another, in one experiment."""

from typing import Any, ClassVar

from fraexp.api import Excitation, ParameterError, Period, Schedule, param


class Sequence(Excitation, name="sequence", version=1):
    """The periods of `parts`, part by part: such as the stepped sine u_sin of the paper's Fig 3 at two amplitudes.

    For estimators that compare records of the same lines, such as autonomous identification and the self-diagnosis: at
    each level a nonlinear system answers differently, a linear one does not (R. Pintelon and J. Schoukens, System
    Identification: A Frequency Domain Approach, 2nd ed. 2012, ch. 4, doi 10.1002/9781118287422). All parts are settled
    and recorded by the strictest of their schedules: the longest ramp, limit and record and the least tolerance.

    Not to be used with parts that are recorded from rest, that are revised after they ran (`response_controlled`), or
    that drive a displacement.
    """

    parts: tuple[Excitation, ...] = param("", "the excitations, each with its name and parameters")

    presets: ClassVar[dict[str, dict[str, Any]]] = {
        "two_amplitudes": {
            "parts": [
                {"name": "stepped_sine", "amplitude": 12.0, "points": 60, "whole_periods": 4},
                {"name": "stepped_sine", "amplitude": 24.0, "points": 60, "whole_periods": 4},
            ]
        }
    }

    def model_post_init(self, context: object) -> None:
        """Check that the parts can be run together."""
        if not self.parts:
            raise ParameterError(
                "sequence has no parts; expected excitations such as [{ name = 'stepped_sine', amplitude = 12 }]"
            )
        for part in self.parts:
            if part.quantity != "force":
                raise ParameterError(f"sequence: {part.name} drives a {part.quantity}; take excitations of the loop")
            if part.rounds > 1:
                raise ParameterError(f"sequence: {part.name} is revised after it ran; run it by itself")
            if part.schedule.settle_limit == 0:
                raise ParameterError(f"sequence: {part.name} is recorded from rest; set its 'transient' to false")

    def check(self, sample_time: float) -> None:
        """Refuse what one of the parts refuses."""
        for part in self.parts:
            part.check(sample_time)

    def periods(self, sample_time: float) -> tuple[Period, ...]:
        """Return the periods of all parts."""
        return tuple(period for part in self.parts for period in part.periods(sample_time))

    @property
    def schedule(self) -> Schedule:
        """The strictest of the parts' schedules."""
        schedules = [part.schedule for part in self.parts]
        return Schedule(
            ramp=max(each.ramp for each in schedules),
            tolerance=min(each.tolerance for each in schedules),
            settle_limit=max(each.settle_limit for each in schedules),
            periods=max(each.periods for each in schedules),
            record_time=max(each.record_time for each in schedules),
        )
