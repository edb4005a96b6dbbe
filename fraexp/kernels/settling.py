"""Whether an experiment has settled, decided window by window; a slow decay is taken ahead to where it leads."""

import numpy as np
from numpy.typing import NDArray

from fraexp.kernels.batch_arrays import FILL_COUNT, BatchArrays, LoopJob, LoopLane
from fraexp.kernels.decorators import COMPILER_OPTIONS, compiled
from fraexp.kernels.periodic_state import DEPTH, combine_windows, jump, keep_state, predicted_change

EARLY_WINDOW, SLOW_WINDOW = 4, 8
"""Windows after which the decay is first looked at, and after which a slow one is extrapolated."""
SLOW_WINDOWS = 12
"""Least number of windows still to come with which a decay is slow."""
MAX_JUMPS = 8
"""Jumps after which the motion is taken back to the first one, and left to decay."""
MAX_DECAY_RATIO = 0.98
"""Greatest ratio of successive differences that the extrapolation uses: a slower decay looks like noise."""
REST_MOTION_M = 1e-18
"""Motion [m] that counts as rest."""
MAX_PHASOR_STDS = 3.0
"""Difference of two windows' phasors, in standard deviations by encoder and noise, that is no drift."""


@compiled(**COMPILER_OPTIONS)
def end_window(k: int, batch: BatchArrays, job: LoopJob, lane: LoopLane) -> bool:
    """Return whether lane k has settled at the end of a window; change its numbers where its decay is slow."""
    numbers, linear_rows, states = batch.lane_numbers[:, k], batch.linear_rows, batch.window_states[k]
    pair_windows, history, filled = batch.window_numbers[k], batch.history[k], batch.cursors[FILL_COUNT, k]
    lane.windows, lane.unbroken = lane.windows + 1, lane.unbroken + 1
    if lane.unbroken < 2:  # friction still follows a jump, or the ramp
        return False
    keep_state(numbers, linear_rows, states[1], lane.pairs)
    pair_windows[lane.pairs % DEPTH] = lane.windows
    lane.pairs += 1
    is_settled = _has_settled(history, filled, job, lane)
    if lane.windows == EARLY_WINDOW:
        lane.early_excess = lane.excess
    if lane.jumps == 0:
        if is_settled or not _is_slow(job, lane):
            return is_settled
        for i in range(batch.rest_rows.size):
            batch.saved_memory[k, i] = numbers[batch.rest_rows[i]]
        lane.first_jump = lane.elapsed
    elif lane.jumps >= MAX_JUMPS or lane.elapsed >= job.settling_limit:
        return is_settled or _take_back(k, batch, job, lane)
    count, weights = min(lane.pairs, DEPTH), np.empty(DEPTH)
    newest = lane.pairs - 1
    if not combine_windows(states[0], states[1], newest, count, weights):
        return is_settled
    change = predicted_change(history, filled, job.window, lane.windows, pair_windows, newest, count, weights)
    if change <= job.tolerance * lane.motion:
        return lane.excess <= job.tolerance
    jump(numbers, linear_rows, states[1], newest, count, weights)
    lane.jumps, lane.unbroken, lane.excess, lane.has_dropped = lane.jumps + 1, 0, np.inf, 1
    return False


@compiled(**COMPILER_OPTIONS)
def _is_slow(job: LoopJob, lane: LoopLane) -> bool:
    """Return whether the decay from window to window is slow but ends in time; note when it would."""
    if lane.expected != 0 or lane.windows < SLOW_WINDOW or not 0.0 < lane.excess < lane.early_excess < np.inf:
        return False
    rate = np.log(lane.excess / lane.early_excess) / (lane.windows - EARLY_WINDOW)
    windows = np.ceil(np.log(job.tolerance * (1.0 - np.exp(rate)) / lane.excess) / rate)
    if windows < SLOW_WINDOWS or lane.elapsed + windows * job.window > job.settling_limit:
        return False
    lane.expected = lane.elapsed + int(windows) * job.window
    return True


@compiled(**COMPILER_OPTIONS)
def _take_back(k: int, batch: BatchArrays, job: LoopJob, lane: LoopLane) -> bool:
    """Take lane k back to its first jump, from where its motion decays without further ones; return False.

    Only after an even number of windows: then the law's state is in the same half of its memory.
    """
    if (lane.elapsed - lane.first_jump) // job.window % 2 == 0:
        for i in range(batch.rest_rows.size):
            batch.lane_numbers[batch.rest_rows[i], k] = batch.saved_memory[k, i]
        lane.elapsed, lane.unbroken, lane.excess, lane.jumps = lane.first_jump, 0, np.inf, 0
        lane.expected = -1
    return False


@compiled(error_model="numpy", fastmath={"contract", "reassoc"})  # reassoc: the sums may use vector registers
def _has_settled(history: NDArray[np.float64], filled: int, job: LoopJob, lane: LoopLane) -> bool:
    """Compare the last window [m] with the one before.

    The difference beyond what encoder and noise explain, relative to the motion, is extrapolated as a geometric series
    to all that is still to come; it must be within the tolerance.
    """
    window, begin = job.window, filled - job.window
    mean = 0.0
    for i in range(begin, begin + window):
        mean += history[i]
    mean /= window
    motion, change = 0.0, 0.0
    for i in range(begin, begin + window):
        motion += (history[i] - mean) ** 2
        change += (history[i] - history[i - window]) ** 2
    motion, change = np.sqrt(motion / window), np.sqrt(change / window)
    if motion < REST_MOTION_M:  # a machine at rest: what is left of its motion is rounding
        lane.difference = 0.0 if change < REST_MOTION_M else np.inf
        return change < REST_MOTION_M
    lane.difference, lane.motion = change / motion, motion
    excess, before = max(change - job.noise_floor, 0.0) / motion, lane.excess
    lane.excess = excess
    if _all_to_come(excess, before) > job.tolerance:
        return False
    return job.noise_floor == 0.0 or job.cycles == 0 or not _drifts(history, filled, job, lane)


@compiled(**COMPILER_OPTIONS)
def _all_to_come(difference: float, before: float) -> float:
    """Return the sum of all differences to come, as a geometric series from the last two; at least the last one."""
    ratio = min(difference / before, MAX_DECAY_RATIO) if before > 0.0 else 0.0
    return difference * max(1.0, ratio / (1.0 - ratio))


@compiled(**COMPILER_OPTIONS)
def _drifts(history: NDArray[np.float64], filled: int, job: LoopJob, lane: LoopLane) -> bool:
    """Return whether the phasor at the excited line goes on changing, too slowly for successive windows to show it.

    A slow beat changes less from one window to the next than an encoder resolves, and yet adds up. It shows over half
    of the time since the start or a jump, and in the phasor, which averages the encoder's errors over a window.
    """
    lag = (min(filled // job.window, lane.unbroken) - 1) // 2
    if lag == 0:
        return False
    begin, apart = filled - job.window, lag * job.window
    last = _phasor(history, begin, job)
    middle = _phasor(history, begin - apart, job)
    first = _phasor(history, begin - 2 * apart, job)
    explained = MAX_PHASOR_STDS * job.noise_floor * np.sqrt(2.0 / job.window)
    difference, before = max(abs(last - middle) - explained, 0.0), abs(middle - first)
    return bool(_all_to_come(difference, before) > job.tolerance * abs(last))


@compiled(**COMPILER_OPTIONS)
def _phasor(history: NDArray[np.float64], begin: int, job: LoopJob) -> complex:
    """Return the phasor [m] at the excited line over a window."""
    angle = -2.0 * np.pi * job.cycles / job.period
    turn, factor, total = complex(np.cos(angle), np.sin(angle)), complex(1.0, 0.0), complex(0.0, 0.0)
    for i in range(begin, begin + job.window):
        total += history[i] * factor
        factor *= turn
    return 2.0 / job.window * total
