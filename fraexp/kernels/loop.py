"""The sampled control loop around a continuous plant with friction: one sample of it, for one job or for eight.

The linear part is discretised exactly; friction is linear in time within a step (holding it would be anti-damping).
Within a step the displacement is y₊ = a − g·f(y₊) with f nondecreasing: a float is solved for implicitly, lanes take
the law at the displacement that the extrapolated force predicts, which is as good where g·df/dy ≪ 1.

Compiled code is told by the types of its arguments which of both it is: arrays of shape (k,) hold the numbers of one
job, arrays of shape (k, 8) those of eight.
"""

from typing import Any

import numpy as np
from numba import njit, types
from numba.extending import intrinsic, overload
from numba.np.arrayobj import populate_array

from fraexp.kernels.lanes import LanesType, RowsType, bare_rows_of, column_of, rounded, rows_of, taken

FORCE, PLACE, STIFFNESS, BEFORE = range(4)
"""Contact: friction force [N], displacement there [m], local stiffness [N/m], force a step before [N]."""
CONTACT = 4
TRACED = 6
"""Control input, measured and true displacement, friction force, its compensation, and the next measured position."""
FAST = {"fastmath": {"contract"}, "error_model": "numpy"}
"""A product may be added without being rounded first: the same bits on every run; no division by 0 is looked for."""


def bound(array: Any) -> Any:
    """Return an array as the numbers of one job, or as rows of lanes."""
    raise NotImplementedError


@overload(bound)
def _bound(array):  # type: ignore[no-untyped-def]
    if array.ndim == 1:
        return lambda array: column_of(array)
    return lambda array: bare_rows_of(array)


@intrinsic
def _view(typingctx: Any, array: Any, start: Any, size: Any) -> Any:
    def emit(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        source = context.make_array(array)(context, builder, values[0])
        made = context.make_array(array)(context, builder)
        eight = context.get_constant(types.intp, 8)
        populate_array(
            made,
            data=builder.gep(source.data, [values[1]]),
            shape=[values[2]],
            strides=[eight],
            itemsize=eight,
            meminfo=None,
        )
        return made._getvalue()

    return array(array, types.intp, types.intp), emit


def part(array: Any, start: int, size: int) -> Any:
    """Return a part of an array, which must live on, without looking whether it is there."""
    raise NotImplementedError


@overload(part, jit_options={"forceinline": True})
def _part(array, start, size):  # type: ignore[no-untyped-def]
    if isinstance(array, RowsType):
        return lambda array, start, size: array[start : start + size]
    return lambda array, start, size: _view(array, start, size)


def bound_state(array: Any) -> Any:
    """Return the law's memory: a law may do with an array of one job whatever numba knows."""
    raise NotImplementedError


@overload(bound_state)
def _bound_state(array):  # type: ignore[no-untyped-def]
    if array.ndim == 1:
        return lambda array: array
    return lambda array: bare_rows_of(array)


def bound_argument(argument: Any, like: Any) -> Any:
    """Return a law's argument, stored with shape (lanes,), (n, lanes) or as an integer, as the law takes it."""
    raise NotImplementedError


@overload(bound_argument)
def _bound_argument(argument, like):  # type: ignore[no-untyped-def]
    if isinstance(argument, types.Integer):
        return lambda argument, like: argument
    if isinstance(argument, types.BaseTuple):
        if not len(argument):
            return lambda argument, like: ()
        return lambda argument, like: (bound_argument(argument[0], like),) + bound_argument(argument[1:], like)
    if like.width > 1:
        if argument.ndim == 1:
            return lambda argument, like: rows_of(argument.reshape(1, argument.size))[0]
        return lambda argument, like: rows_of(argument)
    if argument.ndim == 1:
        return lambda argument, like: argument[0]
    return lambda argument, like: argument.reshape(argument.size)


def taken_from(array: Any, places: Any, offset: int, like: Any) -> Any:
    """Return array[places[lane] + offset] of the one lane, or of each."""
    raise NotImplementedError


@overload(taken_from, jit_options={"forceinline": True})
def _taken_from(array, places, offset, like):  # type: ignore[no-untyped-def]
    if like.width > 1:
        return lambda array, places, offset, like: taken(array, places, offset)
    return lambda array, places, offset, like: array[places[0] + offset]


def put_number(array: Any, row: int, lane: int, value: float) -> None:
    """Set one number of one lane."""
    raise NotImplementedError


@overload(put_number)
def _put_number(array, row, lane, value):  # type: ignore[no-untyped-def]
    return _put_alone if array.ndim == 1 else _put_beside


def _put_alone(array, row, lane, value):  # type: ignore[no-untyped-def]
    array[row] = value


def _put_beside(array, row, lane, value):  # type: ignore[no-untyped-def]
    array[row, lane] = value


def get_number(array: Any, row: int, lane: int) -> float:
    """Return one number of one lane."""
    raise NotImplementedError


@overload(get_number)
def _get_number(array, row, lane):  # type: ignore[no-untyped-def]
    if array.ndim == 1:
        return lambda array, row, lane: array[row]
    return lambda array, row, lane: array[row, lane]


def fed_back(law: Any, arguments: Any, observer: Any, sizes: Any, position: Any) -> Any:
    """Return what friction compensation adds to the control input, from the measured position; nothing without it."""
    raise NotImplementedError


@overload(fed_back, jit_options={"forceinline": True, **FAST})
def _fed_back(law, arguments, observer, sizes, position):  # type: ignore[no-untyped-def]
    if not len(arguments):
        return lambda law, arguments, observer, sizes, position: 0.0
    return _observed


def _observed(law, arguments, observer, sizes, position):  # type: ignore[no-untyped-def]
    gain, viscous, time_step, parameters = arguments
    states = sizes[6]
    moved = position - observer[2 * states]
    observer[2 * states] = position
    force = law(part(observer, 0, states), moved, time_step, part(observer, states, states), *parameters)
    for i in range(states):
        observer[i] = observer[states + i]
    return gain * (force + viscous * (moved / time_step))


@njit(forceinline=True, **FAST)
def sample(  # type: ignore[no-untyped-def]
    laws, arguments, compensation, constants, memory, sizes, step, resolution, now, excitation, reference, noise
):
    """Run the loop over one sample; return what is traced of it: `TRACED`.

    The law of friction and that of its compensation come with their arguments; without any of the latter there is no
    compensation.
    """
    law, observer_law = laws
    n, m, states, order, late, held, _ = sizes
    matrix, compliance, responses, numerator, denominator = constants
    known, linear, z, w, inputs, outputs, contact, observer = memory
    position = outputs[held] + noise
    if resolution > 0.0:
        position = rounded(position / resolution) * resolution
    for i in range(late + 1, 0, -1):
        inputs[i] = inputs[i - 1]
    error = reference - position
    control = numerator[0] * error + w[0]
    for i in range(1, order):
        w[i - 1] = numerator[i] * error - denominator[i] * control + w[i]
    compensated = fed_back(observer_law, compensation, observer, sizes, position)
    control = control + excitation + compensated
    inputs[0] = control
    place, force, before, stiffness = contact[PLACE], contact[FORCE], contact[BEFORE], contact[STIFFNESS]
    place_now, force_now = place, force
    known[n], known[n + 1], known[n + 2] = inputs[late + 1], inputs[late], force
    multiply(matrix, known, linear, m + 1 + n, n + 3)
    for j in range(m):
        a = linear[j]
        for i in range(j):
            a += compliance[j * m + i] * linear[i]  # which by now holds the force
        gain = -compliance[j * m + j]
        z_now, z_next = part(z, now * states, states), part(z, (1 - now) * states, states)
        after, place, stiffness = solve(law, a, gain, step, z_now, z_next, arguments, force, before, place, stiffness)
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
    for i in range(1, n + 1):
        state = linear[m + i]
        for j in range(m):
            state += responses[i * m + j] * linear[j]
        known[i - 1] = state
    return control, position, place_now, force_now, compensated, newest


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


def solve(  # type: ignore[no-untyped-def]
    law, a, gain, step, z, z_next, arguments, force, before, place, stiffness
):
    """Return force [N], displacement [m] and local stiffness [N/m] at a step's end."""
    raise NotImplementedError


@overload(solve, jit_options={"forceinline": True, **FAST})
def _solve(law, a, gain, step, z, z_next, arguments, force, before, place, stiffness):  # type: ignore[no-untyped-def]
    return _predicted if isinstance(a, LanesType) else _root


def _predicted(law, a, gain, step, z, z_next, arguments, force, before, place, stiffness):  # type: ignore[no-untyped-def]
    y = a - gain * (2.0 * force - before)
    return law(z, y - place, step, z_next, *arguments), y, stiffness


def _root(law, a, gain, step, z, z_next, arguments, force, before, place, stiffness):  # type: ignore[no-untyped-def]
    """Find the root of r(y) = y - a + gain*f(y), whose slope is 1 at least."""
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
