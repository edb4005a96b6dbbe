"""The sampled control loop around a continuous plant with friction, step by step.

The linear part is discretised exactly; friction is linear in time within a step and found implicitly: with
y₊ = a − g·f(y₊) and f nondecreasing, the root is unique (holding the force instead would be anti-damping).
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from fraexp.kernels.law import Law, cached, call


class Sample(NamedTuple):
    """The linear part over one sample of m steps: n states, two input values, m + 1 friction forces."""

    displacement: np.ndarray
    """Rows that give the displacement at each step's end from state and inputs, shape (m, n + 2)."""
    compliance: np.ndarray
    """Displacement at each step's end that the forces at the steps' bounds take away, shape (m, m + 1)."""
    measured: np.ndarray
    """Row that gives the next measured position from state, inputs and forces, shape (n + m + 3,)."""
    transition: np.ndarray
    """Columns that give the next state from state, inputs and forces, shape (n + m + 3, n)."""
    step: float
    """Length of a step [s]."""


class Feedback(NamedTuple):
    """C(z) and the scale."""

    numerator: np.ndarray
    """Ascending powers of z⁻¹ [N/m], shape (p,)."""
    denominator: np.ndarray
    """Ascending powers of z⁻¹, starting with 1, shape (p,)."""
    resolution: float
    """Resolution of the scale [m]; 0 for an ideal one."""
    limit: float
    """Displacement beyond which the loop counts as diverged [m]."""


class State(NamedTuple):
    """All that the loop remembers; changed in place."""

    x: np.ndarray
    """Linear part, shape (n,)."""
    z: np.ndarray
    """Friction: valid and scratch memory, shape (2, states)."""
    w: np.ndarray
    """Controller, shape (p,)."""
    inputs: np.ndarray
    """Control inputs, the newest first [N], shape (whole samples of dead time + 2,)."""
    outputs: np.ndarray
    """Measured positions, the newest first [m], shape (whole samples of output dead time + 1,)."""
    contact: np.ndarray
    """Friction force [N], displacement there [m], local stiffness [N/m], valid row of z, force a step before [N]."""


def run(
    law: Law,
    arguments: tuple[Any, ...],
    sample: Sample,
    feedback: Feedback,
    state: State,
    excitation: np.ndarray,
    reference: np.ndarray,
    noise: np.ndarray,
) -> tuple[bool, np.ndarray]:
    """Run the loop over the samples of `excitation` [N], `reference` [m] and scale `noise` [m], each of shape (k,).

    Returns whether the loop stayed within its limit, and the channels, shape (4, k): control input [N], measured
    position [m], displacement [m] and friction force [N] at the sampling instants.
    """
    channels = np.empty((4, excitation.size))
    # plain tuples: looking up the type of a named one takes as long as running 200 samples
    constants = (tuple(sample), tuple(feedback), tuple(state))
    return bool(call(_make_loop, law, *constants, excitation, reference, noise, channels, arguments)), channels


def _make_loop(law: Law, fingerprint: str) -> Any:
    @cached
    def loop(sample, feedback, state, excitation, reference, noise, channels, arguments):  # type: ignore[no-untyped-def]
        _ = fingerprint  # a cell of the closure: an edited law is compiled again
        displacement, compliance, measured, transition, step = sample
        numerator, denominator, resolution, limit = feedback
        x, z, w, inputs, outputs, contact = state
        n, m, late = x.size, displacement.shape[0], inputs.size - 1
        known = np.empty(n + 2 + m + 1)  # state, input before and after its switch, friction forces
        for k in range(excitation.size):
            position = outputs[outputs.size - 1] + noise[k]
            if resolution > 0.0:
                position = np.round(position / resolution) * resolution
            for i in range(late, 0, -1):
                inputs[i] = inputs[i - 1]
            inputs[0] = control(numerator, denominator, w, reference[k] - position) + excitation[k]
            channels[0, k], channels[1, k], channels[2, k], channels[3, k] = inputs[0], position, contact[1], contact[0]
            known[:n] = x
            known[n], known[n + 1], known[n + 2] = inputs[late], inputs[late - 1], contact[0]
            for j in range(m):
                a = 0.0
                for i in range(n + 2):
                    a += displacement[j, i] * known[i]
                for i in range(j + 1):
                    a -= compliance[j, i] * known[n + 2 + i]
                known[n + 3 + j] = solve(law, a, compliance[j, j + 1], step, z, contact, arguments)
            for i in range(outputs.size - 1, 0, -1):
                outputs[i] = outputs[i - 1]
            outputs[0] = 0.0
            x[:] = 0.0
            for j in range(known.size):
                outputs[0] += measured[j] * known[j]
                for i in range(n):  # a column at a time: independent sums fill the vector registers
                    x[i] += transition[j, i] * known[j]
            if not abs(outputs[0]) < limit:
                return False
        return True

    return loop


@cached
def control(numerator, denominator, w, error):  # type: ignore[no-untyped-def]
    """One sample of C(z) in transposed direct form II."""
    value = numerator[0] * error + w[0]
    for i in range(1, w.size):
        w[i - 1] = numerator[i] * error - denominator[i] * value + w[i]
    return value


@njit  # cached as part of the loop
def solve(law, a, gain, step, z, contact, arguments):  # type: ignore[no-untyped-def]
    """Find the force at the step's end: the root of r(y) = y - a + gain*f(y), whose slope is 1 at least."""
    now = int(contact[3])
    y = a - gain * (2.0 * contact[0] - contact[4])
    force = law(z[now], y - contact[1], step, z[1 - now], *arguments)
    residual = y - a + gain * force
    slope = 1.0 + gain * contact[2]
    low, high = -np.inf, np.inf
    for _ in range(60):
        if abs(residual) <= 1e-7 * abs(y - contact[1]) + 1e-17:
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
        force = law(z[now], trial - contact[1], step, z[1 - now], *arguments)
        fresh = trial - a + gain * force
        slope = max((fresh - residual) / (trial - y), 1.0)
        y, residual = trial, fresh
    if y != contact[1]:
        contact[2] = max((force - contact[0]) / (y - contact[1]), 0.0)
    contact[4], contact[0], contact[1], contact[3] = contact[0], force, y, 1 - now
    return force
