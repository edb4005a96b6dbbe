"""A motion from target to target with its feedforward: two degrees of freedom beside the feedback."""

from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Excitation, Feedforward, FrictionModel, ParameterError, Period, Plant, Schedule, param
from fraexp_plugins.positioning._shared import motion_profiles
from fraexp_plugins.positioning._shared.design_model import DesignModel

DIFFERENCE_ORDERS = {"energy": 0, "jerk": 1, "snap": 2}
"""Order of the differences of the thrust that each cost makes small; of a rigid body, thrust is acceleration."""
ENERGY_FRACTION = 0.99
"""Fraction of the thrust's energy that the lines of the period carry."""
MAX_MOTION_SAMPLES = 250_000
"""Samples of a motion: planning so many takes a second or two, while the study is read."""


class PointToPoint(Excitation, name="point_to_point", version=1):
    """u_ff = D_ff r and r_ref = N_ff r of the deadbeat framework, with rolling friction compensated (paper, Fig 7).

    From one target to the next the feedforward takes the design model P_d from rest to rest in a finite time: with the
    coprime factors N(z)/D(z) of P_d behind a zero-order hold, u_ff = D v and r_ref = N v of one v that ends in a
    constant (E. I. Jury, Sampled-Data Control Systems, 1958). All states of P_d come to rest, so that its modes do not
    vibrate. Of all such motions it is the one with the smallest Σ(Δu)² (`cost`: jerk; energy: Σu²; snap: Σ(Δ²u)²)
    whose thrust stays within `force_limit`: a quadratic program, solved as least distance programming (C. L. Lawson
    and R. J. Hanson, Solving Least Squares Problems, 1974, section 23.4).

    The feedback gets r_ref as it will be measured, behind the dead times and lags: so it does not work against the
    feedforward (O. J. M. Smith, 1957: dead-time compensation), and on a plant that is P_d with friction as modelled it
    stays 0. The compensated friction is that of the model along r_ref, averaged over each sample, as the thrust is held
    over it, and its viscous part. It stays on after a move: a guide that has been moved pushes back.

    The profile `jerk_limited` is that of most drives, for comparison: a jerk of constant magnitude, +, -, -, + in
    the quarters of the move, with the thrust of the rigid body alone, which leaves the modes to ring (P. Lambrechts et
    al., Control Engineering Practice 13(2), 2005, doi:10.1016/j.conengprac.2004.02.010).

    Lags before the thrust are part of P_d's model; the thrust against friction is not corrected for them. The limit is
    that of the feedforward; the feedback comes on top. Without a limit, a move beyond 1000 m/s² is refused: no axis
    makes it, and the model would be meaningless. It needs a P_d that is known: an error of P_d is an error of the
    thrust, and the modes ring.
    """

    targets: tuple[float, ...] = param("m", "targets, one after another, from the loop's reference", (1.5e-3,))
    duration: float = param("s", "time of each move, rounded up to samples", 0.04, above=0)
    dwell_time: float = param("s", "time at each target", 0.2, above=0, at_most=1000)
    profile: Literal["deadbeat", "jerk_limited"] = param("", "profile: deadbeat or jerk_limited", "deadbeat")
    cost: Literal["energy", "jerk", "snap"] = param("", "cost that deadbeat minimises: energy, jerk or snap", "jerk")
    force_limit: float | None = param("N", "maximum thrust of the feedforward, friction included", None, above=0)
    plant: Plant = param("", "design model P_d", inherit="plant")
    friction: FrictionModel | None = param(
        "", "friction model that is compensated; `none` for no compensation", None, inherit="friction"
    )
    input_dead_time: float = param("s", "dead time in G_di", 0.0, at_least=0, inherit="loop.input_dead_time")
    input_time_constants: tuple[float, ...] = param(
        "s", "time constants of first-order lags in G_di", (), inherit="loop.input_time_constants"
    )
    output_dead_time: float = param("s", "dead time in G_do", 0.0, at_least=0, inherit="loop.output_dead_time")
    output_time_constants: tuple[float, ...] = param(
        "s", "time constants of first-order lags in G_do", (), inherit="loop.output_time_constants"
    )

    def model_post_init(self, context: object) -> None:
        """Check that there is a motion, and that the lags are lags."""
        if not self.targets or 0.0 in self.distances:
            raise ParameterError(
                "point_to_point.targets needs one or more positions, each different from the one before"
            )
        if min(self.input_time_constants + self.output_time_constants, default=1.0) <= 0:
            raise ParameterError(
                "point_to_point has a time constant of 0 s or less; those of first-order lags must be above 0 s"
            )

    @property
    def distances(self) -> tuple[float, ...]:
        """Distances from one target to the next [m]."""
        return tuple(np.diff([0.0, *self.targets]).tolist())

    def check(self, sample_time: float) -> None:
        """Refuse moves that are too short for the design model or the force limit."""
        self.plan(sample_time)

    def plan(self, sample_time: float) -> motion_profiles.MotionPlan:
        """Return the planned motion, sampled at `sample_time` [s]."""
        try:
            hash(self)
        except TypeError:  # a plant or friction model with a parameter that is a list or a dictionary
            return _cached_plan.__wrapped__(self, sample_time)
        return _cached_plan(self, sample_time)

    def feedforward(self, sample_time: float) -> Feedforward:
        """Return the first move per metre: plan and model are linear in the distance."""
        distance = self.distances[0]
        plan = self.model_copy(update={"targets": (distance,)}).plan(sample_time)
        limit = None if self.force_limit is None else abs(distance)
        thrust, reference, displacement = (
            table / distance for table in (plan.thrust, plan.reference, plan.displacement)
        )
        return Feedforward(thrust, reference, displacement, motion_profiles.POINTS_PER_SAMPLE, self.friction, limit)

    def periods(self, sample_time: float) -> tuple[Period, ...]:
        """Return the whole motion as one period, which is run once."""
        plan = self.plan(sample_time)
        thrust = plan.thrust + plan.friction
        return (Period(thrust, _lines(thrust), plan.reference),)

    @property
    def schedule(self) -> Schedule:
        """Record from rest: the transient is the subject."""
        return Schedule(settling_timeout=0.0, recorded_periods=1)


@lru_cache(64)
def _cached_plan(motion: PointToPoint, sample_time: float) -> motion_profiles.MotionPlan:
    """Return the plan: cached, as a study checks a motion before running it, often on many machines."""
    times = (min(time / sample_time, 1e18) for time in (motion.duration, motion.dwell_time))
    move_samples, rest_samples = (int(np.ceil(time - 1e-9)) for time in times)
    samples = len(motion.targets) * (move_samples + rest_samples)
    if samples > MAX_MOTION_SAMPLES:
        longer = "'duration'" if move_samples > rest_samples else "'dwell_time'"
        fewer = ", or take fewer targets" if len(motion.targets) > 1 else ""
        raise ParameterError(
            f"point_to_point has {samples:,} samples; expected {MAX_MOTION_SAMPLES:,} or fewer: shorten {longer}{fewer}"
        )
    try:
        return motion_profiles.plan_motion(_task(motion, sample_time, move_samples, rest_samples))
    except ParameterError as error:
        raise ParameterError(f"point_to_point: {error}") from None


def _task(motion: PointToPoint, sample_time: float, move_samples: int, rest_samples: int) -> motion_profiles.MotionTask:
    model = DesignModel.from_plant(
        motion.plant.state_space(),
        sample_time,
        motion.input_dead_time + motion.output_dead_time,
        motion.input_time_constants,
        motion.output_time_constants,
    )
    parts = (model, motion.friction, motion.distances, move_samples, rest_samples, motion.force_limit)
    if motion.profile == "jerk_limited":
        return motion_profiles.JerkLimitedTask(*parts, motion_profiles.rigid_body_gain(motion.plant))
    return motion_profiles.DeadbeatTask(*parts, DIFFERENCE_ORDERS[motion.cost])


def _lines(thrust: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the smallest set of harmonics that carries `ENERGY_FRACTION` of the thrust's energy, ascending."""
    energy = np.abs(np.fft.rfft(thrust)[1 : (thrust.size + 1) // 2]) ** 2
    order = np.argsort(-energy, kind="stable")
    count = int(np.searchsorted(np.cumsum(energy[order]), ENERGY_FRACTION * energy.sum())) + 1
    return np.sort(order[:count]) + 1
