"""Periodic experiments on the loop, each from rest until it repeats itself: as many side by side as there are lanes.

A lane whose experiment ends takes the next one. Nothing that one lane does reaches another, so that an experiment has
the same result whatever runs beside it.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numba.extending import overload

from fraexp.kernels.lanes import LanesType, all_within
from fraexp.kernels.law import Law, cached, call
from fraexp.kernels.loop import FAST, bound, bound_argument, bound_state, get_number, put_number, sample, taken_from

SLOWEST = 0.98
"""Greatest ratio of successive differences that is believed: slower ones look like noise."""
DONE, MORE, FULL = range(3)
"""What `advance` returns: all jobs are done, its samples are used up, the pool has no room for a result."""
WAITING, SETTLED, NOT_SETTLED, DIVERGED = range(4)
"""Status of a job."""
IDLE, RAMP, SETTLE, RECORD, LEFT_STROKE = range(5)
"""Stage of a lane."""


class Jobs(NamedTuple):
    """Experiments, in the order in which they are begun; the columns of an array each, shape (jobs,)."""

    machine: np.ndarray
    """Row of `machines`."""
    begin: np.ndarray
    """First sample of the period in `waves` and `goals`."""
    period: np.ndarray
    """Samples of a period."""
    ramp: np.ndarray
    """Samples before stretches are compared."""
    stretch: np.ndarray
    """Samples of a stretch; 0 to record from the start."""
    limit: np.ndarray
    """Samples after which settling is given up."""
    record: np.ndarray
    """Samples that are recorded once settled."""
    base: np.ndarray
    """Amplitude at the start, relative."""
    rate: np.ndarray
    """Its rise per sample."""
    tolerance: np.ndarray
    """Relative difference of stretches that counts as settled."""
    floor: np.ndarray
    """Difference of stretches that scale and noise explain [m]."""
    seed: np.ndarray
    """Seed of the scale's noise, uint64."""


class Table(NamedTuple):
    """What all jobs share."""

    machines: np.ndarray
    """Constants of the loop and parameters of the law, one machine a row."""
    waves: np.ndarray
    """All periods of the excitation [N], one after another, and as many zeros as the longest has samples."""
    goals: np.ndarray
    """The reference [m] along with them; one number per job where none moves."""
    settings: tuple[float, float, float, float]
    """Step [s], resolution of the scale [m], its noise [m], displacement that counts as diverged [m]."""
    sizes: tuple[int, ...]
    """States n, steps a sample m, friction states, controller order, whole samples of both dead times; states of the
    compensation's friction model."""


class Lanes(NamedTuple):
    """All that the lanes remember; changed in place."""

    constants: tuple[np.ndarray, ...]
    """The machine's, by part; views of `store`."""
    arguments: Any
    """The law's; views of `store`."""
    compensation: Any
    """Gain, viscous coefficient, sample time and the arguments of its law; views of `store`, or empty."""
    store: np.ndarray
    """Constants and parameters of each lane, shape (numbers, lanes)."""
    memory: tuple[np.ndarray, ...]
    """The loop's."""
    drive: np.ndarray
    """Noise [m]; relative amplitude at the start, its rise, samples since; reference at rest [m]; shape (5, lanes)."""
    trace: np.ndarray
    """What is known of a sample, shape (TRACED, lanes)."""
    counters: np.ndarray
    """Job, stage, samples left of it, phase, samples in `history`, samples since rest, lost; shape (lanes, 7)."""
    agreement: np.ndarray
    """Excess and difference of the last stretches, shape (lanes, 2)."""
    history: np.ndarray
    """Measured positions from rest, shape (lanes, n)."""
    others: np.ndarray
    """Control input, displacement, friction force and its compensation, if any, of the record, (lanes, 3 or 4, n)."""
    queue: np.ndarray
    """Next job, numbers in the pool, valid half of the friction memory."""


class Results(NamedTuple):
    """What is known of each job."""

    status: np.ndarray
    """Shape (jobs,)."""
    place: np.ndarray
    """Where its numbers begin in the pool: the positions from rest, then the record's other channels."""
    lead_in: np.ndarray
    """How many of the positions come before the record."""
    settling: np.ndarray
    """Samples before the record."""
    residual: np.ndarray
    """Relative difference of the last two stretches."""


JOB, STAGE, LEFT, PHASE, FILLED, ELAPSED, LOST = range(7)
NEXT, USED, NOW = range(3)
EXCESS, DIFFERENCE = range(2)
FOREVER = 1 << 62


def advance(
    laws: tuple[Law, Law], jobs: Jobs, table: Table, lanes: Lanes, results: Results, pool: np.ndarray, budget: int
) -> int:
    """Go on with the experiments for at most `budget` samples; return DONE, MORE or FULL.

    The laws are that of friction and that of its compensation: the same one where there is none.
    """
    # plain tuples: looking up the type of a named one takes long
    parts = tuple(jobs), tuple(table), tuple(lanes), tuple(results)
    return int(call(_make_advance, laws, *parts, pool, budget))


def _make_advance(law: Law, observer_law: Law, fingerprint: str) -> Any:
    def advance(jobs, table, lanes, results, pool, budget):  # type: ignore[no-untyped-def]
        _ = fingerprint  # a cell of the closure: an edited law is compiled again
        waves, goals, settings, sizes = table[1], table[2], table[3], table[4]
        step, resolution, sigma, limit = settings
        constants_of, arguments_of, compensation_of, _store, memory_of, drive_of, trace_of = lanes[:7]
        counters, _agreement, history, others, queue = lanes[7:]
        begins, periods, seeds, records = jobs[1], jobs[2], jobs[11], jobs[6]
        width, moving = counters.shape[0], goals.size == waves.size
        source, idle = np.zeros(width, np.int64), begins[-1] + periods[-1]
        start = np.zeros(width, np.int64)
        while True:
            rows, busy, recording = budget, False, False
            for lane in range(width):
                while counters[lane, LEFT] == 0:
                    if not _turn(lane, jobs, table, lanes, results, pool):
                        return FULL
                busy = busy or counters[lane, STAGE] != IDLE
                start[lane] = FOREVER
                if counters[lane, STAGE] == RECORD or (
                    counters[lane, STAGE] == SETTLE and _suffices(lane, jobs, counters)
                ):
                    start[lane] = counters[lane, LEFT] - records[counters[lane, JOB]]
                    recording = True
                rows = min(rows, counters[lane, LEFT])
                source[lane] = idle
                if counters[lane, STAGE] != IDLE:
                    job, phase = counters[lane, JOB], counters[lane, PHASE]
                    source[lane], rows = begins[job] + phase, min(rows, periods[job] - phase)
            if not busy:
                return DONE
            if rows == 0:
                return MORE
            drive, trace = bound(drive_of), bound(trace_of)
            c, k = constants_of, memory_of
            constants = (bound(c[0]), bound(c[1]), bound(c[2]), bound(c[3]), bound(c[4]))
            memory = (
                bound(k[0]), bound(k[1]), bound_state(k[2]), bound(k[3]), bound(k[4]), bound(k[5]), bound(k[6]),
                bound_state(k[7]),
            )  # fmt: skip
            arguments = bound_argument(arguments_of, trace)
            compensation = bound_argument(compensation_of, trace)
            now = queue[NOW]
            done = 0
            while done < rows:
                if sigma > 0.0:
                    for lane in range(width):
                        drawn = counters[lane, ELAPSED] + done
                        put_number(drive_of, 0, lane, sigma * _normal(seeds[counters[lane, JOB]], drawn))
                reference = drive[4]
                if moving:
                    reference = taken_from(goals, source, done, drive)
                amplitude = min(drive[1] + drive[2] * drive[3], 1.0)
                drive[3] = drive[3] + 1.0
                u, y, place, force, compensated, newest = sample(
                    (law, observer_law), arguments, compensation, constants, memory, sizes, step, resolution, now,
                    taken_from(waves, source, done, drive) * amplitude, reference, drive[0],
                )  # fmt: skip
                trace[0], trace[1], trace[2], trace[3], trace[4] = u, y, place, force, compensated
                trace[5] = newest
                for lane in range(width):
                    history[lane, counters[lane, FILLED] + done] = get_number(trace_of, 1, lane)
                if recording:
                    for lane in range(width):
                        at = done - start[lane]
                        if at >= 0:
                            others[lane, 0, at] = get_number(trace_of, 0, lane)
                            others[lane, 1, at] = get_number(trace_of, 2, lane)
                            others[lane, 2, at] = get_number(trace_of, 3, lane)
                            if others.shape[1] > 3:
                                others[lane, 3, at] = get_number(trace_of, 4, lane)
                now = (now + sizes[1]) % 2
                done += 1
                if not _within(newest, limit):
                    break
            queue[NOW] = now
            budget -= done
            for lane in range(width):
                counters[lane, LEFT] -= done
                counters[lane, FILLED] += done
                counters[lane, ELAPSED] += done
                counters[lane, PHASE] = (counters[lane, PHASE] + done) % periods[counters[lane, JOB]]
                if counters[lane, STAGE] == IDLE:
                    counters[lane, FILLED] = 0
                elif not abs(get_number(trace_of, 5, lane)) < limit:
                    counters[lane, STAGE], counters[lane, LEFT] = LEFT_STROKE, 0

    return cached(advance, **FAST)


@njit(**FAST)
def _turn(lane, jobs, table, lanes, results, pool):  # type: ignore[no-untyped-def]
    """Take a lane from one stage to the next; return whether the pool had room."""
    counters, agreement, history = lanes[7], lanes[8], lanes[9]
    status, _place, _lead_in, settling, residual = results
    job, stage = counters[lane, JOB], counters[lane, STAGE]
    ramp, stretch, limit, record = jobs[3], jobs[4], jobs[5], jobs[6]
    if stage in (IDLE, LEFT_STROKE):
        if stage == LEFT_STROKE:
            status[job] = DIVERGED
        _begin_next(lane, jobs, table, lanes)
        return True
    if stage == RECORD:
        if not _deliver(lane, record[job], lanes, results, pool):
            return False
        _begin_next(lane, jobs, table, lanes)
        return True
    if stage == SETTLE:
        enough = counters[lane, ELAPSED] >= ramp[job] + 2 * stretch[job]
        agreed = stretch[job] == 0 or (enough and _agree(lane, job, jobs, counters, agreement, history))
        if agreed or counters[lane, ELAPSED] >= limit[job]:
            status[job] = SETTLED if agreed else NOT_SETTLED
            residual[job] = agreement[lane, DIFFERENCE]
            if _suffices(lane, jobs, counters):
                settling[job] = counters[lane, ELAPSED] - record[job]
                counters[lane, STAGE], counters[lane, LEFT] = RECORD, 0
                return True
            settling[job] = counters[lane, ELAPSED]
            counters[lane, STAGE], counters[lane, LEFT] = RECORD, record[job]
            _make_room(lane, stretch[job], record[job], counters, history)
            return True
    counters[lane, STAGE], counters[lane, LEFT] = SETTLE, stretch[job]
    _make_room(lane, stretch[job], stretch[job], counters, history)
    return True


@njit(**FAST)
def _suffices(lane, jobs, counters):  # type: ignore[no-untyped-def]
    """Return whether the last stretch that was compared is record enough."""
    job = counters[lane, JOB]
    return 0 < jobs[6][job] <= jobs[4][job]


@njit(**FAST)
def _begin_next(lane, jobs, table, lanes):  # type: ignore[no-untyped-def]
    """Put the next job on a lane, at rest; where there is none the lane idles at rest."""
    machines = table[0]
    store, memory, drive, counters, agreement, queue = lanes[3], lanes[4], lanes[5], lanes[7], lanes[8], lanes[11]
    for array in memory:
        for row in range(array.shape[0]):
            put_number(array, row, lane, 0.0)
    for row in range(drive.shape[0]):
        put_number(drive, row, lane, 0.0)
    counters[lane, PHASE], counters[lane, FILLED], counters[lane, ELAPSED], counters[lane, LOST] = 0, 0, 0, 0
    agreement[lane, EXCESS], agreement[lane, DIFFERENCE] = np.inf, np.nan
    job = queue[NEXT]
    machine = 0
    if job < jobs[0].size:
        queue[NEXT] += 1
        machine = jobs[0][job]
        put_number(drive, 1, lane, jobs[7][job])
        put_number(drive, 2, lane, jobs[8][job])
        put_number(drive, 4, lane, table[2][job if table[2].size == jobs[0].size else 0])
        counters[lane, JOB], counters[lane, STAGE], counters[lane, LEFT] = job, RAMP, jobs[3][job]
    else:
        counters[lane, JOB], counters[lane, STAGE], counters[lane, LEFT] = 0, IDLE, FOREVER
    for row in range(machines.shape[1]):
        put_number(store, row, lane, machines[machine, row])


@njit(**FAST)
def _make_room(lane, keep, samples, counters, history):  # type: ignore[no-untyped-def]
    """Forget all positions but the last `keep` where the history has no room for more."""
    filled = counters[lane, FILLED]
    if filled + samples > history.shape[1]:
        for i in range(keep):
            history[lane, i] = history[lane, filled - keep + i]
        counters[lane, FILLED], counters[lane, LOST] = keep, 1


@njit(error_model="numpy", fastmath={"contract", "reassoc"})  # sums in vector registers
def _agree(lane, job, jobs, counters, agreement, history):  # type: ignore[no-untyped-def]
    """Compare the last stretch [m] with the one before.

    Relative to the motion, the difference beyond what scale and noise explain, extrapolated as a geometric series to
    all that is still to come, must be within the tolerance.
    """
    stretch, tolerance, floor = jobs[4][job], jobs[9][job], jobs[10][job]
    begin = counters[lane, FILLED] - stretch
    mean = 0.0
    for i in range(begin, begin + stretch):
        mean += history[lane, i]
    mean /= stretch
    swing, change = 0.0, 0.0
    for i in range(begin, begin + stretch):
        swing += (history[lane, i] - mean) ** 2
        change += (history[lane, i] - history[lane, i - stretch]) ** 2
    swing, change = np.sqrt(swing / stretch), np.sqrt(change / stretch)
    if swing == 0.0:  # a machine at rest
        agreement[lane, DIFFERENCE] = 0.0 if change == 0.0 else np.inf
        return change == 0.0
    agreement[lane, DIFFERENCE] = change / swing
    excess, before = max(change - floor, 0.0) / swing, agreement[lane, EXCESS]
    ratio = min(excess / before, SLOWEST) if before > 0.0 else 0.0
    agreement[lane, EXCESS] = excess
    return excess * max(1.0, ratio / (1.0 - ratio)) <= tolerance


@njit(**FAST)
def _deliver(lane, record, lanes, results, pool):  # type: ignore[no-untyped-def]
    """Copy a finished record to the pool, if it has room."""
    counters, history, others, queue = lanes[7], lanes[9], lanes[10], lanes[11]
    _status, place, lead_in, _settling, _residual = results
    job, filled, used = counters[lane, JOB], counters[lane, FILLED], queue[USED]
    first = filled - record if counters[lane, LOST] else 0
    if used + filled - first + others.shape[1] * record > pool.size:
        return False
    place[job], lead_in[job] = used, filled - first - record
    pool[used : used + filled - first] = history[lane, first:filled]
    used += filled - first
    for channel in range(others.shape[1]):
        pool[used : used + record] = others[lane, channel, :record]
        used += record
    queue[USED] = used
    return True


def _within(value: Any, limit: float) -> bool:
    """Return whether every lane's magnitude is below a limit."""
    raise NotImplementedError


@overload(_within)
def _all_within(value, limit):  # type: ignore[no-untyped-def]
    if isinstance(value, LanesType):
        return lambda value, limit: all_within(value, limit)
    return lambda value, limit: abs(value) < limit


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
