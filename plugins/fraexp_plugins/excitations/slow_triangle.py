"""A slow back-and-forth motion of the position reference, with smaller reversals inside, for identifying friction."""

import numpy as np

from fraexp.api import ParameterError, Period, param
from fraexp_plugins.excitations._shared.reference_motion import (
    ReferenceMotion,
    check_duration,
    check_rounding,
    path_length,
    reference_period,
)


class SlowTriangle(ReferenceMotion, name="slow_triangle", version=1):
    """The position reference goes ±A back and forth at constant velocity, then around 0 at smaller amplitudes.

    The wide motion reaches gross sliding and gives ΣF_mi; the inner ones, of amplitude A s for each ratio s of
    `inner_amplitude_ratios`, stop in the presliding region, where hysteresis within hysteresis separates the elements
    (F. Al-Bender and J. Swevers, IEEE Control Systems Magazine 28(6), 2008). It is recorded from rest, `cycles` times.
    The motion is repeated at each of the `velocities`, which separates viscous from Coulomb friction. It does not give
    a mass: there is too little acceleration.
    """

    amplitude: float = param("m", "amplitude A, several times the presliding distance", above=0)
    velocities: tuple[float, ...] = param("m/s", "velocities, one cycle at each in turn", (1e-3, 3e-3))
    acceleration: float = param("m/s^2", "acceleration at its reversals", 0.5, above=0)
    inner_amplitude_ratios: tuple[float, ...] = param("1", "amplitudes of the inner motions over A", (0.1, 0.03))

    def model_post_init(self, context: object) -> None:
        """Check velocities and inner amplitudes."""
        self.check_velocities(self.velocities)
        ratios = self.inner_amplitude_ratios
        if ratios and not 0 < min(ratios) <= max(ratios) < 1:
            raise ParameterError("slow_triangle.inner_amplitude_ratios must lie between 0 and 1")

    @property
    def _corners(self) -> list[float]:
        """Places at which the reference reverses in one period [m]."""
        ratios = [1.0, *self.inner_amplitude_ratios]
        return [sign * ratio * self.amplitude for ratio in ratios for sign in (1, -1)]

    def check(self, sample_time: float) -> None:
        """Refuse motions that do not fit into memory."""
        length = path_length(self._corners)
        check_duration(self.name, length / max(self.velocities), sample_time)
        check_rounding(self.name, max(self.velocities), self.acceleration, sample_time)
        slowness = float(np.sum(1 / np.array(self.velocities)))
        check_duration(self.name, length * slowness * self.cycles, sample_time)

    def periods(self, sample_time: float) -> tuple[Period, ...]:
        """Return one period: the motion at one velocity after the other."""
        parts = [reference_period(self._corners, v, self.acceleration, sample_time) for v in self.velocities]
        reference = np.concatenate([part.reference for part in parts if part.reference is not None])
        return (Period(np.zeros(reference.size), np.array([1]), reference),)
