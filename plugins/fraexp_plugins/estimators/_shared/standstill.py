"""Standstill: while friction holds the machine its force is not in the sampled motion, so that no observer sees it."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    CURVE_POINTS,
    ROUNDING,
    FrictionModel,
    Motion,
    PositionDependentFriction,
    Segment,
    hold_response,
    path_response,
    record_spectrum,
    significant_deviation,
)
from fraexp_plugins.estimators._shared.effective_input_observer import ObserverEstimator, is_from_rest

MIN_HIDDEN_SHARE = 0.05
"""Share of the friction force, from which it counts as hidden, that a motion too small to be seen can change."""
PROBE_M, SLOW_STEP_S = 1e-3, 1e3
"""A slow motion on which friction reaches its greatest force: length [m], and duration of a step [s]."""


class HiddenForce(NamedTuple):
    """What standstill hides from the observer in a segment."""

    spectrum: NDArray[np.complex128]
    """What is to be added to û_e [N], Σ x e^{-jωt} over all periods as one record of n samples, shape (n // 2 + 1,)."""
    share: float
    """Share of the record in which the machine stands still."""
    change: float
    """Greatest difference [N] of the model's force at standstill from the true one."""

    def phasors(self, segment: Segment) -> NDArray[np.complex128]:
        """Return the mean over the periods at the excited lines [N], shape (lines,)."""
        y = next(iter(segment.channels.values()))
        return self.spectrum[segment.lines * len(y)] * (2 / y.size)

    def greatest_amplitude(self, segment: Segment) -> NDArray[np.float64]:
        """Return the greatest amplitude at the excited lines [N], whatever the force at standstill is, shape (lines,).

        A force within ±F for a share s of the time has at most that of one that follows the sine's sign around its
        peaks, 4/π F sin(π s/2).
        """
        standing = 4 / np.pi * self.change * np.sin(np.pi / 2 * self.share)
        return np.maximum(np.abs(self.phasors(segment)), standing)


def hidden_forces(observer: ObserverEstimator, segments: Sequence[Segment]) -> list[HiddenForce | None]:
    """Return what standstill hides from the observer in each segment; None where the motion shows all of the force.

    It does if friction is a function of the motion, the encoder shows the one within which it sticks, and that between
    samples changes the force by less than 5 %. Else the force is open while the machine stands: it balances the input,
    û_e vanishes but for the free vibration of what hangs on the machine. Setting û_e to zero there gives another
    estimate of the plant. Its difference from the one found is what can be known of the error without a model of the
    plant; where the machine stands for a large part of a period it is an order of magnitude. At a reversal without
    standstill such a force jumps half a point of the interpolated motion too late.
    """
    found: list[HiddenForce | None] = [None] * len(segments)
    doubts = _find_doubts(observer, segments)
    forces = observer._forces([segments[doubt.segment] for doubt in doubts])
    for doubt, force in zip(doubts, forces, strict=True):
        found[doubt.segment] = _hidden_force(observer, segments[doubt.segment], doubt, force.ravel())
    return found


class _Doubt(NamedTuple):
    """A segment that does not show all of the friction force."""

    segment: int
    stop: float
    """Motion [m] within which the machine stands."""
    change: float
    """Change of the friction force [N] by a motion that the record cannot show."""
    share: float
    """This change over twice the greatest force, at most 1."""


def _find_doubts(observer: ObserverEstimator, segments: Sequence[Segment]) -> list[_Doubt]:
    friction, ratio = observer.law, 1.0
    if isinstance(friction, PositionDependentFriction):  # the motion shows what depends on the position
        ratio, friction = friction.position_dependence.max_ratio, friction.everywhere_alike
    greatest, stiffness = observer.force_scale * _greatest_force(friction), friction.max_stiffness
    if min(greatest, stiffness) <= 0:
        return []
    stop = observer.displacement_scale * greatest / observer.force_scale / stiffness
    least = stop if friction.velocity_law else 0.0  # set-valued: its stop is no motion
    hidden = max(least, _hidden_motion(observer, stop))
    unseen = [(index, max(hidden, _unsampled_motion(observer, each))) for index, each in enumerate(segments)]
    unseen = [(index, motion) for index, motion in unseen if motion >= MIN_HIDDEN_SHARE * stop]  # without the law
    motions = [
        Motion(np.array([0.0, motion / observer.displacement_scale]), segments[index].sample_time)
        for index, motion in unseen
    ]
    doubts = []
    for (index, motion), force in zip(unseen, friction.forces(motions), strict=True):
        change = float(2 * observer.force_scale * np.abs(force).max())
        share = min(change / (2 * greatest), 1.0)
        if share >= MIN_HIDDEN_SHARE:
            doubts.append(_Doubt(index, max(stop, motion), ratio * change, share))
    return doubts


def _greatest_force(friction: FrictionModel) -> float:
    """Return the greatest force [N] of the friction model: its bound, or what it reaches on a slow motion."""
    if friction.force_bound is not None:
        return friction.force_bound
    force = friction.force(np.linspace(0.0, PROBE_M, CURVE_POINTS), SLOW_STEP_S)
    return float(np.abs(force).max())


def _hidden_force(
    observer: ObserverEstimator, segment: Segment, doubt: _Doubt, force: NDArray[np.float64]
) -> HiddenForce:
    """Return what standstill hides in a segment, from the observer's force [N] on its fine grid, shape (n,)."""
    y, sample_time = segment.channels[observer.output].ravel(), segment.sample_time
    force = observer.force_scale * force
    viscous = observer.law.viscous * (np.roll(y, -1) - y) / sample_time
    effective = _thrust(observer, segment) - _interval_means(force, observer.points(segment)) - viscous
    stands = np.abs(np.roll(y, -1) - y) <= doubt.stop  # it may, in the interval that begins with each sample
    standing = np.where(stands, np.clip(-effective, -doubt.change, doubt.change), 0.0)
    omega = 2 * np.pi * np.fft.rfftfreq(y.size, sample_time)
    advance = np.exp(0.5j * omega * sample_time / observer.points(segment)) - 1
    turning = doubt.share * advance * np.fft.rfft(force)[: omega.size] / observer.points(segment)
    return HiddenForce(
        hold_response(omega, sample_time) * np.fft.rfft(standing) - turning, float(stands.mean()), doubt.change
    )


def _hidden_motion(observer: ObserverEstimator, stop: float) -> float:
    """Return the motion [m] within which the encoder cannot show whether the machine stands; 0 if it shows a part.

    Within the stop friction is a function of the motion: a part of it is drawn with the possible motions.
    """
    encoder = float(observer.resolution / 2 + significant_deviation() * np.sqrt(2) * observer.noise)
    return encoder if encoder >= stop else 0.0


def _unsampled_motion(observer: ObserverEstimator, segment: Segment) -> float:
    """Return the motion [m] between the samples of a periodic record; 0 of another one."""
    if is_from_rest(segment) or not segment.periodic:
        return 0.0
    size = segment.channels[observer.output].size
    periods = len(segment.channels[observer.output])
    bins = np.abs(record_spectrum(segment, observer.output)) * 2 / size
    bins[segment.lines[segment.lines * periods < bins.size] * periods] = 0.0
    scatter = 2 * np.sqrt((observer.noise**2 + observer.resolution**2 / 12 * periods) / size)
    octave = bins[bins.size // 2 :]
    # acceleration jumps where a machine sticks or breaks away: harmonics fall with their third power, and those beyond
    # the octave add up to 1/(2² - 1) of it
    return float(1 / 3 * octave[octave > significant_deviation() * scatter].sum())


def _thrust(observer: ObserverEstimator, segment: Segment) -> NDArray[np.float64]:
    """Return the mean of the delayed input [N] over the interval that begins with each sample, shape (n,)."""
    u = segment.channels[observer.input].ravel()
    lags = (*observer.input_time_constants, *observer.output_time_constants)
    if lags:
        omega = 2 * np.pi * np.fft.rfftfreq(u.size, segment.sample_time)
        u = np.fft.irfft(np.fft.rfft(u) * path_response(omega, 0.0, lags), u.size)
    delay = (observer.input_dead_time + observer.output_dead_time) / segment.sample_time
    whole = int(np.floor(delay + ROUNDING))
    late = max(delay - whole, 0.0)
    return np.asarray((1 - late) * np.roll(u, whole) + late * np.roll(u, whole + 1))


def _interval_means(fine: NDArray[np.float64], points: int) -> NDArray[np.float64]:
    """Return the mean over each sample's interval of a force that has `points` values in it, shape (n,)."""
    middles = 0.5 * (fine + np.roll(fine, -1))
    return np.asarray(middles.reshape(-1, points).mean(axis=1))
