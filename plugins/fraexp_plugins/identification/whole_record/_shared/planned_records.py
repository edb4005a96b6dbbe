"""What records that are not measured yet would tell: their information, from a simulation of a preliminary machine."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp_plugins.identification.whole_record._shared.interval_likelihood import interval_loss
from fraexp_plugins.identification.whole_record._shared.joint_fit import LinearRecord
from fraexp_plugins.identification.whole_record._shared.record_fit import RecordFit, State

MIN_DITHER_RATIO = 0.1
"""Noise over the encoder's step below which a repeated period is rounded as the one before, and tells nothing new."""


class PlannedRecord(NamedTuple):
    """One sine that may be measured, and what a period of it would tell."""

    frequency: float
    """[Hz]"""
    amplitude: float
    """[N]"""
    period: float
    """Time of a period [s]: whole cycles in whole samples."""
    settled: float
    """Time until it has settled [s], which the one period of the shortest record is part of."""
    stroke: float
    """Peak to peak motion [m]."""
    shared: NDArray[np.float64]
    """Information of a period about the shared parameters, where the response is the plant's, shape (p, p)."""
    own: NDArray[np.float64]
    """Relative covariance of 1/P̂ from a period whose friction is known, shape (2, 2)."""
    slopes: NDArray[np.float64]
    """Relative change of 1/P̂ by the shared parameters, shape (2, p): as they are wrong, so is the response."""
    told: NDArray[np.float64]
    """Covariance of the error of 1/P̂ that is the record's own with the shared parameters, over that of the latter,
    shape (2, p): the record tells them, too."""
    has_dither: bool
    """Whether a repeated period tells as much again."""

    def time(self, count: int) -> float:
        """Return the time that so many periods take [s]; none if it is not measured.

        A record no longer than the windows in which settling shows is the last of them; a longer one comes after it.
        """
        if not count:
            return 0.0
        return self.settled + (count * self.period if count > 1 else 0.0)

    def weight(self, count: int) -> int:
        """Return how many periods tell something new."""
        return count if self.has_dither else min(count, 1)


def planned_records(fit: RecordFit, amplitudes: Sequence[float]) -> list[PlannedRecord]:
    """Return what the simulated records of a fit would tell about the machine that was simulated, and the fit knows.

    `amplitudes` are those of their excitation [N].
    """
    state = State(np.zeros(len(fit.free.names)), tuple(np.zeros(record.count) for record in fit.records))
    fit = fit.with_needed_drifts(state)
    state = State(state.shared, tuple(np.zeros(record.count) for record in fit.records))
    linear, has_dither = fit.linearised_at(state), fit.noise >= MIN_DITHER_RATIO * fit.resolution
    found = []
    for amplitude, record, each, inverse, slopes in zip(
        amplitudes, fit.records, linear.records, linear.inverse, linear.inverse_slopes, strict=True
    ):
        segment = record.segment
        shared, own, by_shared, told = _information(each, slopes[0] / inverse[0], record.forces)
        found.append(
            PlannedRecord(
                frequency=float(record.frequency[0]),
                amplitude=amplitude,
                period=segment.samples * segment.sample_time,
                settled=(segment.settling.time if segment.settling else 0.0) + segment.samples * segment.sample_time,
                stroke=float(np.ptp(record.position)),
                shared=shared,
                own=own,
                slopes=by_shared,
                told=told,
                has_dither=has_dither,
            )
        )
    return found


def _information(
    record: LinearRecord, slopes: NDArray[np.complex128], forces: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return what a planned record knows: `shared`, `own`, `slopes` and `told`."""
    p = record.shared.shape[1]
    curvature = interval_loss(record.residual, record.resolution, record.std).curvature
    jacobian = np.hstack([record.shared, record.own])
    hessian = (jacobian.T * curvature) @ jacobian
    # Where the response is the plant's, a record has a drift of its own only.
    drift = hessian[p + forces :, p + forces :]
    mixed_drift = hessian[p + forces :, :p]
    by_drift = np.linalg.solve(drift, mixed_drift)
    shared = hessian[:p, :p] - mixed_drift.T @ by_drift
    parts = np.stack([slopes.real, slopes.imag])
    gain = np.linalg.solve(hessian[p:, p:], parts[:, p:].T).T
    own, mixed = gain @ parts[:, p:].T, hessian[p:, :p]
    told = gain @ (mixed - hessian[p:, p + forces :] @ by_drift)
    return shared, own, parts[:, :p] - gain @ mixed, told


class Plan(NamedTuple):
    """Records that are to be measured, and how often each of them."""

    records: tuple[PlannedRecord, ...]
    counts: tuple[int, ...]
    """Periods of each; 0 for one that is left out."""

    @property
    def time(self) -> float:
        """Measuring time [s]."""
        return sum(record.time(count) for record, count in zip(self.records, self.counts, strict=True))

    @property
    def measured(self) -> list[tuple[PlannedRecord, int]]:
        """The records that are measured, each with its number of periods."""
        return [pair for pair in zip(self.records, self.counts, strict=True) if pair[1]]

    def covariance(self) -> NDArray[np.float64]:
        """Return the covariance of the shared parameters, shape (p, p)."""
        return np.asarray(np.linalg.pinv(sum(r.weight(n) * r.shared for r, n in self.measured), hermitian=True))

    def standard_deviations(self) -> NDArray[np.float64]:
        """Return the relative standard deviation of P̂ of each measured record, shape (n,).

        The shared parameters are told by all records, that of the response among them: see `covariances_beside`.
        """
        covariance, measured = self.covariance(), self.measured
        weights = np.array([record.weight(count) for record, count in measured])
        own = np.array([np.trace(record.own) for record, _ in measured]) / weights
        slopes, told = (np.array(each) for each in zip(*((r.slopes, r.told) for r, _ in measured), strict=True))
        by_shared = np.einsum("kip,pq,kiq->k", slopes, covariance, slopes + 2 * told)
        return np.asarray(np.sqrt(own + by_shared))


def log_deviation(plan: Plan, friction: int, is_wanted: Sequence[bool]) -> float:
    """Return the logarithm of what a plan leaves open: of wanted responses and of the first shared parameters.

    Of the responses it is the root mean square of the relative standard deviations, in which the widest band counts
    most; of friction's parameters, which have no common size, the geometric mean. Both count alike.
    """
    wanted = [each for each, count in zip(is_wanted, plan.counts, strict=True) if count]
    responses = plan.standard_deviations()[np.array(wanted, dtype=bool)]
    logs = [0.5 * np.log(np.mean(responses**2))]
    if friction:
        logs.append(0.5 * np.mean(np.log(np.diag(plan.covariance())[:friction])))
    return float(np.mean(logs))
