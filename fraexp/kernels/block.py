"""A block of samples of the control loop around a continuous plant with friction: what is compiled for each law.

The linear part is discretised exactly; friction is linear in time within a step (holding it would be anti-damping).
Within a step the displacement is y₊ = a − g·f(y₊) with f nondecreasing. For one machine this is solved for y₊: friction
is implicit. Lanes take the law at the displacement that the extrapolated force predicts: friction is explicit, which is
as good where g·df/dy ≪ 1. A law of velocity that jumps at rest is solved in velocities: the rows of its contact hold
velocities in place of displacements. `docs/kernels.md` explains all three.
"""

from collections.abc import Callable

from fraexp.kernels.addresses import DOUBLE_BYTES, float_pointer
from fraexp.kernels.contact_steps import make_steps
from fraexp.kernels.decorators import COMPILER_OPTIONS, compiled
from fraexp.kernels.guards import GUARD_ROWS
from fraexp.kernels.lane_layout import LaneLayout
from fraexp.kernels.lanes import LaneRows, LaneValue, round_half_even
from fraexp.kernels.law import Law
from fraexp.kernels.law_arguments import ArgumentKinds, argument_reader
from fraexp.kernels.observed_law import COMPENSATION, make_observed, with_record, without_record
from fraexp.kernels.stick_slip import CONTACT_DISPLACEMENT, CONTACT_FORCE, CONTACT_ROWS
from fraexp.kernels.structs import StructArray, struct_array_type, struct_dtype

DRIVE_NOISE, DRIVE_AMPLITUDE, DRIVE_RISE, DRIVE_AGE, DRIVE_REFERENCE = range(5)
"""Rows of what drives a loop: noise of the encoder [m], relative amplitude at the start, its rise per sample, samples
since the start, reference at rest [m]."""
DRIVE_ROWS = 5
TRACE_NEXT_POSITION, TRACE_POSITION, TRACE_CHANNELS = range(3)
"""Parts of a trace: the next position without noise [m] after the block; of each sample the measured one [m], and the
channels of a record: control input [N], the contacts' displacements [m] and friction forces [N], further measured
positions [m], control inputs of further thrusts [N], and the friction's compensation [N], if there is any."""
TRACE_SAMPLES = 248
"""Maximum number of samples of a block: rows of each part of its trace, which do not lie whole pages apart."""


class LoopFrame:
    """What a block of samples needs: sizes, addresses and settings. Memory is changed in place, by its address."""

    states: int
    """Number n of states of the linear part."""
    steps: int
    """Number m of steps per sample."""
    friction_states: int
    """Number of states of the friction law."""
    thrusts: int
    """Number of thrusts, each with a controller; the first is excited."""
    controller_order: int
    """Number of coefficients of each controller's numerator, and of its denominator."""
    input_delay: int
    """Whole samples of dead time before the thrust."""
    output_delay: int
    """Whole samples of dead time before the measurement."""
    compensation_states: int
    """Number of states of the compensation's law."""
    positions: int
    """Number of measured positions, one for each thrust first, which is fed back to it."""

    samples: int
    """Samples to run."""
    samples_done: int
    """Samples that were run: fewer where a displacement left the limit."""
    current_memory: int
    """Which of the two halves of `friction_memory` holds the law's present state: 0 or 1."""
    has_noise: int
    """Whether the encoder has noise; 0 or 1, as the next two."""
    has_moving_reference: int
    """Whether the position reference moves."""
    is_recording: int
    """Whether any lane records its channels."""

    matrix: int
    """Address: rows of each step's displacements at c contacts, the p next measurements and the next states, shape
    (m c + p + n, n + 2 t + c) with t thrusts; with laws of velocity c more rows, of the present displacements."""
    compliance: int
    """Address: what the forces at the steps' ends add to the steps' displacements, negative [m/N], (m c, m c)."""
    responses: int
    """Address: what these forces add to the next measurements and the next states, shape (p + n, m c)."""
    durations: int
    """Address: duration of each step [s], shape (m,)."""
    numerator: int
    """Address: coefficients of the controllers [N/m], in ascending powers of z⁻¹, shape (t, order)."""
    denominator: int
    """Address: their denominators, which start with 1, shape (t, order)."""
    arguments: int
    """Address: numbers of the friction law's arguments."""
    argument_sizes: int
    """Address: size of each of these arguments."""
    compensation_arguments: int
    """Address: numbers of what the compensation takes: gain, viscous coefficient, sample time, its law's arguments."""
    compensation_sizes: int
    """Address: size of each of what the compensation takes."""

    known: int
    """Address: what is known before a sample is run: states, both values of each control input, friction forces."""
    linear: int
    """Address: product of `matrix` and `known`, in which each step's displacements give way to its friction forces."""
    friction_memory: int
    """Address: state of the friction law, twice, with a guard between: the present one and the next one."""
    controller_memory: int
    """Address: what earlier samples contribute to the controllers' next outputs [N], shape (t, order)."""
    control_inputs: int
    """Address: control input of this sample and of those before, as far back as the dead time needs; one thrust after
    another."""
    measurements: int
    """Address: measured positions of this sample and of those before, one position after another."""
    contacts: int
    """Address: the contacts at the last step's end, `contact_rows`."""
    compensation_memory: int
    """Address: present and next state of the compensation's law, each with a guard after it, then the last measured
    position."""
    drive: int
    """Address: what drives the loop, DRIVE_ROWS."""
    trace: int
    """Address: what is known of the block's samples, `trace_rows`."""
    last_call: int
    """Address: the last call of a law that is observed, CALL_NUMBERS."""

    waveforms: int
    """Address: excitation of all periods [N]."""
    references: int
    """Address: position reference of all periods [m]."""
    noise: int
    """Address: noise of the next samples [m], a row for each."""
    read_indices: int
    """Address: for each lane, the index of its next number in `waveforms` and `references`."""

    time_step: float
    """Duration of a step [s]."""
    resolution: float
    """Quantisation step of the encoder [m]; 0 for an ideal one."""
    divergence_limit: float
    """Displacement that counts as diverged [m]."""


FRAME_DTYPE = struct_dtype(LoopFrame)
SIGNATURE = (struct_array_type(FRAME_DTYPE),)


def make_block(
    law: Law,
    compensation_law: Law | None,
    kinds: ArgumentKinds,
    compensation_kinds: ArgumentKinds,
    layout: LaneLayout,
    is_set_valued: tuple[bool, ...] = (False,),
    is_observed: bool = False,
) -> Callable[[StructArray[LoopFrame]], None]:
    """Return the function that runs a block of samples; the kinds are those of the laws' arguments.

    `is_set_valued` says for each contact whether its law is one of velocity that jumps at rest. For several contacts
    the law is one that chooses by the number of the contact. With `is_observed` the last call of a law is recorded, and
    a force that is not finite raises an error.
    """
    contacts = len(is_set_valued)
    view, constant_view, gather, is_within = layout.view, layout.constant_view, layout.gather, layout.is_within
    read = argument_reader(kinds, layout)
    compensate = (
        _make_compensation(compensation_law, compensation_kinds, layout, is_observed)
        if compensation_law
        else _no_compensation
    )
    take_steps = make_steps(law, is_set_valued, layout, is_observed)
    law_arguments = with_record if is_observed else without_record
    extra_rows = contacts if any(is_set_valued) else 0

    def block(frames: StructArray[LoopFrame]) -> None:
        # All fields are read once, before the loop: the compiler cannot know that no sample overwrites the frame.
        frame = frames[0]
        n, m, states, order = frame.states, frame.steps, frame.friction_states, frame.controller_order
        input_delay, output_delay = frame.input_delay, frame.output_delay
        matrix, compliance = constant_view(frame.matrix, 0), constant_view(frame.compliance, 0)
        responses, durations = constant_view(frame.responses, 0), constant_view(frame.durations, 0)
        numerator, denominator = constant_view(frame.numerator, 0), constant_view(frame.denominator, 0)
        known, linear, filtered = view(frame.known, 0), view(frame.linear, 0), view(frame.controller_memory, 0)
        control_inputs, measurements = view(frame.control_inputs, 0), view(frame.measurements, 0)
        contact, drive = view(frame.contacts, 0), view(frame.drive, 0)
        trace, noise = view(frame.trace, 0), view(frame.noise, 0)
        z = frame.friction_memory
        forces, positions, thrusts = m * contacts, frame.positions, frame.thrusts
        first_force = n + 2 * thrusts
        first_displacement = (TRACE_CHANNELS + 1) * TRACE_SAMPLES
        first_friction = first_displacement + contacts * TRACE_SAMPLES
        first_position = first_friction + contacts * TRACE_SAMPLES
        first_control = first_position + (positions - 1) * TRACE_SAMPLES
        time_step, resolution, limit = frame.time_step, frame.resolution, frame.divergence_limit
        ticks_per_metre = 1.0 / resolution if resolution > 0.0 else 0.0
        has_noise, has_moving_reference = frame.has_noise != 0, frame.has_moving_reference != 0
        is_recording = frame.is_recording != 0
        arguments = law_arguments(frame.last_call, read(frame.arguments, frame.argument_sizes))
        last_call = float_pointer(frame.last_call)
        references, waveforms, read_indices = frame.references, frame.waveforms, frame.read_indices
        samples, current, done = frame.samples, frame.current_memory, 0
        while done < samples:
            # What comes in: reference and excitation, whose amplitude rises from rest.
            if has_noise:
                drive[DRIVE_NOISE] = noise[done * positions]
            reference = drive[DRIVE_REFERENCE]
            if has_moving_reference:
                reference = gather(references, read_indices, done)
            amplitude = min(drive[DRIVE_AMPLITUDE] + drive[DRIVE_RISE] * drive[DRIVE_AGE], 1.0)
            drive[DRIVE_AGE] = drive[DRIVE_AGE] + 1.0
            excitation = gather(waveforms, read_indices, done) * amplitude

            # The encoder sees the position late, with noise, in whole quantisation steps.
            position = measurements[output_delay] + drive[DRIVE_NOISE]
            if resolution > 0.0:
                position = round_half_even(position * ticks_per_metre) * resolution

            # The controller, in transposed direct form II: `filtered` holds what earlier samples still contribute.
            for i in range(input_delay + 1, 0, -1):
                control_inputs[i] = control_inputs[i - 1]
            error = reference - position
            control = numerator[0] * error + filtered[0]
            for i in range(1, order):
                filtered[i - 1] = numerator[i] * error - denominator[i] * control + filtered[i]
            compensation_force = compensate(frame, position)
            control = control + excitation + compensation_force
            control_inputs[0] = control

            trace[TRACE_POSITION * TRACE_SAMPLES + done] = position
            if is_recording:
                trace[TRACE_CHANNELS * TRACE_SAMPLES + done] = control
            if compensation_law is not None:
                trace[first_control + (thrusts - 1) * TRACE_SAMPLES + done] = compensation_force
            for i in range(1, positions):
                further = measurements[i * (output_delay + 1) + output_delay]
                if has_noise:
                    further = further + noise[done * positions + i]
                if resolution > 0.0:
                    further = round_half_even(further * ticks_per_metre) * resolution
                trace[first_position + (i - 1) * TRACE_SAMPLES + done] = further
                if i < thrusts:  # which is not excited: its controller holds this position
                    own, inputs = i * order, i * (input_delay + 2)
                    for k in range(inputs + input_delay + 1, inputs, -1):
                        control_inputs[k] = control_inputs[k - 1]
                    error = reference - further
                    control = numerator[own] * error + filtered[own]
                    for k in range(own + 1, own + order):
                        filtered[k - 1] = numerator[k] * error - denominator[k] * control + filtered[k]
                    control_inputs[inputs] = control
                    known[n + 2 * i] = control_inputs[inputs + input_delay + 1]
                    known[n + 2 * i + 1] = control_inputs[inputs + input_delay]
                    trace[first_control + (i - 1) * TRACE_SAMPLES + done] = control

            # One product gives all that does not depend on the forces to come. The thrust has two values in a sample,
            # because dead time that is no multiple of it lets the older control input act on for a while.
            known[n], known[n + 1] = control_inputs[input_delay + 1], control_inputs[input_delay]
            for i in range(contacts):
                force, row = contact[i * CONTACT_ROWS + CONTACT_FORCE], i * TRACE_SAMPLES + done
                known[first_force + i] = force
                if is_recording:
                    trace[first_displacement + row] = contact[i * CONTACT_ROWS + CONTACT_DISPLACEMENT]
                    trace[first_friction + row] = force
            multiply_matrix(matrix, known, linear, forces + positions + n + extra_rows, first_force + contacts)
            for i in range(extra_rows):  # contacts hold velocities
                trace[first_displacement + i * TRACE_SAMPLES + done] = linear[forces + positions + n + i]
            current = take_steps(
                (linear, compliance, durations, m, contact, z, states, current, time_step, arguments, last_call)
            )
            # Next measurements and next state: the free part, and what the forces of all steps add.
            for k in range(positions):
                newest = k * (output_delay + 1)
                for i in range(newest + output_delay, newest, -1):
                    measurements[i] = measurements[i - 1]
                next_position = linear[forces + k]
                for j in range(forces):
                    next_position += responses[k * forces + j] * linear[j]
                measurements[newest] = next_position
            next_position = measurements[0]
            for i in range(n):
                state = linear[forces + positions + i]
                for j in range(forces):
                    state += responses[(positions + i) * forces + j] * linear[j]
                known[i] = state
            done += 1
            # One comparison for all lanes; which of them diverged is found out after the block.
            if not is_within(next_position, limit):
                break
        trace[TRACE_NEXT_POSITION] = measurements[0]
        frame.current_memory, frame.samples_done = current, done

    return block


def trace_rows(contacts: int, positions: int, thrusts: int) -> int:
    """Return the rows of a trace."""
    return (TRACE_CHANNELS + 2 * contacts + positions + thrusts) * TRACE_SAMPLES


@compiled(forceinline=True)
def _no_compensation(frame: LoopFrame, position: LaneValue) -> float:
    return 0.0


def _make_compensation(
    law: Law, kinds: ArgumentKinds, layout: LaneLayout, is_observed: bool
) -> Callable[..., LaneValue]:
    """Return what friction compensation adds to the control input [N], from the measured position."""
    width, view, present_view, state_view = layout.width, layout.view, layout.present_view, layout.state_view
    read = argument_reader(kinds, layout)
    called = make_observed(law, COMPENSATION) if is_observed else law
    law_arguments = with_record if is_observed else without_record

    @compiled(forceinline=True, **COMPILER_OPTIONS)
    def compensate(frame: LoopFrame, position: LaneValue) -> LaneValue:
        gain, viscous, sample_time, given = read(frame.compensation_arguments, frame.compensation_sizes)
        arguments = law_arguments(frame.last_call, given)
        memory, states = view(frame.compensation_memory, 0), frame.compensation_states
        half = states + GUARD_ROWS
        moved = position - memory[2 * half]
        memory[2 * half] = position
        z = present_view(frame.compensation_memory, states)
        z_next = state_view(frame.compensation_memory + DOUBLE_BYTES * width * half, states)
        force = called(z, moved, sample_time, z_next, *arguments)
        for i in range(states):  # once per sample: not worth a second half that changes roles
            memory[i] = memory[half + i]
        return gain * (force + viscous * (moved / sample_time))

    return compensate


@compiled(forceinline=True, **COMPILER_OPTIONS)
def multiply_matrix(matrix: LaneRows, vector: LaneRows, result: LaneRows, rows: int, columns: int) -> None:
    """Multiply a matrix with a vector, four rows at a time: a number of the vector is loaded once for all four."""
    row = 0
    while row + 4 <= rows:
        at = row * columns
        value = vector[0]
        first, second = matrix[at] * value, matrix[at + columns] * value
        third, fourth = matrix[at + 2 * columns] * value, matrix[at + 3 * columns] * value
        for i in range(1, columns):
            value = vector[i]
            first += matrix[at + i] * value
            second += matrix[at + columns + i] * value
            third += matrix[at + 2 * columns + i] * value
            fourth += matrix[at + 3 * columns + i] * value
        result[row], result[row + 1], result[row + 2], result[row + 3] = first, second, third, fourth
        row += 4
    while row < rows:
        first = matrix[row * columns] * vector[0]
        for i in range(1, columns):
            first += matrix[row * columns + i] * vector[i]
        result[row] = first
        row += 1
