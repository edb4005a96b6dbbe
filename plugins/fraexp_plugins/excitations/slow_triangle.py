"""A slow motion of the position reference to and fro, with smaller reversals inside, for identifying friction."""

from typing import ClassVar

import numpy as np

from fraexp.api import Excitation, ParameterError, Period, Schedule, param
from fraexp_plugins.excitations.reference_motion import check_duration, check_rounding, reference_period, way_length


class SlowTriangle(Excitation, name="slow_triangle", version=1):
    """The position reference goes ±A to and fro at constant velocity, then around 0 at smaller amplitudes.

    The wide motion slips through and gives ΣF_mi; the inner ones, of amplitude A s for each share s of `inner`, stop in
    the presliding region, where hysteresis within hysteresis tells the elements apart (F. Al-Bender and J. Swevers,
    IEEE Control Systems Magazine 28(6), 2008). It is recorded from rest, `cycles` times. Velocities differ from part to
    part by `velocities`, so that viscous friction can be told from Coulomb friction. Not to be used to find a mass:
    there is too little acceleration.
    """

    amplitude: float = param("m", "amplitude A, several times the presliding region", above=0)
    velocities: tuple[float, ...] = param("m/s", "velocities, one cycle at each, again and again", (1e-3, 3e-3))
    acceleration: float = param("m/s^2", "acceleration at its reversals", 0.5, above=0)
    inner: tuple[float, ...] = param("1", "amplitudes of the inner motions, as shares of A", (0.1, 0.03))
    cycles: int = param("1", "times that it is run through, all velocities each time", 3, at_least=1, at_most=10_000)

    expected_failures: ClassVar[dict[str, str]] = {
        "whole-periods": "It moves the reference alone, so the force that it adds is 0."
    }

    def model_post_init(self, context: object) -> None:
        """Check velocities and shares."""
        if not self.velocities or min(self.velocities) <= 0:
            raise ParameterError("slow_triangle.velocities must be above 0, one at least")
        if self.inner and not 0 < min(self.inner) <= max(self.inner) < 1:
            raise ParameterError("slow_triangle.inner must lie between 0 and 1")

    @property
    def _corners(self) -> list[float]:
        shares = [1.0, *self.inner]
        return [sign * share * self.amplitude for share in shares for sign in (1, -1)]

    def check(self, sample_time: float) -> None:
        """Refuse motions that do not fit into memory."""
        length = way_length(self._corners)
        check_duration(self.name, length / max(self.velocities), sample_time)
        check_rounding(self.name, max(self.velocities), self.acceleration, sample_time)
        slowness = float(np.sum(1 / np.array(self.velocities)))
        check_duration(self.name, length * slowness * self.cycles, sample_time)

    def periods(self, sample_time: float) -> tuple[Period, ...]:
        """Return one period: the motion at one velocity after the other."""
        parts = [reference_period(self._corners, v, self.acceleration, sample_time) for v in self.velocities]
        way = np.concatenate([part.reference for part in parts if part.reference is not None])
        return (Period(np.zeros(way.size), np.array([1]), way),)

    @property
    def schedule(self) -> Schedule:
        """From rest: the elements' state is known there."""
        return Schedule(settle_limit=0, periods=self.cycles)
