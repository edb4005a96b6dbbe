"""Periodic experiments on the loop, each from rest until it repeats itself: as many side by side as there are lanes.

A lane whose experiment ends takes the next one. Nothing that one lane does reaches another, so that an experiment has
the same result whatever runs beside it. All of it is the same for every friction law: what differs, the samples
themselves, is a block (see `fraexp.kernels.block`) that is called by its address.
"""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import from_dtype, njit, types

from fraexp.kernels.addresses import run_at
from fraexp.kernels.block import AMPLITUDE, FAST, FRAME, NEWEST, REFERENCE, RISE, SIGNATURE, make_block
from fraexp.kernels.law import Law, compilable, explained, fingerprint, kernel_sources
from fraexp.kernels.machine_code import address, compile_kernel

SLOWEST = 0.98
"""Greatest ratio of successive differences that is believed: slower ones look like noise."""
NOISE_ROWS = 512
"""Samples of noise that are drawn at once, at most."""
DONE, MORE, FULL = range(3)
"""What `advance` returns: all jobs are done, its samples are used up, the pool has no room for a result."""
WAITING, SETTLED, NOT_SETTLED, DIVERGED = range(4)
"""Status of a job."""
IDLE, RAMP, SETTLE, RECORD, LEFT_STROKE = range(5)
"""Stage of a lane."""
FOREVER = 1 << 62
JOB = np.dtype(
    [(name, np.int64) for name in ("machine", "begin", "period", "ramp", "stretch", "limit", "record")]
    + [(name, np.float64) for name in ("base", "rate", "tolerance", "floor", "reference")]
    + [("seed", np.uint64)]
)
"""An experiment: row of `machines`; first sample of the period in `waves` and `goals`, and its samples; samples before
stretches are compared, of a stretch (0 to record from the start), after which settling is given up, and that are
recorded once settled; amplitude at the start, relative, and its rise per sample; relative difference of stretches that
counts as settled, difference that scale and noise explain [m]; the reference at rest [m]; seed of the scale's noise."""
RESULT = np.dtype(
    [(name, np.int64) for name in ("status", "place", "lead_in", "settling")] + [("residual", np.float64)]
)
"""What is known of a job: its status; where its numbers begin in the pool, which are the positions from rest, then the
record's other channels; how many of the positions come before the record; samples before the record; relative
difference of the last two stretches."""
LANE = np.dtype(
    [(name, np.int64) for name in ("job", "stage", "left", "phase", "elapsed", "lost")]
    + [(name, np.float64) for name in ("excess", "difference")]
)
"""What a lane is at: its job, the stage of it, samples left of that, place in the period, samples since rest, whether
positions were forgotten; excess and difference of the last two stretches."""
QUEUE = np.dtype([(name, np.int64) for name in ("next", "used")])
"""The next job, and the numbers that are used of the pool."""


class KernelBatch(NamedTuple):
    """Experiments on their way; arrays that compiled code changes in place. Jobs are begun in their order."""

    jobs: np.ndarray
    """Shape (jobs,) of `JOB`."""
    results: np.ndarray
    """Shape (jobs,) of `RESULT`."""
    machines: np.ndarray
    """Constants of the loop and parameters of the law, one machine a row, shape (machines, numbers)."""
    waves: np.ndarray
    """All periods of the excitation [N], one after another, and as many zeros as the longest has samples."""
    goals: np.ndarray
    """The reference [m] along with them; empty where none moves."""
    sigma: float
    """Standard deviation of the scale's noise [m]."""
    store: np.ndarray
    """Constants and parameters of each lane, then the loop's memory, shape (rows, lanes)."""
    drive: np.ndarray
    """What drives the loop, shape (DRIVE_ROWS, lanes)."""
    trace: np.ndarray
    """What is known of a sample, shape (TRACE_ROWS, lanes)."""
    noise: np.ndarray
    """Noise of the next samples [m], shape (NOISE_ROWS, lanes)."""
    lanes: np.ndarray
    """Shape (lanes,) of `LANE`."""
    places: np.ndarray
    """Where each lane reads its excitation and starts its record; how much of `history` is filled; shape (3, lanes)."""
    history: np.ndarray
    """Measured positions from rest, shape (lanes, n)."""
    others: np.ndarray
    """Control input, displacement, friction force and its compensation, if any, of the record, (lanes, 3 or 4, n)."""
    queue: np.ndarray
    """Shape (1,) of `QUEUE`."""
    frame: np.ndarray
    """What a block of samples needs, shape (1,) of `FRAME`."""
    argument_sizes: np.ndarray
    """Size of each argument of the law, then of the compensation's: the frame has the addresses."""


SOURCE, START, FILLED = range(3)
"""Rows of `places`."""


class Laws(NamedTuple):
    """The law of friction and that of its compensation, if any, with the structure of what each takes."""

    law: Law
    kinds: Any
    observer_law: Law | None = None
    observer_kinds: Any = None


def advance(laws: Laws, wide: bool, work: KernelBatch, pool: np.ndarray, budget: int) -> int:
    """Go on with the experiments for at most `budget` samples; return DONE, MORE or FULL."""
    block = address(block_of(laws, wide))
    return int(_advance()(block, *work[:-1], pool, budget))


@cache
def block_of(laws: Laws, wide: bool) -> Any:
    """Return the compiled block of samples of laws, in lanes or not."""
    given = [law for law in (laws.law, laws.observer_law) if law is not None]
    source = "".join([kernel_sources(), *map(fingerprint, given)])
    made = [compilable(law) for law in given]

    def make() -> Any:
        return make_block(made[0], made[1] if len(made) > 1 else None, laws.kinds, laws.observer_kinds, wide)

    name = f"{' and '.join(law.__qualname__ for law in given)} {'in lanes' if wide else 'alone'} {laws[1::2]}"
    with explained(*given):
        return compile_kernel(name, source, make, SIGNATURE, **FAST)


@cache
def _advance() -> Any:
    return compile_kernel("experiments", kernel_sources(), lambda: _go_on, _SIGNATURE, **FAST)


def _go_on(  # type: ignore[no-untyped-def]
    block, jobs, results, machines, waves, goals, sigma, store, drive, trace, noise, lanes, places, history, others,
    queue, frames, pool, budget,
):  # fmt: skip
    frame, width, idle = frames[0], lanes.size, jobs[-1].begin + jobs[-1].period
    frame.moving, frame.noisy = goals.size > 0, sigma > 0.0
    while True:
        samples, busy, recording = budget, False, False
        for k in range(width):
            lane = lanes[k]
            while lane.left == 0:
                if not _turn(k, jobs, results, machines, store, drive, lanes, places, history, others, queue, pool):
                    return FULL
            places[SOURCE, k], places[START, k] = idle, FOREVER
            samples = min(samples, lane.left)
            if lane.stage == IDLE:
                continue
            busy, job = True, jobs[lane.job]
            if lane.stage == RECORD or (lane.stage == SETTLE and _suffices(job)):
                places[START, k] = lane.left - job.record
                recording = True
            places[SOURCE, k], samples = job.begin + lane.phase, min(samples, job.period - lane.phase)
        if not busy:
            return DONE
        if samples == 0:
            return MORE
        if sigma > 0.0:
            samples = min(samples, NOISE_ROWS)
            for k in range(width):
                for i in range(samples):
                    noise[i, k] = sigma * _normal(jobs[lanes[k].job].seed, lanes[k].elapsed + i)
        frame.samples, frame.recording = samples, recording
        run_at(block, frames)
        done = frame.done
        budget -= done
        for k in range(width):
            lane = lanes[k]
            lane.left -= done
            lane.elapsed += done
            lane.phase = (lane.phase + done) % jobs[lane.job].period
            places[FILLED, k] = places[FILLED, k] + done if lane.stage != IDLE else 0
            if lane.stage != IDLE and not abs(trace[NEWEST, k]) < frame.limit:
                lane.stage, lane.left = LEFT_STROKE, 0


@njit(**FAST)
def _turn(k, jobs, results, machines, store, drive, lanes, places, history, others, queue, pool):  # type: ignore[no-untyped-def]
    """Take a lane from one stage to the next; return whether the pool had room."""
    lane = lanes[k]
    job, result = jobs[lane.job], results[lane.job]
    if lane.stage in (IDLE, LEFT_STROKE):
        if lane.stage == LEFT_STROKE:
            result.status = DIVERGED
        _begin_next(k, jobs, machines, store, drive, lane, places, queue[0])
        return True
    if lane.stage == RECORD:
        if not _deliver(k, job.record, lane, result, places, history, others, queue[0], pool):
            return False
        _begin_next(k, jobs, machines, store, drive, lane, places, queue[0])
        return True
    if lane.stage == SETTLE:
        enough = lane.elapsed >= job.ramp + 2 * job.stretch
        agreed = job.stretch == 0 or (enough and _agree(history[k], places[FILLED, k], job, lane))
        if agreed or lane.elapsed >= job.limit:
            result.status = SETTLED if agreed else NOT_SETTLED
            result.residual = lane.difference
            if _suffices(job):
                result.settling = lane.elapsed - job.record
                lane.stage, lane.left = RECORD, 0
                return True
            result.settling = lane.elapsed
            lane.stage, lane.left = RECORD, job.record
            _make_room(k, job.stretch, job.record, lane, places, history)
            return True
    lane.stage, lane.left = SETTLE, job.stretch
    _make_room(k, job.stretch, job.stretch, lane, places, history)
    return True


@njit(**FAST)
def _suffices(job):  # type: ignore[no-untyped-def]
    """Return whether the last stretch that was compared is record enough."""
    return 0 < job.record <= job.stretch


@njit(**FAST)
def _begin_next(k, jobs, machines, store, drive, lane, places, queue):  # type: ignore[no-untyped-def]
    """Put the next job on a lane, at rest; where there is none the lane idles at rest."""
    numbers = machines.shape[1]
    for row in range(numbers, store.shape[0]):
        store[row, k] = 0.0
    for row in range(drive.shape[0]):
        drive[row, k] = 0.0
    lane.phase, lane.elapsed, lane.lost, places[FILLED, k] = 0, 0, 0, 0
    lane.excess, lane.difference = np.inf, np.nan
    machine = 0
    if queue.next < jobs.size:
        lane.job = queue.next
        queue.next += 1
        job = jobs[lane.job]
        machine = job.machine
        drive[AMPLITUDE, k], drive[RISE, k], drive[REFERENCE, k] = job.base, job.rate, job.reference
        lane.stage, lane.left = RAMP, job.ramp
    else:
        lane.job, lane.stage, lane.left = 0, IDLE, FOREVER
    for row in range(numbers):
        store[row, k] = machines[machine, row]


@njit(**FAST)
def _make_room(k, keep, samples, lane, places, history):  # type: ignore[no-untyped-def]
    """Forget all positions but the last `keep` where the history has no room for more."""
    filled = places[FILLED, k]
    if filled + samples > history.shape[1]:
        for i in range(keep):
            history[k, i] = history[k, filled - keep + i]
        places[FILLED, k], lane.lost = keep, 1


@njit(error_model="numpy", fastmath={"contract", "reassoc"})  # sums in vector registers
def _agree(history, filled, job, lane):  # type: ignore[no-untyped-def]
    """Compare the last stretch [m] with the one before.

    Relative to the motion, the difference beyond what scale and noise explain, extrapolated as a geometric series to
    all that is still to come, must be within the tolerance.
    """
    stretch, begin = job.stretch, filled - job.stretch
    mean = 0.0
    for i in range(begin, begin + stretch):
        mean += history[i]
    mean /= stretch
    swing, change = 0.0, 0.0
    for i in range(begin, begin + stretch):
        swing += (history[i] - mean) ** 2
        change += (history[i] - history[i - stretch]) ** 2
    swing, change = np.sqrt(swing / stretch), np.sqrt(change / stretch)
    if swing == 0.0:  # a machine at rest
        lane.difference = 0.0 if change == 0.0 else np.inf
        return change == 0.0
    lane.difference = change / swing
    excess, before = max(change - job.floor, 0.0) / swing, lane.excess
    ratio = min(excess / before, SLOWEST) if before > 0.0 else 0.0
    lane.excess = excess
    return excess * max(1.0, ratio / (1.0 - ratio)) <= job.tolerance


@njit(**FAST)
def _deliver(k, record, lane, result, places, history, others, queue, pool):  # type: ignore[no-untyped-def]
    """Copy a finished record to the pool, if it has room."""
    filled, used = places[FILLED, k], queue.used
    first = filled - record if lane.lost else 0
    if used + filled - first + others.shape[1] * record > pool.size:
        return False
    result.place, result.lead_in = used, filled - first - record
    for i in range(first, filled):  # a slice would compile the text of its error as well
        pool[used + i - first] = history[k, i]
    used += filled - first
    for channel in range(others.shape[1]):
        for i in range(record):
            pool[used + i] = others[k, channel, i]
        used += record
    queue.used = used
    return True


@njit(**FAST)
def _normal(seed, count):  # type: ignore[no-untyped-def]
    """Return the normal number `count` of a seed's sequence: any of them at once, in whatever order lanes ask.

    SplitMix64 (G. L. Steele, D. Lea and C. H. Flood, OOPSLA 2014, doi:10.1145/2660193.2660195) and Box-Muller.
    """
    first = _uniform(seed + np.uint64(2 * count + 1) * np.uint64(0x9E3779B97F4A7C15))
    second = _uniform(seed + np.uint64(2 * count + 2) * np.uint64(0x9E3779B97F4A7C15))
    return np.sqrt(-2.0 * np.log(first)) * np.cos(2.0 * np.pi * second)


@njit(**FAST)
def _uniform(state):  # type: ignore[no-untyped-def]
    """Return a number in (0, 1] from a state of 64 bits."""
    state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    state = state ^ (state >> np.uint64(31))
    return (np.float64(state >> np.uint64(11)) + 1.0) * (1.0 / 9007199254740992.0)


def _arrays(*dimensions: int) -> list[types.Type]:
    return [types.Array(types.float64, count, "C") for count in dimensions]


def _records(dtype: np.dtype) -> types.Type:
    return types.Array(from_dtype(dtype), 1, "C")


_SIGNATURE = (
    types.int64, _records(JOB), _records(RESULT), *_arrays(2, 1, 1), types.float64, *_arrays(2, 2, 2, 2),
    _records(LANE), types.Array(types.int64, 2, "C"), *_arrays(2, 3), _records(QUEUE), _records(FRAME), *_arrays(1),
    types.int64,
)  # fmt: skip
"""Of `_go_on`: the block's address, the fields of `Work`, the pool, and the samples."""
