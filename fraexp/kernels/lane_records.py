"""What lanes leave behind: histories and records, filled from the trace of each block and delivered at the end."""

import numpy as np
from numpy.typing import NDArray

from fraexp.kernels.addresses import DOUBLE_BYTES
from fraexp.kernels.batch_arrays import FILL_COUNT, OFFSET, RECORD_START, BatchArrays, LoopLane
from fraexp.kernels.block import TRACE_CHANNELS, TRACE_POSITION, TRACE_SAMPLES
from fraexp.kernels.decorators import COMPILER_OPTIONS, compiled
from fraexp.kernels.memory_moves import TILE, copy_doubles, store_transposed


@compiled(**COMPILER_OPTIONS)
def keep_trace(samples: int, is_recording: bool, batch: BatchArrays) -> None:
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
def make_room(
    k: int, keep: int, samples: int, lane: LoopLane, cursors: NDArray[np.int64], history: NDArray[np.float64]
) -> None:
    """Drop all positions but the last `keep` where the history has no room for the next samples."""
    filled = cursors[FILL_COUNT, k]
    if filled + samples + TILE > history.shape[1]:
        for i in range(keep):
            history[k, i] = history[k, filled - keep + i]
        cursors[FILL_COUNT, k], lane.has_dropped = keep, 1


@compiled(**COMPILER_OPTIONS)
def deliver_record(k: int, batch: BatchArrays, pool: NDArray[np.float64]) -> bool:
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
