"""A motion from target to target with its feedforward: two degrees of freedom beside the feedback."""

from functools import lru_cache
from typing import Literal

import numpy as np

from fraexp.api import Excitation, FrictionModel, ParameterError, Period, Plant, Schedule, param
from fraexp_plugins.positioning.design_model import DesignModel
from fraexp_plugins.positioning.motion import Move, Plan, planned
from fraexp_plugins.positioning.profiles import Deadbeat, JerkLimited, rigid_body_gain

ORDERS = {"energy": 0, "jerk": 1, "snap": 2}
"""Differences of the thrust that each cost makes small: of a rigid body the thrust is the acceleration."""
CARRIED = 0.99
"""Share of the thrust's energy that the stated lines carry."""
LONGEST = 250_000
"""Samples of a motion at most: it is planned when its study is read, in a second or two for so many."""


class PointToPoint(Excitation, name="point_to_point", version=1):
    """u_ff = D_ff r and r_ref = N_ff r of the deadbeat framework, with rolling friction compensated (paper, Fig 7).

    From one target to the next the design model P_d is taken from rest to rest in a finite time: with the coprime
    factors N(z)/D(z) of P_d behind a zero-order hold, u_ff = D v and r_ref = N v of one v that ends in a constant
    (E. I. Jury, Sampled-Data Control Systems, 1958). All states of P_d come to rest, so that its modes do not vibrate.
    Of all such motions it is the one of least Σ(Δu)² (`cost`: jerk; energy: Σu²; snap: Σ(Δ²u)²) whose thrust stays
    within `force_limit`: a quadratic program, solved as least distance programming (C. L. Lawson and R. J. Hanson,
    Solving Least Squares Problems, 1974, section 23.4).

    The feedback is given r_ref as it will be measured, behind the dead times and lags: so it does not work against the
    feedforward (O. J. M. Smith, 1957: dead-time compensation), and on a plant that is P_d with friction as modelled it
    has nothing to do. Friction is that of the model along r_ref, averaged over each sample, as it is held, and its
    viscous part. After a move it is held: a guide that has been moved pushes back.

    The profile `jerk_limited` is what drives have instead, for comparison: a jerk of constant magnitude, +, -, -, + in
    the quarters of the move, with the thrust of the rigid body alone, which leaves the modes to ring (P. Lambrechts et
    al., Control Engineering Practice 13(2), 2005, doi:10.1016/j.conengprac.2004.02.010).

    Lags before the thrust are part of P_d's model; the friction's thrust is not led against them. The limit is that of
    the feedforward; the feedback comes on top. Without a limit, a move beyond 1000 m/s² is refused: no axis makes it,
    and the model would say nothing of one. Not to be used with a P_d that is not known: the thrust is then wrong by
    as much, and the modes ring.
    """

    targets: tuple[float, ...] = param("m", "targets, one after another, from the loop's reference", (1.5e-3,))
    duration: float = param("s", "time of each move, rounded up to samples", 0.04, above=0)
    hold: float = param("s", "time at each target", 0.2, above=0, at_most=1000)
    profile: Literal["deadbeat", "jerk_limited"] = param("", "profile: deadbeat or jerk_limited", "deadbeat")
    cost: Literal["energy", "jerk", "snap"] = param("", "what deadbeat makes least: energy, jerk or snap", "jerk")
    force_limit: float | None = param("N", "greatest thrust of the feedforward, friction included", None, above=0)
    plant: Plant = param("", "design model P_d", inherit="plant")
    friction: FrictionModel | None = param(
        "", "friction model that is compensated; `none` or nothing for none", None, inherit="friction"
    )
    input_dead_time: float = param("s", "dead time in G_di", 0.0, at_least=0, inherit="loop.input_dead_time")
    input_lags: tuple[float, ...] = param("s", "first-order lags in G_di", (), inherit="loop.input_lags")
    output_dead_time: float = param("s", "dead time in G_do", 0.0, at_least=0, inherit="loop.output_dead_time")
    output_lags: tuple[float, ...] = param("s", "first-order lags in G_do", (), inherit="loop.output_lags")

    def model_post_init(self, context: object) -> None:
        """Check that there is a motion, and that the lags are lags."""
        if not self.targets or 0.0 in self.distances:
            raise ParameterError("point_to_point.targets must be one position at least, each another than the last one")
        if min(self.input_lags + self.output_lags, default=1.0) <= 0:
            raise ParameterError("point_to_point has a lag of 0 s or less; a first-order lag must be above 0 s")

    @property
    def distances(self) -> tuple[float, ...]:
        """From one target to the next [m]."""
        return tuple(np.diff([0.0, *self.targets]).tolist())

    def check(self, sample_time: float) -> None:
        """Refuse moves that are too short for the design model or the force limit."""
        self.plan(sample_time)

    def plan(self, sample_time: float) -> Plan:
        """Return the motion, sampled at `sample_time` [s]."""
        try:
            hash(self)
        except TypeError:  # a plant or friction model with a parameter that is a list or a dictionary
            return _planned.__wrapped__(self, sample_time)
        return _planned(self, sample_time)

    def periods(self, sample_time: float) -> tuple[Period, ...]:
        """Return the whole motion, which is made once."""
        plan = self.plan(sample_time)
        thrust = plan.thrust + plan.friction
        return (Period(thrust, _lines(thrust), plan.reference),)

    @property
    def schedule(self) -> Schedule:
        """Nothing is settled: the way from rest is what is asked for."""
        return Schedule(settle_limit=0.0, periods=1)


@lru_cache(64)
def _planned(motion: PointToPoint, sample_time: float) -> Plan:
    """Return the plan: a study checks a motion before it is run, and runs the same one on many machines."""
    times = (min(time / sample_time, 1e18) for time in (motion.duration, motion.hold))
    moving, resting = (int(np.ceil(time - 1e-9)) for time in times)
    samples = len(motion.targets) * (moving + resting)
    if samples > LONGEST:
        culprit = "'duration'" if moving > resting else "'hold'"
        fewer = ", or take fewer targets" if len(motion.targets) > 1 else ""
        raise ParameterError(
            f"point_to_point has {samples:,} samples; expected {LONGEST:,} at most: shorten {culprit}{fewer}"
        )
    try:
        return planned(_task(motion, sample_time, moving, resting))
    except ParameterError as error:
        raise ParameterError(f"point_to_point: {error}") from None


def _task(motion: PointToPoint, sample_time: float, moving: int, resting: int) -> Move:
    model = DesignModel.of(
        motion.plant.state_space(),
        sample_time,
        motion.input_dead_time + motion.output_dead_time,
        motion.input_lags,
        motion.output_lags,
    )
    parts = (model, motion.friction, motion.distances, moving, resting, motion.force_limit)
    if motion.profile == "jerk_limited":
        return JerkLimited(*parts, rigid_body_gain(motion.plant))
    return Deadbeat(*parts, ORDERS[motion.cost])


def _lines(thrust: np.ndarray) -> np.ndarray:
    """Return the fewest harmonics that carry `CARRIED` of the thrust's energy, ascending."""
    energy = np.abs(np.fft.rfft(thrust)[1 : (thrust.size + 1) // 2]) ** 2
    order = np.argsort(-energy, kind="stable")
    count = int(np.searchsorted(np.cumsum(energy[order]), CARRIED * energy.sum())) + 1
    return np.sort(order[:count]) + 1
