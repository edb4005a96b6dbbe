"""The steps of a sample: at the end of each one, the friction forces of all contacts are found together.

At the end of a step the displacements are y = a - G f(y): a is what they would be without the forces there, and G what
these take away [m/N], a small matrix that is symmetric and not negative for contacts on one machine. Each law rises
with its own displacement alone. For one contact this is one equation; see `fraexp.kernels.friction_step`.
"""

from collections.abc import Callable

import numpy as np

from fraexp.kernels.addresses import DOUBLE_BYTES
from fraexp.kernels.decorators import COMPILER_OPTIONS, compiled
from fraexp.kernels.friction_step import make_explicit_step, make_implicit_step, make_set_valued_step
from fraexp.kernels.guards import GUARD_ROWS
from fraexp.kernels.lane_layout import LaneLayout
from fraexp.kernels.lanes import LaneRows
from fraexp.kernels.law import Law
from fraexp.kernels.law_arguments import LawArgument
from fraexp.kernels.observed_law import CALL_HALF, FRICTION, make_observed
from fraexp.kernels.stick_slip import (
    CONTACT_DISPLACEMENT,
    CONTACT_FORCE,
    CONTACT_PREVIOUS_FORCE,
    CONTACT_ROWS,
    CONTACT_STIFFNESS,
    TRIAL,
    TRIAL_FORCE,
    ContactStep,
    make_stick_slip,
)

SampleSteps = tuple[
    LaneRows, LaneRows, LaneRows, int, LaneRows, int, int, int, float, tuple[LawArgument, ...], LaneRows
]
"""What the steps of a sample take: the linear part of the displacements, compliances, durations of the steps, their
number, the contacts, address of the laws' memory, states in it, which half is current, duration of each step where they
are equal [s], the laws' arguments, and the last call."""
MAX_TURNS = 1000
"""Turns of solving all contacts, each with the others' forces held."""


def make_steps(law: Law, is_set_valued: tuple[bool, ...], layout: LaneLayout, is_observed: bool) -> Callable[..., int]:
    """Return the function that takes all steps of a sample, and returns which half of the laws' memory is current."""
    if len(is_set_valued) > 1:
        return _make_coupled_steps(law, is_set_valued, layout)
    width, present_view, state_view = layout.width, layout.present_view, layout.state_view
    take_step = _step_maker(layout, *is_set_valued)(make_observed(law, FRICTION) if is_observed else law)

    @compiled(forceinline=True, **COMPILER_OPTIONS)
    def take_steps(sample: SampleSteps) -> int:
        linear, compliance, _, steps, contact, memory, states, current, time_step, arguments, last_call = sample
        half_bytes = DOUBLE_BYTES * width * (states + GUARD_ROWS)
        displacement, force = contact[CONTACT_DISPLACEMENT], contact[CONTACT_FORCE]
        previous_force, stiffness = contact[CONTACT_PREVIOUS_FORCE], contact[CONTACT_STIFFNESS]
        for j in range(steps):
            free_displacement = linear[j]
            for i in range(j):
                free_displacement += compliance[j * steps + i] * linear[i]  # which by now holds the force of step i
            gain = -compliance[j * steps + j]
            # A law must not write its state, because a step may be tried several times: it reads one half of the
            # memory and writes the other. The halves then change their roles, instead of being copied.
            if is_observed:
                last_call[CALL_HALF] = current
            z = present_view(memory + current * half_bytes, states)
            z_next = state_view(memory + (1 - current) * half_bytes, states)
            before = force, previous_force, displacement, stiffness
            next_force, displacement, stiffness = take_step(
                free_displacement, gain, (z, z_next, time_step, arguments), before
            )
            previous_force, force = force, next_force
            linear[j] = force
            current = 1 - current
        contact[CONTACT_DISPLACEMENT], contact[CONTACT_FORCE] = displacement, force
        contact[CONTACT_PREVIOUS_FORCE], contact[CONTACT_STIFFNESS] = previous_force, stiffness
        return current

    return take_steps


def _step_maker(layout: LaneLayout, is_set_valued: bool) -> Callable[[Law], Callable[..., tuple[float, ...]]]:
    if is_set_valued:
        return make_set_valued_step
    return make_explicit_step if layout.is_vectorised else make_implicit_step


def _make_coupled_steps(law: Law, is_set_valued: tuple[bool, ...], layout: LaneLayout) -> Callable[..., int]:
    """Return the steps of several contacts; their law takes the number of a contact first."""
    width, present_view, state_view = layout.width, layout.present_view, layout.state_view
    contacts = len(is_set_valued)
    if layout.is_vectorised:
        solve = _make_explicit_contacts(law, contacts)
    else:
        solve = _make_implicit_contacts(law, is_set_valued)
    # Only the steps of set-valued laws differ in length, and they have no lanes here.
    duration_of = _own_duration if any(is_set_valued) else _equal_duration

    @compiled(forceinline=True, **COMPILER_OPTIONS)
    def take_steps(sample: SampleSteps) -> int:
        linear, compliance, durations, steps, contact, memory, states, current, time_step, arguments, _ = sample
        half_bytes, row = DOUBLE_BYTES * width * (states + GUARD_ROWS), steps * contacts
        for j in range(steps):
            first = j * contacts
            for c in range(first, first + contacts):
                free_displacement = linear[c]
                for i in range(first):
                    free_displacement += compliance[c * row + i] * linear[i]  # which by now holds a force
                linear[c] = free_displacement
            z = present_view(memory + current * half_bytes, states)
            z_next = state_view(memory + (1 - current) * half_bytes, states)
            duration = duration_of(durations, j, time_step)
            solve((linear, first, compliance, row, contact, z, z_next, duration, arguments))
            for c in range(contacts):
                at = c * CONTACT_ROWS
                contact[at + CONTACT_PREVIOUS_FORCE] = contact[at + CONTACT_FORCE]
                contact[at + CONTACT_FORCE] = contact[at + TRIAL_FORCE]
                contact[at + CONTACT_DISPLACEMENT] = contact[at + TRIAL]
                linear[first + c] = contact[at + TRIAL_FORCE]
            current = 1 - current
        return current

    return take_steps


@compiled(forceinline=True)
def _own_duration(durations: LaneRows, step: int, time_step: float) -> float:
    return durations[step]


@compiled(forceinline=True)
def _equal_duration(durations: LaneRows, step: int, time_step: float) -> float:
    return time_step


@compiled(forceinline=True, **COMPILER_OPTIONS)
def _predict(linear: LaneRows, first: int, compliance: LaneRows, row: int, contact: LaneRows, contacts: int) -> None:
    """Set the trial displacements to those that the extrapolated forces give."""
    for c in range(contacts):
        y = linear[first + c]
        for k in range(contacts):
            at = k * CONTACT_ROWS
            extrapolated = 2.0 * contact[at + CONTACT_FORCE] - contact[at + CONTACT_PREVIOUS_FORCE]
            y += compliance[(first + c) * row + first + k] * extrapolated
        contact[c * CONTACT_ROWS + TRIAL] = y


@compiled(forceinline=True)
def _no_stick_slip(step: ContactStep) -> None:
    return None


def _make_explicit_contacts(law: Law, contacts: int) -> Callable[..., None]:
    """Return the step of several contacts in lanes: each law once, at the predicted displacement."""

    @compiled(forceinline=True, **COMPILER_OPTIONS)
    def solve(step: ContactStep) -> None:
        linear, first, compliance, row, contact, z, z_next, time_step, arguments = step
        _predict(linear, first, compliance, row, contact, contacts)
        for c in range(contacts):
            at = c * CONTACT_ROWS
            moved = contact[at + TRIAL] - contact[at + CONTACT_DISPLACEMENT]
            contact[at + TRIAL_FORCE] = law(c, z, moved, time_step, z_next, arguments)

    return solve


def _make_implicit_contacts(law: Law, is_set_valued: tuple[bool, ...]) -> Callable[..., None]:
    """Return the step of several contacts of one machine: each is solved in turn, until none moves any more.

    As G is symmetric and no law falls with its displacement, the equations say where a convex function is least. It
    falls with each contact that is solved (coordinate descent), so that this ends at the one solution from anywhere.
    Contacts whose friction jumps at rest are solved together, and count as one in this.
    """
    contacts = len(is_set_valued)
    stick_slip = make_stick_slip(law, is_set_valued) if any(is_set_valued) else _no_stick_slip

    @compiled(forceinline=True, **COMPILER_OPTIONS)
    def at_contact(
        z: LaneRows, dy: float, dt: float, z_next: LaneRows, c: int, arguments: tuple[LawArgument, ...]
    ) -> float:
        return law(c, z, dy, dt, z_next, arguments)

    implicit_step = make_implicit_step(at_contact)

    @compiled(forceinline=True, **COMPILER_OPTIONS)
    def solve(step: ContactStep) -> None:
        linear, first, compliance, row, contact, z, z_next, time_step, arguments = step
        for c in range(contacts):
            at = c * CONTACT_ROWS
            contact[at + TRIAL] = np.inf
            contact[at + TRIAL_FORCE] = 2.0 * contact[at + CONTACT_FORCE] - contact[at + CONTACT_PREVIOUS_FORCE]
        for _ in range(MAX_TURNS):
            is_moving = False
            stick_slip(step)
            for c in range(contacts):
                if is_set_valued[c]:
                    continue
                at, here = c * CONTACT_ROWS, (first + c) * row + first
                free_displacement, trial = linear[first + c], contact[at + TRIAL]
                for k in range(contacts):
                    if k != c:
                        free_displacement += compliance[here + k] * contact[k * CONTACT_ROWS + TRIAL_FORCE]
                force, displacement = contact[at + CONTACT_FORCE], contact[at + CONTACT_DISPLACEMENT]
                before = force, 2.0 * force - contact[at + TRIAL_FORCE], displacement, contact[at + CONTACT_STIFFNESS]
                given = z, z_next, time_step, (c, arguments)
                next_force, y, stiffness = implicit_step(free_displacement, -compliance[here + c], given, before)
                contact[at + TRIAL], contact[at + TRIAL_FORCE] = y, next_force
                contact[at + CONTACT_STIFFNESS] = stiffness
                is_moving = is_moving or abs(y - trial) > 1e-7 * abs(y - displacement) + 1e-17
            if not is_moving:
                break

    return solve
