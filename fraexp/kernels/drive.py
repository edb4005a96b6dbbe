"""Friction force along prescribed displacements: as many side by side as there are lanes."""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
from numba import from_dtype, njit, types

from fraexp.kernels.addresses import array_at, floats_at, integers_at, number_at, numbers_at, rows_at, run_at
from fraexp.kernels.lanes import WIDTH, taken_at
from fraexp.kernels.law import Law, compilable, explained, fingerprint, kernel_sources
from fraexp.kernels.law_arguments import aligned_zeros, argument_reader, flatten, sizes, structure
from fraexp.kernels.law_error import LawError
from fraexp.kernels.machine_code import address, compile_kernel

MAX_PASSES = 500
"""Times that a periodic record is run through at most."""
CLOSED = 1e-10
"""Change of the force from one pass to the next, relative to the greatest force, that counts as periodic."""
FOREVER = 1 << 62
LEAD, PASS, IDLE = range(3)
"""Stage of a lane."""
REACHED, STEP, FORCE = range(3)
"""Rows of a motion: displacement [m], time step [s], friction force [N]."""
MOTION_ROWS = 3
RECORD = np.dtype(
    [(name, np.int64) for name in ("begin", "lead_in", "size", "passes")]
    + [(name, np.float64) for name in ("lead_in_step", "step")]
)
"""A displacement: first sample of its lead-in from rest, samples of that and of the record, times that the record is
run through at most (once, or until its force repeats itself), time steps of both [s]."""
LANE = np.dtype([(name, np.int64) for name in ("record", "stage", "at", "left", "done")])
"""What a lane is at: its record, the stage of it, the next sample, samples left of the stage, passes done."""
FRAME = np.dtype(
    [(name, np.int64) for name in (
        # states of the law, samples wanted, the valid half of the law's memory
        "states", "samples", "now",
        # addresses; the places are those where each lane reads and writes
        "arguments", "argument_sizes", "memory", "motion", "displacement", "force", "places",
    )]
)  # fmt: skip
"""What a block of samples needs to know."""


def drive(law: Law, arguments: Any, states: int, motions: Sequence[Any], wide: bool) -> list[np.ndarray]:
    """Return the force [N] along each motion (displacement, time step, periodic, lead-in, its time step).

    It starts from the state at rest, or from where the lead-in left it; a periodic one is run through again until its
    force repeats itself, from its end to its beginning the displacement moves by their difference.
    """
    width = WIDTH if wide else 1
    displacement, records = _records(motions)
    force = np.empty_like(displacement)
    lanes, places = np.zeros(width, LANE), np.zeros(width, np.int64)
    lanes["stage"] = IDLE
    memory, motion = aligned_zeros(2 * states, width), aligned_zeros(MOTION_ROWS, width)
    numbers = flatten(arguments)
    store, counts = aligned_zeros(numbers.size, width), np.array(sizes(arguments), dtype=np.int64)
    store[:] = numbers[:, None]
    pointed = {
        "memory": memory, "motion": motion, "displacement": displacement, "force": force, "places": places,
        "arguments": store, "argument_sizes": counts,
    }  # fmt: skip
    frame = np.zeros(1, FRAME)
    frame["states"] = states
    for name, array in pointed.items():
        frame[name] = array.ctypes.data
    block = address(block_of(law, structure(arguments), wide))
    _drive()(block, frame, displacement, records, lanes, places, memory, motion, force)
    first = records["begin"] + records["lead_in"]
    return [force[begin : begin + size] for begin, size in zip(first, records["size"], strict=True)]


def vectorises(law: Law, arguments: tuple[Any, ...]) -> bool:
    """Return whether a law can be computed in lanes: not if it branches on a value, or uses what lanes lack."""
    try:
        block_of(law, structure(arguments), True)
    except LawError:
        return False
    return True


@cache
def block_of(law: Law, kinds: Any, wide: bool) -> Any:
    """Return the compiled block of samples of a law, in lanes or not."""
    made, name = compilable(law), f"{law.__qualname__} driven {'in lanes' if wide else 'alone'} {kinds}"
    with explained(law):
        return compile_kernel(
            name,
            kernel_sources() + fingerprint(law),
            lambda: _make_block(made, kinds, wide),
            _BLOCK,
            error_model="numpy",
        )


def _records(motions: Sequence[Any]) -> tuple[np.ndarray, np.ndarray]:
    """Return all samples, with a place for lanes that have nothing to do, and the records."""
    parts, used = [], 0
    records = np.zeros(len(motions), RECORD)
    for number, (displacement, step, periodic, lead_in, lead_in_step) in enumerate(motions):
        parts += [lead_in, displacement, displacement[:1]]
        passes = MAX_PASSES if periodic else 1
        records[number] = (used, lead_in.size, displacement.size, passes, lead_in_step, step)
        used += lead_in.size + displacement.size + 1
    parts.append(np.zeros(max(part.size for part in parts) + 1))
    return np.concatenate(parts, dtype=float), records


def _make_block(law: Law, kinds: Any, wide: bool) -> Callable[..., None]:
    width = WIDTH if wide else 1
    view, state_view = (rows_at, rows_at) if wide else (numbers_at, array_at)
    read = argument_reader(kinds, wide)
    take = taken_at if wide else number_at

    def block(frames):  # type: ignore[no-untyped-def]
        frame = frames[0]
        motion, forces = view(frame.motion, 0), floats_at(frame.motion)
        force, places = floats_at(frame.force), integers_at(frame.places)
        arguments = read(frame.arguments, frame.argument_sizes)
        z, states, now = frame.memory, frame.states, frame.now
        half = 8 * width * states
        for row in range(frame.samples):
            reached = take(frame.displacement, frame.places, row)
            z_now, z_next = state_view(z + now * half, states), state_view(z + (1 - now) * half, states)
            motion[FORCE] = law(z_now, reached - motion[REACHED], motion[STEP], z_next, *arguments)
            motion[REACHED] = reached
            now = 1 - now
            for lane in range(width):
                force[places[lane] + row] = forces[FORCE * width + lane]
        frame.now = now

    return block


@cache
def _drive() -> Any:
    return compile_kernel("driven records", kernel_sources(), lambda: _go_on, _SIGNATURE, error_model="numpy")


def _go_on(block, frames, displacement, records, lanes, places, memory, motion, force):  # type: ignore[no-untyped-def]
    frame, width, following = frames[0], lanes.size, 0
    while True:
        samples, busy = FOREVER, False
        for k in range(width):
            lane = lanes[k]
            while lane.left == 0:
                following = _turn(k, following, records, lane, displacement, memory, motion, force)
            samples = min(samples, lane.left)
            places[k] = lane.at
            busy = busy or lane.stage != IDLE
        if not busy:
            return
        frame.samples = samples
        run_at(block, frames)
        for k in range(width):
            lane = lanes[k]
            lane.left -= samples
            lane.at += samples if lane.stage != IDLE else 0


@njit
def _turn(k, following, records, lane, displacement, memory, motion, force):  # type: ignore[no-untyped-def]
    """Take a lane from its lead-in to its record, to another pass of it, or to the next one; return the one after."""
    record = records[lane.record]
    first = record.begin + record.lead_in
    if lane.stage == LEAD:
        if record.lead_in == 0:
            motion[REACHED, k] = displacement[first]
        motion[STEP, k] = record.step
        lane.stage, lane.at, lane.left = PASS, first, record.size
        if record.passes > 1:
            lane.left += 1
        return following
    if lane.stage == PASS:
        lane.done += 1
        begun = lane.done > 1 or record.lead_in > 0  # before, the force came from rest
        if lane.done < record.passes and not (begun and _closed(force, first, record.size)):
            force[first] = force[first + record.size]
            lane.at, lane.left = first + 1, record.size
            return following
    for row in range(memory.shape[0]):
        memory[row, k] = 0.0
    if following == records.size:
        last = records[-1]
        lane.stage, lane.left, lane.at = IDLE, FOREVER, last.begin + last.lead_in + last.size + 1
        return following
    record = records[following]
    lane.record, lane.stage, lane.done = following, LEAD, 0
    lane.at, lane.left = record.begin, record.lead_in
    motion[REACHED, k], motion[STEP, k] = displacement[record.begin], record.lead_in_step
    return following + 1


@njit
def _closed(force, first, size):  # type: ignore[no-untyped-def]
    """Return whether the force at the end of a pass is that at its beginning."""
    greatest = 0.0
    for k in range(first, first + size):
        greatest = max(greatest, abs(force[k]))
    return abs(force[first + size] - force[first]) <= CLOSED * greatest


def _array(kind: types.Type, dimensions: int = 1) -> types.Type:
    return types.Array(kind, dimensions, "C")


_BLOCK = (_array(from_dtype(FRAME)),)
_SIGNATURE = (
    types.int64, *_BLOCK, _array(types.float64), _array(from_dtype(RECORD)), _array(from_dtype(LANE)),
    _array(types.int64), _array(types.float64, 2), _array(types.float64, 2), _array(types.float64),
)  # fmt: skip
"""Of `_go_on`: the block's address, and the rest."""
