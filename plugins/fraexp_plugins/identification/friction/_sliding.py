"""Where a machine slides, for laws that say nothing of a standstill, and a start of its record that differs."""

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fraexp_plugins.identification.friction._friction_record import FrictionRecord, quantisation_step
from fraexp_plugins.identification.friction._regression import Rows, least_squares

MIN_SPEED_RATIO = 0.03
"""Slowest over fast sliding."""
MIN_STEPS_PER_SAMPLE = 4.0
"""Quantisation steps per sample in the slowest sliding: with fewer steps its direction is uncertain."""
START_FRACTIONS = 0.0, 1 / 64, 1 / 32, 1 / 16, 1 / 8, 1 / 4
"""Parts of a record between which its start may end; the rest of it is fitted."""
MIN_START_RATIO, MIN_NEXT_RATIO = 4.0, 2.0
"""Residual in a part over that in the rest, root mean squares, from which the start is disturbed, and a next part."""
MIN_START_ERROR = 1e-3
"""Residual in the start over the thrust, root mean squares, up to which it may be rounding."""
MIN_START_ROWS, MIN_REST_ROWS = 5, 60
"""Rows of a start of which the residual tells something, and of the rest."""


def slides(records: Sequence[FrictionRecord], presliding_distance: float) -> list[NDArray[np.bool_]]:
    """Return whether the machine slides at each sample, shape (n,): fast, and far from the last reversal [m]."""
    velocities = [record.velocity() for record in records]
    step = quantisation_step(records) / records[0].sample_time
    fast = MIN_SPEED_RATIO * float(np.percentile(np.abs(np.concatenate(velocities)), 95))
    least = max(fast, MIN_STEPS_PER_SAMPLE * step)
    return [
        (np.abs(v) >= least) & (_travel_since_reversal(record.displacement, v) >= presliding_distance)
        for record, v in zip(records, velocities, strict=True)
    ]


def _travel_since_reversal(displacement: NDArray[np.float64], velocity: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the travel of each sample since the last reversal [m], shape (n,)."""
    turned = np.diff(np.sign(velocity), prepend=np.sign(velocity[0])) != 0
    turned[0] = True  # the motion before is unknown
    last = np.maximum.accumulate(np.where(turned, np.arange(velocity.size), 0))
    return np.abs(displacement - displacement[last])


def disturbed_start(assumptions: Sequence[Sequence[Rows]], duration: float) -> tuple[float, list[str]]:
    """Return the beginning of the records [s] that the model of the rest does not explain, and a remark; 0 if none.

    After a jump of the reference, a transient of the drive or of a mode, the beginning differs from the rest. The rows
    come once for each of several assumptions on the thrust, of which the one counts that fits better. One part more is
    left out than differs clearly, because such a transient decays.
    """
    limits = duration * np.array(START_FRACTIONS)
    rest, ratios = min((_start_ratios(rows, limits) for rows in assumptions), key=lambda found: found[0])
    if not np.isfinite(rest) or max(ratios) < MIN_START_RATIO:
        return 0.0, []
    last = int(np.flatnonzero(np.array(ratios) > MIN_NEXT_RATIO)[-1])
    end = float(limits[min(last + 2, limits.size - 1)])
    return end, [
        f"the first {end:.3g} s are left out, because their error is up to {max(ratios):.2g} times that of the rest, "
        "as after a jump of the reference; to choose that time yourself set skip_time in [record] (--skip-time)"
    ]


def _start_ratios(found: Sequence[Rows], limits: NDArray[np.float64]) -> tuple[float, list[float]]:
    """Return the root mean square residual [N] after the last limit [s], and those between the limits over it."""
    columns, force, time = (np.concatenate([getattr(f, name) for f in found]) for name in ("columns", "force", "time"))
    rest = time >= limits[-1]
    if rest.sum() < MIN_REST_ROWS:
        return np.inf, [0.0]
    residual = force - columns @ least_squares(columns[rest], force[rest])
    parts = [residual[(time >= low) & (time < high)] for low, high in itertools.pairwise(limits)]
    sizes = [float(np.sqrt(np.mean(part**2))) if part.size >= MIN_START_ROWS else 0.0 for part in parts]
    error = float(np.sqrt(np.mean(residual[rest] ** 2)))
    least = MIN_START_ERROR * float(np.sqrt(np.mean(force[rest] ** 2)))
    return error, [size / error if size > least and error else 0.0 for size in sizes]
