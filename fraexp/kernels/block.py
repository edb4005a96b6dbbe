"""A block of samples of the control loop around a continuous plant with friction: what is compiled for each law.

The linear part is discretised exactly; friction is linear in time within a step (holding it would be anti-damping).
Within a step the displacement is y₊ = a − g·f(y₊) with f nondecreasing: for one machine it is solved for implicitly;
lanes take the law at the displacement that the extrapolated force predicts, which is as good where g·df/dy ≪ 1.
"""

from typing import Any

import numpy as np
from numba import from_dtype, njit, types

from fraexp.kernels.addresses import array_at, floats_at, integers_at, number_at, numbers_at, rows_at
from fraexp.kernels.lanes import WIDTH, all_within, rounded, taken_at
from fraexp.kernels.law import Law
from fraexp.kernels.law_arguments import argument_reader

FORCE, PLACE, STIFFNESS, BEFORE = range(4)
"""Rows of a contact: friction force [N], displacement there [m], local stiffness [N/m], force a step before [N]."""
CONTACT_ROWS = 4
NOISE, AMPLITUDE, RISE, AGE, REFERENCE = range(5)
"""Rows of what drives a loop: the scale's noise [m], relative amplitude at the start, its rise per sample, samples
since, reference at rest [m]."""
DRIVE_ROWS = 5
CONTROL, POSITION, DISPLACEMENT, FRICTION, COMPENSATION, NEWEST = range(6)
"""Rows of a sample's trace: control input, measured and true displacement, friction force, its compensation, and the
next measured position."""
TRACE_ROWS = 6
FRAME = np.dtype(
    [(name, np.int64) for name in (
        # sizes: states n, steps m a sample, states of the law, order of the controller, whole samples of both dead
        # times, states of the compensation's law, channels recorded beside the position
        "states", "steps", "friction_states", "order", "late", "held", "observer_states", "channels",
        # the block: samples wanted and done, the valid half of the law's memory, and whether there are these
        "samples", "done", "now", "noisy", "moving", "recording",
        # addresses of the machines' constants, and of the laws' numbers with the size of each argument
        "matrix", "compliance", "responses", "numerator", "denominator",
        "arguments", "argument_sizes", "compensation", "compensation_sizes",
        # addresses of the loop's memory, of what drives it and of the trace
        "known", "linear", "friction", "filter", "inputs", "outputs", "contact", "observer", "drive", "trace",
        # addresses of what comes in, and of the place from which each lane reads it
        "waves", "goals", "noise", "source",
        # addresses of what goes out with the numbers in a row of it, and of the places of each lane's next number
        "history", "history_row", "others", "others_row", "filled", "start",
    )]
    # step [s], resolution of the scale [m], displacement that counts as diverged [m]
    + [(name, np.float64) for name in ("step", "resolution", "limit")]
)  # fmt: skip
"""What a block of samples needs to know."""
SIGNATURE = (types.Array(from_dtype(FRAME), 1, "C"),)
FAST = {"fastmath": {"contract"}, "error_model": "numpy"}
"""A product may be added without being rounded first: the same bits on every run; no division by 0 is looked for."""


def make_block(law: Law, observer_law: Law | None, kinds: Any, observer_kinds: Any, wide: bool) -> Any:
    """Return the function that runs a block of samples; `kinds` tell what the laws take (see `structure`)."""
    width = WIDTH if wide else 1
    view, state_view = (rows_at, rows_at) if wide else (numbers_at, array_at)
    read = argument_reader(kinds, wide)
    compensate = _compensation(observer_law, observer_kinds, wide) if observer_law else _no_compensation
    solve = _prediction(law) if wide else _root(law)
    take, inside = (taken_at, all_within) if wide else (number_at, _within)

    def block(frames):  # type: ignore[no-untyped-def]
        frame = frames[0]
        n, m, states, order, late, held = (
            frame.states, frame.steps, frame.friction_states, frame.order, frame.late, frame.held,
        )  # fmt: skip
        matrix, compliance, responses = view(frame.matrix, 0), view(frame.compliance, 0), view(frame.responses, 0)
        numerator, denominator = view(frame.numerator, 0), view(frame.denominator, 0)
        known, linear, w = view(frame.known, 0), view(frame.linear, 0), view(frame.filter, 0)
        inputs, outputs, contact = view(frame.inputs, 0), view(frame.outputs, 0), view(frame.contact, 0)
        drive, trace, noise = view(frame.drive, 0), view(frame.trace, 0), view(frame.noise, 0)
        z = frame.friction
        half = 8 * width * states
        step, resolution, limit = frame.step, frame.resolution, frame.limit
        noisy, moving, recording, channels = frame.noisy != 0, frame.moving != 0, frame.recording != 0, frame.channels
        traced, history, others = floats_at(frame.trace), floats_at(frame.history), floats_at(frame.others)
        filled, start = integers_at(frame.filled), integers_at(frame.start)
        arguments = read(frame.arguments, frame.argument_sizes)
        samples, history_row, others_row = frame.samples, frame.history_row, frame.others_row
        goals, waves, source = frame.goals, frame.waves, frame.source
        now, done = frame.now, 0
        while done < samples:
            if noisy:
                drive[NOISE] = noise[done]
            reference = drive[REFERENCE]
            if moving:
                reference = take(goals, source, done)
            amplitude = min(drive[AMPLITUDE] + drive[RISE] * drive[AGE], 1.0)
            drive[AGE] = drive[AGE] + 1.0
            excitation = take(waves, source, done) * amplitude

            position = outputs[held] + drive[NOISE]
            if resolution > 0.0:
                position = rounded(position / resolution) * resolution
            for i in range(late + 1, 0, -1):
                inputs[i] = inputs[i - 1]
            error = reference - position
            control = numerator[0] * error + w[0]
            for i in range(1, order):
                w[i - 1] = numerator[i] * error - denominator[i] * control + w[i]
            compensated = compensate(frame, position)
            control = control + excitation + compensated
            inputs[0] = control

            place, force, before, stiffness = contact[PLACE], contact[FORCE], contact[BEFORE], contact[STIFFNESS]
            trace[CONTROL], trace[POSITION], trace[DISPLACEMENT] = control, position, place
            trace[FRICTION], trace[COMPENSATION] = force, compensated
            known[n], known[n + 1], known[n + 2] = inputs[late + 1], inputs[late], force
            multiply(matrix, known, linear, m + 1 + n, n + 3)
            for j in range(m):
                a = linear[j]
                for i in range(j):
                    a += compliance[j * m + i] * linear[i]  # which by now holds the force
                gain = -compliance[j * m + j]
                z_now, z_next = state_view(z + now * half, states), state_view(z + (1 - now) * half, states)
                after, place, stiffness = solve(
                    a, gain, step, z_now, z_next, arguments, force, before, place, stiffness
                )
                before, force = force, after
                linear[j] = force
                now = 1 - now
            contact[PLACE], contact[FORCE], contact[BEFORE], contact[STIFFNESS] = place, force, before, stiffness
            for i in range(held, 0, -1):
                outputs[i] = outputs[i - 1]
            newest = linear[m]
            for j in range(m):
                newest += responses[j] * linear[j]
            outputs[0] = newest
            trace[NEWEST] = newest
            for i in range(1, n + 1):
                state = linear[m + i]
                for j in range(m):
                    state += responses[i * m + j] * linear[j]
                known[i - 1] = state

            for lane in range(width):
                history[lane * history_row + filled[lane] + done] = traced[POSITION * width + lane]
            if recording:
                for lane in range(width):
                    at = done - start[lane]
                    if at >= 0:
                        record = (lane * channels) * others_row + at
                        others[record] = traced[CONTROL * width + lane]
                        others[record + others_row] = traced[DISPLACEMENT * width + lane]
                        others[record + 2 * others_row] = traced[FRICTION * width + lane]
                        if channels > 3:
                            others[record + 3 * others_row] = traced[COMPENSATION * width + lane]
            done += 1
            if not inside(newest, limit):
                break
        frame.now, frame.done = now, done

    return block


@njit(forceinline=True)
def _within(value, limit):  # type: ignore[no-untyped-def]
    return abs(value) < limit


@njit(forceinline=True)
def _no_compensation(frame, position):  # type: ignore[no-untyped-def]
    return 0.0


def _compensation(law: Law, kinds: Any, wide: bool) -> Any:
    """Return what friction compensation adds to the control input [N], from the measured position."""
    view, state_view, width = rows_at if wide else numbers_at, rows_at if wide else array_at, WIDTH if wide else 1
    read = argument_reader(kinds, wide)

    @njit(forceinline=True, **FAST)
    def compensate(frame, position):  # type: ignore[no-untyped-def]
        gain, viscous, time_step, parameters = read(frame.compensation, frame.compensation_sizes)
        observer, states = view(frame.observer, 0), frame.observer_states
        moved = position - observer[2 * states]
        observer[2 * states] = position
        z, z_next = state_view(frame.observer, states), state_view(frame.observer + 8 * width * states, states)
        force = law(z, moved, time_step, z_next, *parameters)
        for i in range(states):
            observer[i] = observer[states + i]
        return gain * (force + viscous * (moved / time_step))

    return compensate


@njit(forceinline=True, **FAST)
def multiply(matrix, vector, result, rows, columns):  # type: ignore[no-untyped-def]
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


def _prediction(law: Law) -> Any:
    """Return the step in lanes: force [N], displacement [m] and stiffness [N/m] at its end."""

    @njit(forceinline=True, **FAST)
    def predict(a, gain, step, z, z_next, arguments, force, before, place, stiffness):  # type: ignore[no-untyped-def]
        y = a - gain * (2.0 * force - before)
        return law(z, y - place, step, z_next, *arguments), y, stiffness

    return predict


def _root(law: Law) -> Any:
    """Return the implicit step: it finds the root of r(y) = y - a + gain*f(y), whose slope is 1 at least."""

    @njit(forceinline=True, **FAST)
    def solve(a, gain, step, z, z_next, arguments, force, before, place, stiffness):  # type: ignore[no-untyped-def]
        y = a - gain * (2.0 * force - before)
        after = law(z, y - place, step, z_next, *arguments)
        residual = y - a + gain * after
        slope = 1.0 + gain * stiffness
        low, high = -np.inf, np.inf
        for _ in range(60):
            if abs(residual) <= 1e-7 * abs(y - place) + 1e-17:
                break
            if residual > 0.0:
                high = y
            else:
                low = y
            trial = y - residual / slope
            if not low < trial < high:
                trial = 0.5 * (low + high)
            if trial == y:
                break
            after = law(z, trial - place, step, z_next, *arguments)
            fresh = trial - a + gain * after
            slope = max((fresh - residual) / (trial - y), 1.0)
            y, residual = trial, fresh
        if y != place:
            stiffness = max((after - force) / (y - place), 0.0)
        return after, y, stiffness

    return solve
