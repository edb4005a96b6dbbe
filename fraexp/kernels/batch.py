"""Periodic experiments on the loop, each from rest to its periodic motion: as many side by side as there are lanes.

A lane whose experiment ends takes the next one. Lanes do not affect each other, so that an experiment has the same
result whatever runs beside it. All of this is the same for every friction law: what differs, the samples themselves, is
a block (see `fraexp.kernels.block`) that is called by its address. `docs/kernels.md` draws how they work together.
"""

from functools import cache
from typing import Any

import numpy as np
from numba import types
from numba.core.dispatcher import Dispatcher
from numpy.typing import NDArray

from fraexp.kernels.addresses import DOUBLE_BYTES, call_block
from fraexp.kernels.batch_arrays import (
    BEYOND_LIMIT,
    DIVERGED,
    FILL_COUNT,
    IDLE,
    JOB_DTYPE,
    LANE_DTYPE,
    NOT_FINITE,
    NOT_SETTLED,
    OFFSET,
    QUEUE_DTYPE,
    RAMP,
    READ_INDEX,
    RECORD,
    RECORD_START,
    RESULT_DTYPE,
    SETTLE,
    SETTLED,
    BatchArrays,
    KernelBatch,
    LoopJob,
    LoopLane,
)
from fraexp.kernels.block import (
    DRIVE_AMPLITUDE,
    DRIVE_REFERENCE,
    DRIVE_RISE,
    SIGNATURE,
    TRACE_CHANNELS,
    TRACE_NEXT_POSITION,
    TRACE_POSITION,
    TRACE_SAMPLES,
    make_block,
)
from fraexp.kernels.call_watch import watched_call
from fraexp.kernels.decorators import COMPILER_OPTIONS, compiled
from fraexp.kernels.guards import state_count, written_index
from fraexp.kernels.lane_layout import LaneLayout
from fraexp.kernels.law import explain_compiler_errors, fingerprint, kernel_source_hash, register_law
from fraexp.kernels.law_error import LawCallError
from fraexp.kernels.loop_laws import Laws, last_call
from fraexp.kernels.machine_code import compile_kernel, function_address
from fraexp.kernels.memory_moves import TILE, copy_doubles, store_transposed
from fraexp.kernels.periodic_state import KEPT_WINDOWS, keep_state
from fraexp.kernels.settling import end_window
from fraexp.kernels.structs import float_array_type, struct_array_type

ALL_DONE, BUDGET_SPENT, POOL_FULL = range(3)
"""What `advance` returns: all experiments have ended, its samples are used up, the pool has no room for a result."""
FOREVER = 1 << 62
"""Samples that never pass."""


def advance(laws: Laws, batch: KernelBatch, pool: NDArray[np.float64], budget: int) -> int:
    """Run the experiments on, for up to `budget` samples; return ALL_DONE, BUDGET_SPENT or POOL_FULL."""
    block = function_address(compiled_block(laws, batch.layout))
    run = _compiled_advance()
    try:
        with watched_call(laws.law, lambda: last_call(laws, batch)[1]):
            status = int(run(block, batch.arrays, pool, budget))
    except Exception as error:  # an index that is out of bounds, or whatever a law raises
        raise LawCallError(f"{type(error).__name__}: {error}", *last_call(laws, batch)) from error
    for law, memory in zip(laws.given, batch.law_memories, strict=True):
        index, states = written_index(memory), state_count(memory)
        if index is not None:
            raise LawCallError(f"wrote z_next[{index}] of {states}", law)
    return status


@cache
def compiled_block(laws: Laws, layout: LaneLayout) -> Dispatcher:
    """Return the compiled block of samples of these laws, in lanes or of one machine."""
    given, is_observed = laws.given, laws.is_observed(layout.is_vectorised)
    source = "".join([kernel_source_hash(), *map(fingerprint, given)])
    law = register_law(laws.law)
    compensation_law = register_law(laws.compensation_law) if laws.compensation_law else None

    def make() -> Any:
        return make_block(
            law, compensation_law, laws.kinds, laws.compensation_kinds, layout, laws.is_set_valued, is_observed
        )

    names = " and ".join(each.__qualname__ for each in given)
    kinds = (laws.kinds, laws.compensation_kinds)
    name = f"{names} {layout} {kinds}"
    name += " observed" if is_observed else ""
    name += f" at contacts {laws.is_set_valued}"
    with explain_compiler_errors(*given):
        return compile_kernel(name, source, make, SIGNATURE, **COMPILER_OPTIONS)


@cache
def _compiled_advance() -> Dispatcher:
    return compile_kernel("experiments", kernel_source_hash(), lambda: _advance, _SIGNATURE, **COMPILER_OPTIONS)


def _advance(block: int, batch: BatchArrays, pool: NDArray[np.float64], budget: int) -> int:
    """Run blocks of samples, each as long as no lane needs a decision."""
    jobs, results, lanes, cursors, trace = batch.jobs, batch.results, batch.lanes, batch.cursors, batch.trace
    frame, width, silence = batch.frame[0], lanes.size, jobs[-1].first_sample + jobs[-1].period
    noise, noise_std, positions = batch.noise, batch.noise_std, frame.positions
    frame.has_moving_reference, frame.has_noise = batch.references.size > 0, noise_std > 0.0
    while True:
        samples, is_busy, is_recording = min(budget, TRACE_SAMPLES), False, False
        for k in range(width):
            lane = lanes[k]
            while lane.remaining == 0:
                if not _enter_next_stage(k, batch, pool):
                    return POOL_FULL
            # An idle lane takes part in every operation of a vector: it reads zeros, and never starts a record.
            cursors[READ_INDEX, k], cursors[RECORD_START, k] = silence, FOREVER
            samples = min(samples, lane.remaining)
            if lane.stage == IDLE:
                continue
            is_busy, job = True, jobs[lane.job]
            if lane.stage == RECORD or (lane.stage == SETTLE and _is_record_within_window(job)):
                cursors[RECORD_START, k] = lane.remaining - job.record
                is_recording = True
            # A block ends with the period, so that it reads the waveform straight on.
            cursors[READ_INDEX, k] = job.first_sample + lane.phase
            samples = min(samples, job.period - lane.phase)
        if not is_busy:
            return ALL_DONE
        if samples == 0:
            return BUDGET_SPENT
        if noise_std > 0.0:
            for k in range(width):
                first = lanes[k].elapsed * positions
                for i in range(samples * positions):
                    noise[i, k] = noise_std * _normal_number(jobs[lanes[k].job].seed, first + i)
        frame.samples, frame.is_recording = samples, is_recording
        call_block(block, batch.frame)
        done = frame.samples_done  # fewer than asked for where a lane diverged
        budget -= done
        _keep_trace(done, is_recording, batch)
        for k in range(width):
            lane = lanes[k]
            lane.remaining -= done
            lane.elapsed += done
            lane.phase = (lane.phase + done) % jobs[lane.job].period
            cursors[FILL_COUNT, k] = cursors[FILL_COUNT, k] + done if lane.stage != IDLE else 0
            if lane.stage != IDLE and not abs(trace[TRACE_NEXT_POSITION, k]) < frame.divergence_limit:  # NaN as well
                lane.stage, lane.remaining = BEYOND_LIMIT, 0
                results[lane.job].status = DIVERGED if abs(trace[TRACE_NEXT_POSITION, k]) < np.inf else NOT_FINITE


@compiled(**COMPILER_OPTIONS)
def _enter_next_stage(k: int, batch: BatchArrays, pool: NDArray[np.float64]) -> bool:
    """Take lane k from one stage to the next; return whether the pool had room."""
    lane, cursors, history, numbers = batch.lanes[k], batch.cursors, batch.history, batch.lane_numbers[:, k]
    job, result = batch.jobs[lane.job], batch.results[lane.job]
    if lane.stage in (IDLE, BEYOND_LIMIT):
        _begin_next_job(k, batch)
        return True
    if lane.stage == RECORD:
        if not _deliver_record(k, batch, pool):
            return False
        _begin_next_job(k, batch)
        return True
    if lane.stage == SETTLE:
        is_settled = job.window == 0 or end_window(k, batch, job, lane)
        if is_settled or lane.elapsed >= job.settling_limit:
            result.status = SETTLED if is_settled else NOT_SETTLED
            result.residual, result.windows = lane.difference, lane.windows
            result.settling = max(lane.elapsed, lane.expected)
            if _is_record_within_window(job):  # the last window that was compared is the record: nothing runs again
                result.settling -= job.record
                lane.stage, lane.remaining = RECORD, 0
                return True
            lane.stage, lane.remaining = RECORD, job.record
            _make_room(k, job.window, job.record, lane, cursors, history)
            return True
    keep_state(numbers, batch.linear_rows, batch.window_states[k, 0], lane.pairs)
    lane.stage, lane.remaining = SETTLE, job.window
    _make_room(k, KEPT_WINDOWS * job.window, job.window, lane, cursors, history)
    return True


@compiled(**COMPILER_OPTIONS)
def _is_record_within_window(job: LoopJob) -> bool:
    """Return whether a window is long enough to be the record as well."""
    return 0 < job.record <= job.window


@compiled(**COMPILER_OPTIONS)
def _begin_next_job(k: int, batch: BatchArrays) -> None:
    """Put the next experiment on lane k, at rest; without one the lane idles, at rest."""
    jobs, machines, lane_numbers, drive = batch.jobs, batch.machines, batch.lane_numbers, batch.drive
    lane, queue, cursors = batch.lanes[k], batch.queue[0], batch.cursors
    for row in batch.rest_rows:
        lane_numbers[row, k] = 0.0
    for row in range(drive.shape[0]):
        drive[row, k] = 0.0
    lane.phase, lane.elapsed, lane.has_dropped, cursors[FILL_COUNT, k] = 0, 0, 0, 0
    lane.excess, lane.early_excess, lane.difference = np.inf, np.inf, np.nan
    lane.windows, lane.unbroken, lane.pairs, lane.jumps, lane.expected = 0, 0, 0, 0, 0
    machine = 0
    if queue.next_job < jobs.size:
        lane.job = queue.next_job
        queue.next_job += 1
        job = jobs[lane.job]
        machine = job.machine
        drive[DRIVE_AMPLITUDE, k], drive[DRIVE_RISE, k] = job.start_amplitude, job.amplitude_rise
        drive[DRIVE_REFERENCE, k] = job.reference
        lane.stage, lane.remaining = RAMP, job.ramp
    else:
        lane.job, lane.stage, lane.remaining = 0, IDLE, FOREVER
    for row in range(machines.shape[1]):
        lane_numbers[row, k] = machines[machine, row]


@compiled(**COMPILER_OPTIONS)
def _normal_number(seed: np.uint64, count: int) -> float:
    """Return the normally distributed number `count` of a seed's sequence.

    Numbers are counted, not drawn in turn: any of them can be had at once, so that the noise of a lane does not depend
    on its neighbours. SplitMix64 (G. L. Steele, D. Lea and C. H. Flood, OOPSLA 2014, doi:10.1145/2660193.2660195) and
    the transform of Box and Muller.
    """
    first = _uniform_number(seed + np.uint64(2 * count + 1) * np.uint64(0x9E3779B97F4A7C15))
    second = _uniform_number(seed + np.uint64(2 * count + 2) * np.uint64(0x9E3779B97F4A7C15))
    return np.sqrt(-2.0 * np.log(first)) * np.cos(2.0 * np.pi * second)


@compiled(**COMPILER_OPTIONS)
def _uniform_number(state: np.uint64) -> float:
    """Return a number in (0, 1] from a state of 64 bits."""
    state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    state = state ^ (state >> np.uint64(31))
    return (np.float64(state >> np.uint64(11)) + 1.0) * (1.0 / 9007199254740992.0)


_BATCH_TYPE = types.NamedTuple((
    struct_array_type(JOB_DTYPE), struct_array_type(RESULT_DTYPE), float_array_type(2), float_array_type(1),
    float_array_type(1), types.float64, float_array_type(2), float_array_type(2), float_array_type(2),
    float_array_type(2), struct_array_type(LANE_DTYPE), types.Array(types.int64, 2, "C"), float_array_type(2),
    float_array_type(3), struct_array_type(QUEUE_DTYPE), types.Array(types.int64, 1, "C"),
    types.Array(types.int64, 1, "C"), float_array_type(4), types.Array(types.int64, 2, "C"), float_array_type(2),
    *SIGNATURE,
), BatchArrays)  # fmt: skip
_SIGNATURE = (types.int64, _BATCH_TYPE, float_array_type(1), types.int64)
"""Types of `_advance`'s arguments: the block's address, the arrays, the pool, and the samples."""


@compiled(**COMPILER_OPTIONS)
def _keep_trace(samples: int, is_recording: bool, batch: BatchArrays) -> None:
    """Add the samples of a block to the histories of all lanes and, from where a record starts, to the record."""
    trace, cursors, history, recorded = batch.trace, batch.cursors, batch.history, batch.recorded
    for k in range(trace.shape[1]):
        cursors[OFFSET, k] = k * history.shape[1] + cursors[FILL_COUNT, k]
    _keep_part(trace, TRACE_POSITION, samples, history.ctypes.data, cursors[OFFSET])
    if not is_recording:
        return
    channels, row = recorded.shape[1], recorded.shape[2]
    for channel in range(channels):
        for k in range(trace.shape[1]):  # what comes before a record goes to the room before it
            cursors[OFFSET, k] = (
                (k * channels + channel) * row + TRACE_SAMPLES - min(cursors[RECORD_START, k], TRACE_SAMPLES)
            )
        _keep_part(trace, TRACE_CHANNELS + channel, samples, recorded.ctypes.data, cursors[OFFSET])


@compiled(**COMPILER_OPTIONS)
def _keep_part(trace: NDArray[np.float64], part: int, samples: int, target: int, offsets: NDArray[np.int64]) -> None:
    """Write a part of the trace to an address, each lane at its own offset; up to TILE - 1 numbers too many."""
    width = trace.shape[1]
    first = trace.ctypes.data + part * TRACE_SAMPLES * width * DOUBLE_BYTES
    if width == 1:
        copy_doubles(target + offsets[0] * DOUBLE_BYTES, first, samples)
        return
    for lane in range(0, width, TILE):
        for i in range(0, samples, TILE):
            rows = first + (i * width + lane) * DOUBLE_BYTES
            store_transposed(
                rows, width * DOUBLE_BYTES, target + i * DOUBLE_BYTES, offsets.ctypes.data + lane * DOUBLE_BYTES
            )


@compiled(**COMPILER_OPTIONS)
def _make_room(
    k: int, keep: int, samples: int, lane: LoopLane, cursors: NDArray[np.int64], history: NDArray[np.float64]
) -> None:
    """Drop all positions but the last `keep` where the history has no room for the next samples."""
    filled = cursors[FILL_COUNT, k]
    if filled + samples + TILE > history.shape[1]:
        for i in range(keep):
            history[k, i] = history[k, filled - keep + i]
        cursors[FILL_COUNT, k], lane.has_dropped = keep, 1


@compiled(**COMPILER_OPTIONS)
def _deliver_record(k: int, batch: BatchArrays, pool: NDArray[np.float64]) -> bool:
    """Copy the finished record of lane k to the pool; return whether the pool has room for it."""
    lane, queue, history, recorded = batch.lanes[k], batch.queue[0], batch.history, batch.recorded
    record, result = batch.jobs[lane.job].record, batch.results[lane.job]
    filled, used = batch.cursors[FILL_COUNT, k], queue.pool_used
    first = filled - record if lane.has_dropped else 0
    if used + filled - first + recorded.shape[1] * record > pool.size:
        return False
    result.pool_index, result.lead_in = used, filled - first - record
    copy_doubles(pool[used:].ctypes.data, history[k, first:].ctypes.data, filled - first)
    used += filled - first
    for channel in range(recorded.shape[1]):
        copy_doubles(pool[used:].ctypes.data, recorded[k, channel, TRACE_SAMPLES:].ctypes.data, record)
        used += record
    queue.pool_used = used
    return True
