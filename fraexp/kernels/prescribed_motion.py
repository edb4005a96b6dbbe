"""Friction force along prescribed displacements: as many side by side as there are lanes."""

from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple, Protocol

import numpy as np
from numba import types
from numba.core.dispatcher import Dispatcher
from numpy.typing import NDArray

from fraexp.kernels.addresses import DOUBLE_BYTES, call_block, float_pointer, integer_pointer
from fraexp.kernels.call_watch import FIRST_BUILT_IN_STEPS, FIRST_CALL_WORK, CallBudget, watched_call
from fraexp.kernels.decorators import compiled
from fraexp.kernels.guards import GUARD_ROWS, guarded_rows, memory_rows, set_guards, state_half, written_index
from fraexp.kernels.lane_layout import MOTION_LANES, ONE_MACHINE, LaneLayout
from fraexp.kernels.law import (
    Law,
    explain_compiler_errors,
    fingerprint,
    is_all_built_in,
    kernel_source_hash,
    register_law,
)
from fraexp.kernels.law_arguments import (
    ArgumentKinds,
    LawArgument,
    aligned_zeros,
    argument_kinds,
    argument_reader,
    argument_sizes,
    flatten_arguments,
)
from fraexp.kernels.law_error import LawCall, LawCallError, LawError
from fraexp.kernels.machine_code import compile_kernel, function_address
from fraexp.kernels.observed_law import CALL_HALF, CALL_NUMBERS, FRICTION, make_observed, with_record, without_record
from fraexp.kernels.structs import StructArray, float_array_type, struct_array_type, struct_dtype

MAX_PASSES = 500
"""Maximum number of passes through a periodic displacement."""
CLOSURE_TOLERANCE = 1e-10
"""Change of the force from one pass to the next, relative to the greatest force, that counts as periodic."""
MAX_CALL_SAMPLES = 1_000_000
"""Samples after which compiled code returns, so that whoever watches it knows that it is alive."""
FOREVER = 1 << 62
"""Samples that never pass."""
LEAD_IN, PASS, IDLE = range(3)
"""Stage of a lane."""
DISPLACEMENT, TIME_STEP, FORCE = range(3)
"""Rows of a lane's motion: displacement [m], time step [s], friction force [N]."""
MOTION_ROWS = 3


class PrescribedMotion(Protocol):
    """A displacement along which a law is driven, as components know it."""

    @property
    def displacement(self) -> NDArray[np.float64]:
        """Displacement [m], shape (n,)."""

    @property
    def time_step(self) -> float:
        """Its time step [s]."""

    @property
    def periodic(self) -> bool:
        """Whether the periodic force is wanted."""

    @property
    def lead_in(self) -> NDArray[np.float64]:
        """Displacement before, from rest [m]."""

    @property
    def lead_in_step(self) -> float:
        """Its time step [s]."""


class DrivenMotion:
    """A motion, counted in samples."""

    first_sample: int
    """First sample of its lead-in in the displacement."""
    lead_in: int
    """Samples of the lead-in from rest."""
    size: int
    """Samples of the motion itself."""
    max_passes: int
    """Passes through the motion: one, or as many as it takes until the force is periodic, up to this number."""
    lead_in_step: float
    """Time step of the lead-in [s]."""
    time_step: float
    """Time step of the motion [s]."""


class DrivenLane:
    """What a lane is at."""

    motion: int
    """Index of its motion."""
    stage: int
    """LEAD_IN, PASS or IDLE."""
    sample: int
    """Sample that comes next."""
    remaining: int
    """Samples left of the stage."""
    passes: int
    """Passes that are done."""


class DrivenFrame:
    """What a block of samples needs: sizes and addresses."""

    states: int
    """Number of states of the law."""
    samples: int
    """Samples to run."""
    current_memory: int
    """Which of the two halves of the law's memory holds its present state: 0 or 1."""
    next_motion: int
    """Index of the motion that is begun next."""
    arguments: int
    """Address: numbers of the law's arguments."""
    argument_sizes: int
    """Address: size of each argument."""
    memory: int
    """Address: state of the law, twice, with a guard between: the present one and the next one."""
    motion: int
    """Address: what is known of a sample, MOTION_ROWS."""
    displacement: int
    """Address: displacement of all motions [m]."""
    force: int
    """Address: force along all motions [N]."""
    cursors: int
    """Address: for each lane, the sample at which it reads its displacement and writes its force."""
    last_call: int
    """Address: the last call of a law that is observed, CALL_NUMBERS."""


MOTION_DTYPE, LANE_DTYPE, FRAME_DTYPE = struct_dtype(DrivenMotion), struct_dtype(DrivenLane), struct_dtype(DrivenFrame)


class _DrivenArrays(NamedTuple):
    """What compiled code drives along motions."""

    displacement: NDArray[np.float64]
    """Lead-in and displacement of each motion [m], one after another, then zeros for lanes without one."""
    motions: StructArray[DrivenMotion]
    """Shape (motions,)."""
    lanes: StructArray[DrivenLane]
    cursors: NDArray[np.int64]
    """For each lane, the sample at which it reads its displacement and writes its force."""
    memory: NDArray[np.float64]
    """Rows of the law's state, twice, with guards around."""
    motion: NDArray[np.float64]
    """MOTION_ROWS of each lane."""
    force: NDArray[np.float64]
    """Force along all motions [N]."""
    rest_rows: NDArray[np.int64]
    """Rows of `memory` that are 0 at rest."""


def friction_forces(
    law: Law, arguments: tuple[LawArgument, ...], states: int, motions: Sequence[PrescribedMotion], is_vectorised: bool
) -> list[NDArray[np.float64]]:
    """Return the force [N] along each motion, each of its displacement's shape.

    It starts from the state at rest, or from where the lead-in left it. A periodic motion is passed through again until
    its force is periodic; from its end to its beginning the displacement moves by their difference.
    """
    layout = MOTION_LANES if is_vectorised else ONE_MACHINE
    width = layout.width
    displacement, driven = _concatenate_motions(motions)
    force = np.empty_like(displacement)
    lanes, cursors = np.zeros(width, LANE_DTYPE), np.zeros(width, np.int64)
    lanes["stage"] = IDLE
    memory, motion = aligned_zeros(memory_rows(states), width), aligned_zeros(MOTION_ROWS, width)
    set_guards(memory)
    numbers, last_call = flatten_arguments(arguments), np.zeros(CALL_NUMBERS)
    sizes = np.array(argument_sizes(arguments), dtype=np.int64)
    addressed: dict[str, NDArray[np.float64] | NDArray[np.int64]] = {
        "memory": memory[GUARD_ROWS:], "motion": motion, "displacement": displacement, "force": force,
        "cursors": cursors, "arguments": numbers, "argument_sizes": sizes, "last_call": last_call,
    }  # fmt: skip
    frame = np.zeros(1, FRAME_DTYPE)
    frame["states"] = states
    for name, array in addressed.items():
        frame[name] = array.ctypes.data
    block = function_address(compiled_block(law, argument_kinds(arguments), layout))
    arrays = _DrivenArrays(
        displacement, driven, lanes, cursors, memory, motion, force, np.flatnonzero(~guarded_rows(states))
    )
    drive = _compiled_drive()
    first = FIRST_BUILT_IN_STEPS if is_all_built_in(law) else FIRST_CALL_WORK
    budget, is_done = CallBudget(MAX_CALL_SAMPLES, law, first), False
    observed = last_call if _is_observed(law, is_vectorised) else None
    while not is_done:
        with watched_call(law, lambda: _last_call(memory, observed)), budget.measure() as samples:
            try:
                is_done = drive(block, frame, arrays, samples)
            except Exception as error:  # an index that is out of bounds, or whatever a law raises
                reason = f"{type(error).__name__}: {error}"
                raise LawCallError(reason, law, _last_call(memory, observed)) from error
    index = written_index(memory)
    if index is not None:
        raise LawCallError(f"wrote z_next[{index}] of {states}", law)
    first = driven["first_sample"] + driven["lead_in"]
    return [force[begin : begin + size] for begin, size in zip(first, driven["size"], strict=True)]


def _last_call(memory: NDArray[np.float64], observed: NDArray[np.float64] | None) -> LawCall | None:
    """Return the call that was recorded last, if calls are."""
    if observed is None:
        return None
    _, half, dy, dt = observed.tolist()
    return LawCall(state_half(memory, int(half))[:, 0].copy(), dy, dt)


def can_vectorise(law: Law, arguments: tuple[LawArgument, ...]) -> bool:
    """Return whether a law can be computed in lanes: not if it branches on a value, or uses what lanes lack."""
    return _can_vectorise(law, argument_kinds(arguments))


@cache  # a search makes thousands of models of one law, and a compilation that fails takes nearly a second
def _can_vectorise(law: Law, kinds: ArgumentKinds) -> bool:
    try:
        compiled_block(law, kinds, MOTION_LANES)
    except LawError:
        return False
    return True


@cache
def compiled_block(law: Law, kinds: ArgumentKinds, layout: LaneLayout) -> Dispatcher:
    """Return the compiled block of samples of a law, in lanes or of one machine."""
    registered, is_observed = register_law(law), _is_observed(law, layout.is_vectorised)
    name = f"{law.__qualname__} along motions {layout} {kinds}"
    name += " observed" if is_observed else ""
    with explain_compiler_errors(law):
        return compile_kernel(
            name,
            kernel_source_hash() + fingerprint(law),
            lambda: _make_block(registered, kinds, layout, is_observed),
            _BLOCK_SIGNATURE,
            is_explained=not layout.is_vectorised,
            error_model="numpy",
        )


def _is_observed(law: Law, is_vectorised: bool) -> bool:
    """Return whether calls of a law are recorded: those of a dropped-in one in the scalar kernel."""
    return not (is_vectorised or is_all_built_in(law))


def _concatenate_motions(motions: Sequence[PrescribedMotion]) -> tuple[NDArray[np.float64], NDArray[np.void]]:
    """Return the displacement of all motions, one after another, and where each of them is."""
    parts, used = [], 0
    driven = np.zeros(len(motions), MOTION_DTYPE)
    for index, motion in enumerate(motions):
        lead_in, displacement = motion.lead_in, motion.displacement
        parts += [lead_in, displacement, displacement[:1]]  # of a periodic motion, the way back to its beginning
        max_passes = MAX_PASSES if motion.periodic else 1
        driven[index] = (used, lead_in.size, displacement.size, max_passes, motion.lead_in_step, motion.time_step)
        used += lead_in.size + displacement.size + 1
    parts.append(np.zeros(max(part.size for part in parts) + 1))
    return np.concatenate(parts, dtype=float), driven


def _make_block(
    law: Law, kinds: ArgumentKinds, layout: LaneLayout, is_observed: bool
) -> Callable[[StructArray[DrivenFrame]], None]:
    width, view, present_view, state_view = layout.width, layout.view, layout.present_view, layout.state_view
    read, gather = argument_reader(kinds, layout), layout.gather
    called = make_observed(law, FRICTION) if is_observed else law
    law_arguments = with_record if is_observed else without_record

    def block(frames: StructArray[DrivenFrame]) -> None:
        frame = frames[0]
        motion, motion_numbers = view(frame.motion, 0), float_pointer(frame.motion)
        force, cursors = float_pointer(frame.force), integer_pointer(frame.cursors)
        arguments = law_arguments(frame.last_call, read(frame.arguments, frame.argument_sizes))
        last_call = float_pointer(frame.last_call)
        z, states, current = frame.memory, frame.states, frame.current_memory
        z_bytes = DOUBLE_BYTES * width * (states + GUARD_ROWS)
        for row in range(frame.samples):
            displacement = gather(frame.displacement, frame.cursors, row)
            z_now, z_next = present_view(z + current * z_bytes, states), state_view(z + (1 - current) * z_bytes, states)
            if is_observed:
                last_call[CALL_HALF] = current
            motion[FORCE] = called(z_now, displacement - motion[DISPLACEMENT], motion[TIME_STEP], z_next, *arguments)
            motion[DISPLACEMENT] = displacement
            current = 1 - current
            for lane in range(width):
                force[cursors[lane] + row] = motion_numbers[FORCE * width + lane]
        frame.current_memory = current

    return block


@cache
def _compiled_drive() -> Dispatcher:
    return compile_kernel("motions", kernel_source_hash(), lambda: _drive, _DRIVE_SIGNATURE, error_model="numpy")


def _drive(block: int, frames: StructArray[DrivenFrame], arrays: _DrivenArrays, budget: int) -> bool:
    """Run blocks of samples, each as long as no lane needs a decision; return whether all motions are done.

    It returns after `budget` samples as well, to be called again.
    """
    frame, lanes, width = frames[0], arrays.lanes, arrays.lanes.size
    while True:
        samples, is_busy = budget, False
        for k in range(width):
            lane = lanes[k]
            while lane.remaining == 0:
                frame.next_motion = _enter_next_stage(k, frame.next_motion, arrays)
            samples = min(samples, lane.remaining)
            arrays.cursors[k] = lane.sample
            is_busy = is_busy or lane.stage != IDLE
        if not is_busy:
            return True
        if samples == 0:
            return False
        frame.samples = samples
        call_block(block, frames)
        budget -= samples
        for k in range(width):
            lane = lanes[k]
            lane.remaining -= samples
            lane.sample += samples if lane.stage != IDLE else 0


@compiled()
def _enter_next_stage(k: int, next_motion: int, arrays: _DrivenArrays) -> int:
    """Take lane k from lead-in to motion, to another pass of it, or to the next motion; return the one after that."""
    displacement, motions, lanes, _, memory, motion, force, rest_rows = arrays
    lane = lanes[k]
    driven = motions[lane.motion]
    first = driven.first_sample + driven.lead_in
    if lane.stage == LEAD_IN:
        reached = min(driven.lead_in, 1)  # a lead-in ends at the motion's first point, which is one of its steps away
        if not reached:
            motion[DISPLACEMENT, k] = displacement[first]
        motion[TIME_STEP, k] = driven.time_step
        lane.stage, lane.sample, lane.remaining = PASS, first + reached, driven.size - reached
        if driven.max_passes > 1:  # the way back to the beginning shows whether the force is periodic
            lane.remaining += 1
        return next_motion
    if lane.stage == PASS:
        lane.passes += 1
        has_history = lane.passes > 1 or driven.lead_in > 0  # without one, the pass began at rest, with a force of 0 N
        if lane.passes < driven.max_passes and not (has_history and _is_periodic(force, first, driven.size)):
            force[first] = force[first + driven.size]
            lane.sample, lane.remaining = first + 1, driven.size
            return next_motion
    for row in rest_rows:
        memory[row, k] = 0.0
    if next_motion == motions.size:
        last = motions[-1]
        lane.stage, lane.remaining = IDLE, FOREVER
        lane.sample = last.first_sample + last.lead_in + last.size + 1  # where the zeros begin
        return next_motion
    driven = motions[next_motion]
    lane.motion, lane.stage, lane.passes = next_motion, LEAD_IN, 0
    lane.sample, lane.remaining = driven.first_sample, driven.lead_in + min(driven.lead_in, 1)
    motion[DISPLACEMENT, k], motion[TIME_STEP, k] = displacement[driven.first_sample], driven.lead_in_step
    return next_motion + 1


@compiled()
def _is_periodic(force: NDArray[np.float64], first: int, size: int) -> bool:
    """Return whether the force at the end of a pass is that at its beginning."""
    greatest = 0.0
    for k in range(first, first + size):
        greatest = max(greatest, abs(force[k]))
    return abs(force[first + size] - force[first]) <= CLOSURE_TOLERANCE * greatest


_BLOCK_SIGNATURE = (struct_array_type(FRAME_DTYPE),)
_DRIVE_SIGNATURE = (
    types.int64, *_BLOCK_SIGNATURE, types.NamedTuple((
        float_array_type(1), struct_array_type(MOTION_DTYPE), struct_array_type(LANE_DTYPE),
        types.Array(types.int64, 1, "C"), float_array_type(2), float_array_type(2), float_array_type(1),
        types.Array(types.int64, 1, "C"),
    ), _DrivenArrays), types.int64,
)  # fmt: skip
"""Types of `_drive`'s arguments."""
