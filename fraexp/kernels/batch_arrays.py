"""The arrays of a batch of experiments: what compiled code is given, what it keeps for each lane, and its results."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.kernels.lane_layout import LaneLayout
from fraexp.kernels.structs import struct_dtype

WAITING, SETTLED, NOT_SETTLED, DIVERGED, NOT_FINITE = range(5)
"""Status of an experiment; NOT_FINITE if the position is no number, as after a force that is none."""
IDLE, RAMP, SETTLE, RECORD, BEYOND_LIMIT = range(5)
"""Stage of a lane."""
READ_INDEX, RECORD_START, FILL_COUNT, OFFSET = range(4)
"""Rows of `cursors`: where each lane reads its excitation and starts its record, how full its history is, and where its
next numbers go."""
CURSOR_ROWS = 4


class LoopJob:
    """An experiment, counted in samples."""

    machine: int
    """Row of `machines`."""
    first_sample: int
    """First sample of its period in `waveforms` and `references`."""
    period: int
    """Samples of its period."""
    cycles: int
    """Cycles of its sine in a period; 0 for several lines."""
    ramp: int
    """Samples before windows are compared."""
    window: int
    """Samples of a window, which is compared with the one before; 0 to record from the start."""
    settling_limit: int
    """Samples after which settling is given up."""
    record: int
    """Samples that are recorded."""
    start_amplitude: float
    """Amplitude at the start, relative."""
    amplitude_rise: float
    """Rise of the relative amplitude per sample, up to 1."""
    tolerance: float
    """Relative difference of two windows that counts as settled."""
    noise_floor: float
    """Difference of two windows that encoder and noise explain [m]."""
    reference: float
    """Position reference at rest [m]."""
    seed: np.uint64
    """Seed of the encoder's noise."""


class LoopResult:
    """What is known of an experiment."""

    status: int
    """WAITING, SETTLED, NOT_SETTLED, DIVERGED or NOT_FINITE."""
    pool_index: int
    """Where its numbers begin in the pool: the positions from rest, then the record's other channels; -1 before."""
    lead_in: int
    """How many of the positions come before the record."""
    settling: int
    """Samples before the record."""
    windows: int
    """Windows that were simulated before the record, or of which the last is the record."""
    residual: float
    """Relative difference of the last two windows."""


class LoopLane:
    """What a lane is at."""

    job: int
    """Index of its experiment."""
    stage: int
    """IDLE, RAMP, SETTLE, RECORD or BEYOND_LIMIT."""
    remaining: int
    """Samples left of the stage."""
    phase: int
    """Sample of the period that comes next."""
    elapsed: int
    """Samples since rest."""
    has_dropped: int
    """Whether positions from rest were dropped for want of room."""
    excess: float
    """Relative difference of the last two windows beyond what encoder and noise explain."""
    difference: float
    """Relative difference of the last two windows."""
    motion: float
    """Root mean square of the last window's motion [m]."""
    windows: int
    """Windows that have passed."""
    unbroken: int
    """Windows since the state last jumped to where earlier windows led, or since rest."""
    pairs: int
    """Windows whose start and end are known and which did not begin with a jump."""
    jumps: int
    """How often the state has jumped."""
    early_excess: float
    """`excess` after EARLY_WINDOW windows."""
    first_jump: int
    """Samples before the first jump."""
    expected: int
    """Samples after which the lane would have settled without jumps; 0 before the first, -1 if there are no more."""


class LoopQueue:
    """What all lanes share."""

    next_job: int
    """Index of the experiment that is begun next."""
    pool_used: int
    """Numbers of the pool that are used."""


JOB_DTYPE, RESULT_DTYPE = struct_dtype(LoopJob), struct_dtype(LoopResult)
LANE_DTYPE, QUEUE_DTYPE = struct_dtype(LoopLane), struct_dtype(LoopQueue)


class BatchArrays(NamedTuple):
    """Experiments on their way; arrays that compiled code changes in place. Jobs are begun in their order."""

    jobs: NDArray[np.void]
    """Shape (jobs,) of `LoopJob`."""
    results: NDArray[np.void]
    """Shape (jobs,) of `LoopResult`."""
    machines: NDArray[np.float64]
    """Constants of the loop and arguments of the laws, one machine a row, shape (machines, numbers)."""
    waveforms: NDArray[np.float64]
    """All periods of the excitation [N], one after another, and as many zeros as the longest has samples."""
    references: NDArray[np.float64]
    """The position reference [m] along with them; empty where none moves."""
    noise_std: float
    """Standard deviation of the encoder's noise [m]."""
    lane_numbers: NDArray[np.float64]
    """Constants and arguments of each lane's machine, then the loop's memory, shape (rows, lanes)."""
    drive: NDArray[np.float64]
    """What drives the loop, shape (DRIVE_ROWS, lanes)."""
    trace: NDArray[np.float64]
    """What is known of a block's samples, shape (rows, lanes)."""
    noise: NDArray[np.float64]
    """Noise of the next samples [m], shape (TRACE_SAMPLES, lanes)."""
    lanes: NDArray[np.void]
    """Shape (lanes,) of `LoopLane`."""
    cursors: NDArray[np.int64]
    """Indices of each lane, shape (CURSOR_ROWS, lanes)."""
    history: NDArray[np.float64]
    """Measured positions from rest [m], then room for a tile, shape (lanes, n)."""
    recorded: NDArray[np.float64]
    """Control input, displacement, friction force and its compensation, if any, of the record, between
    room for TRACE_SAMPLES before it and for a tile after it, shape (lanes, 3 or more, n)."""
    queue: NDArray[np.void]
    """Shape (1,) of `LoopQueue`."""
    rest_rows: NDArray[np.int64]
    """Rows of `lane_numbers` that are 0 at rest: the loop's memory without the guards of the laws."""
    linear_rows: NDArray[np.int64]
    """Rows of `lane_numbers` that are the state of the linear part, from one sample to the next."""
    window_states: NDArray[np.float64]
    """This state at start and end of the last windows, shape (lanes, 2, DEPTH, linear rows)."""
    window_numbers: NDArray[np.int64]
    """How many windows had passed at their end, shape (lanes, DEPTH)."""
    saved_memory: NDArray[np.float64]
    """The loop's memory before a lane's first jump, shape (lanes, rest rows)."""
    frame: NDArray[np.void]
    """What a block of samples needs, shape (1,) of `LoopFrame`."""


class KernelBatch(NamedTuple):
    """A batch of experiments: what compiled code takes, and what keeps alive and describes the memory behind it."""

    arrays: BatchArrays
    argument_sizes: NDArray[np.int64]
    """Sizes of the law's arguments, then of the compensation's; they are kept here, as the frame has addresses only."""
    last_call: NDArray[np.float64]
    """The last call of a law that is observed, shape (CALL_NUMBERS,)."""
    law_memories: tuple[NDArray[np.float64], ...]
    """Memory of the friction law, and of the compensation's, if any, with its guards: views of `lane_numbers`."""
    layout: LaneLayout
    """How lanes lie in memory."""
