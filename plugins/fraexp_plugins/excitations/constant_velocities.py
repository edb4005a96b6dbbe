"""The position reference back and forth at one constant velocity after another, for viscous friction."""

from fraexp.api import ParameterError, Period, Quantity, param
from fraexp_plugins.excitations._shared.reference_motion import (
    ReferenceMotion,
    check_duration,
    check_rounding,
    reference_period,
)


class ConstantVelocities(ReferenceMotion, name="constant_velocities", version=1):
    """The position reference covers the same travel back and forth, one experiment per velocity (paper, section V-A).

    The force of steady sliding over the velocity gives D_v and shows whether there is a Stribeck effect
    (`friction_identification` with `constant_velocity`). The travel must be many times the presliding distance, which
    is left out at each reversal.
    """

    velocities: tuple[float, ...] = param("m/s", "velocities", (5e-3, 10e-3, 20e-3, 40e-3))
    travel: float = param("m", "travel from one reversal to the next", 10e-3, above=0)
    acceleration: float = param("m/s^2", "acceleration at the reversals", 1.0, above=0)

    def model_post_init(self, context: object) -> None:
        """Check velocities and travel."""
        self.check_velocities(self.velocities)
        needed = 4 * max(self.velocities) ** 2 / self.acceleration
        if self.travel < needed:
            raise ParameterError(
                "constant_velocities.travel is ",
                Quantity(self.travel, "m"),
                "; at ",
                Quantity(max(self.velocities), "m/s"),
                " and ",
                Quantity(self.acceleration, "m/s^2"),
                " expected ",
                Quantity(needed, "m"),
                " or more, half of it at constant velocity",
            )

    def check(self, sample_time: float) -> None:
        """Refuse motions that do not fit into memory."""
        check_duration(self.name, 2 * self.travel / max(self.velocities), sample_time)
        check_rounding(self.name, max(self.velocities), self.acceleration, sample_time)
        check_duration(self.name, 2 * self.travel / min(self.velocities) * self.cycles, sample_time)

    def periods(self, sample_time: float) -> tuple[Period, ...]:
        """Return one back-and-forth period for each velocity."""
        return tuple(reference_period([self.travel], v, self.acceleration, sample_time) for v in self.velocities)
