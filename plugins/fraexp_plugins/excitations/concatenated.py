"""Several excitations, one after another, in one experiment."""

from typing import ClassVar

from fraexp.api import Excitation, ParameterError, Period, Schedule, param


class Concatenated(Excitation, name="concatenated", version=1):
    """The periods of `parts`, part by part: such as the stepped sine u_sin of the paper's Fig 3 at two amplitudes.

    For estimators that compare records of the same lines, such as those that fit plant and friction together or that
    test a friction model: at each amplitude a nonlinear system answers differently, a linear one does not (R. Pintelon
    and J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed. 2012, ch. 4,
    doi 10.1002/9781118287422). All parts are settled and recorded by the strictest of their schedules: the longest
    ramp, timeout and record and the smallest tolerance.

    It refuses parts that are recorded from rest, that are revised after they ran (`response_controlled`), or that
    drive a displacement.
    """

    parts: tuple[Excitation, ...] = param("", "the excitations, each with its name and parameters")

    presets: ClassVar[dict[str, dict[str, object]]] = {
        "two_amplitudes": {
            "parts": [
                {"name": "stepped_sine", "amplitude": 12.0, "points": 60, "recorded_periods": 4},
                {"name": "stepped_sine", "amplitude": 24.0, "points": 60, "recorded_periods": 4},
            ]
        }
    }

    def model_post_init(self, context: object) -> None:
        """Check that the parts can be run together."""
        if not self.parts:
            raise ParameterError(
                "concatenated has no parts; expected excitations such as [{ name = 'stepped_sine', amplitude = 12 }]"
            )
        for part in self.parts:
            if part.quantity != "force":
                raise ParameterError(
                    f"concatenated: {part.name} drives a {part.quantity}; take excitations of the loop"
                )
            if part.rounds > 1:
                raise ParameterError(f"concatenated: {part.name} is revised after it ran; run it by itself")
            if part.schedule.settling_timeout == 0:
                raise ParameterError(f"concatenated: {part.name} is recorded from rest; set its 'transient' to false")

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
            settling_tolerance=min(each.settling_tolerance for each in schedules),
            settling_timeout=max(each.settling_timeout for each in schedules),
            recorded_periods=max(each.recorded_periods for each in schedules),
            min_record_time=max(each.min_record_time for each in schedules),
        )
