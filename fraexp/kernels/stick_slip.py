"""Several contacts whose friction jumps at rest: how they slide, stop, stick and break away within a step.

Without friction the velocities are linear in time within a step. Between two events, a stop or a break-away, the forces
are constant: those of contacts that slide are known, and those of contacts at rest are whatever holds them, within
limits. These are found together (a linear complementarity problem), because a contact that gives way loads the others.
The mean force over the step has the exact impulse of such a motion, as that of one contact has in
`fraexp.kernels.friction_step`.
"""

from collections.abc import Callable

from fraexp.kernels.decorators import COMPILER_OPTIONS, compiled
from fraexp.kernels.friction_step import REST_DISPLACEMENT_M
from fraexp.kernels.lanes import LaneRows
from fraexp.kernels.law import Law
from fraexp.kernels.law_arguments import LawArgument

CONTACT_FORCE, CONTACT_DISPLACEMENT, CONTACT_STIFFNESS, CONTACT_PREVIOUS_FORCE = range(4)
"""Rows of a contact, at the last step's end: friction force [N], displacement [m], or velocity [m/s] where friction
jumps at rest, local stiffness [N/m], and the force a step before [N]."""
TRIAL, TRIAL_FORCE = range(4, 6)
"""Rows of a contact while a step is solved: displacement [m], or velocity [m/s], and force [N] that are tried."""
CONTACT_ROWS = 6
SLIDING_ROWS = 8
"""Further rows of a contact for stick and slip, beside a row of a matrix."""
MAX_INTERVALS = 50
"""Intervals between events in a step."""
MAX_PIVOTS = 200
"""Times that a contact may be taken for stuck or for sliding while the forces of one interval are found."""
SMALLEST_PIVOT = 1e-9
"""Compliance of a contact, over its compliance alone, if the others stick: less where several hold one body."""
ROUNDING = 1e-12
"""Excess of a force over its limit, relative to it, and part of a sum of velocities, that is rounding."""


ContactStep = tuple[LaneRows, int, LaneRows, int, LaneRows, LaneRows, LaneRows, float, tuple[LawArgument, ...]]
"""A step of several contacts: the linear part of the displacements and where the step's begin, the compliances and the
length of their rows, the contacts, present and next state of the law, duration of the step [s], the law's arguments."""


def contact_rows(contacts: int) -> int:
    """Return the rows of the memory of contacts."""
    return contacts * (CONTACT_ROWS + SLIDING_ROWS + contacts)


def make_stick_slip(law: Law, is_set_valued: tuple[bool, ...]) -> Callable[..., None]:
    """Return what sets the trial velocity and the mean force of each set-valued contact, with the others' forces held.

    `law` takes the number of a contact first.
    """
    contacts = len(is_set_valued)
    places = tuple(c for c in range(contacts) if is_set_valued[c])
    velocity, change, mean, push, force, low, high, _ = (contacts * (CONTACT_ROWS + row) for row in range(SLIDING_ROWS))
    balance = _make_balance(places, contacts)

    @compiled(forceinline=True, **COMPILER_OPTIONS)
    def set_limits(
        contact: LaneRows, z: LaneRows, z_next: LaneRows, time_step: float, arguments: tuple[LawArgument, ...]
    ) -> None:
        for c in places:
            v, moved = contact[velocity + c], contact[mean + c] * time_step
            if v >= 0.0:
                contact[high + c] = law(c, z, max(moved, REST_DISPLACEMENT_M), time_step, z_next, arguments)
            if v <= 0.0:
                contact[low + c] = law(c, z, -max(-moved, REST_DISPLACEMENT_M), time_step, z_next, arguments)
            if v > 0.0:
                contact[low + c] = contact[high + c]
            elif v < 0.0:
                contact[high + c] = contact[low + c]

    @compiled(forceinline=True, **COMPILER_OPTIONS)
    def begin(linear: LaneRows, first: int, compliance: LaneRows, row: int, contact: LaneRows) -> None:
        for c in places:
            at, free_velocity = c * CONTACT_ROWS, linear[first + c]
            for k in range(contacts):
                if not is_set_valued[k]:
                    given = contact[k * CONTACT_ROWS + TRIAL_FORCE]
                    free_velocity += compliance[(first + c) * row + first + k] * given
            contact[velocity + c] = contact[at + CONTACT_DISPLACEMENT]
            contact[push + c] = free_velocity - contact[velocity + c]
            contact[at + TRIAL_FORCE] = 0.0

    @compiled(forceinline=True, **COMPILER_OPTIONS)
    def next_event(contact: LaneRows, left: float) -> float:
        """Return the part of a step until a contact stops, or all that is left of it."""
        until = left
        for c in places:
            if contact[velocity + c] * contact[change + c] < 0.0:
                until = min(until, -contact[velocity + c] / contact[change + c])
        return until

    @compiled(**COMPILER_OPTIONS)
    def stick_slip(step: ContactStep) -> None:
        linear, first, compliance, row, contact, z, z_next, time_step, arguments = step
        begin(linear, first, compliance, row, contact)
        left = until = 1.0
        for _ in range(MAX_INTERVALS):
            for c in places:
                contact[mean + c] = contact[velocity + c]
            for _ in range(2):  # with the forces at the interval's beginning, then with those at its mean velocity
                set_limits(contact, z, z_next, time_step, arguments)
                balance(compliance, first * row + first, row, contact)
                until = next_event(contact, left)
                for c in places:
                    contact[mean + c] = contact[velocity + c] + 0.5 * until * contact[change + c]
            for c in places:
                v, a = contact[velocity + c], contact[change + c]
                contact[c * CONTACT_ROWS + TRIAL_FORCE] += until * contact[force + c]
                contact[velocity + c] = 0.0 if v * a < 0.0 and -v / a <= until else v + until * a
            left -= until
            if not left > 0.0:
                break
        for c in places:
            contact[c * CONTACT_ROWS + TRIAL] = contact[velocity + c]

    return stick_slip


def _make_balance(places: tuple[int, ...], contacts: int) -> Callable[..., None]:
    """Return what finds the forces, and the velocities' changes over a step, of contacts between limits.

    A contact whose limits are one force slides. The others are at rest: the force of one that sticks keeps it so, and
    that of one that breaks away is the limit on that side. Murty's method: the first contact that does not fit its side
    changes it, which ends for any matrix with positive principal minors (K. G. Murty, Linear Algebra and its
    Applications 5, 1972).
    """
    _, change, _, push, force, low, high, side = (contacts * (CONTACT_ROWS + row) for row in range(SLIDING_ROWS))
    matrix, last_first = contacts * (CONTACT_ROWS + SLIDING_ROWS), places[::-1]

    @compiled(forceinline=True, **COMPILER_OPTIONS)
    def solve(compliance: LaneRows, first: int, row: int, contact: LaneRows) -> None:
        """Set the forces: of contacts that stick those that hold them, of others their limits, by elimination."""
        for c in places:
            here, sticks = matrix + c * contacts, contact[side + c] == 0.0
            limit = contact[high + c] if contact[side + c] > 0.0 else contact[low + c]
            contact[force + c] = contact[push + c] if sticks else limit
            for k in places:
                unit = 1.0 if k == c else 0.0
                contact[here + k] = -compliance[first + c * row + k] if sticks else unit
        for p in places:
            here, own = matrix + p * contacts, -compliance[first + p * row + p]
            contact[here + p] = max(contact[here + p], SMALLEST_PIVOT * own)
            for c in places:
                if c > p:
                    below = matrix + c * contacts
                    factor = contact[below + p] / contact[here + p]
                    contact[force + c] -= factor * contact[force + p]
                    for k in places:
                        contact[below + k] -= factor * contact[here + k]
        for p in last_first:
            here = matrix + p * contacts
            for k in places:
                if k > p:
                    contact[force + p] -= contact[here + k] * contact[force + k]
            contact[force + p] /= contact[here + p]

    @compiled(forceinline=True, **COMPILER_OPTIONS)
    def set_change(compliance: LaneRows, first: int, row: int, contact: LaneRows, c: int) -> bool:
        """Set the change of a contact's velocity by all forces, and return whether it fits its side.

        Where several contacts hold one body, that of a contact at its limit may be 0 but for rounding, of either sign.
        """
        a, size = contact[push + c], abs(contact[push + c])
        for k in places:
            given = compliance[first + c * row + k] * contact[force + k]
            a, size = a + given, size + abs(given)
        slides, way = contact[high + c] == contact[low + c], contact[side + c]
        contact[change + c] = a if slides or way * a > 0.0 else 0.0
        return slides or way * a >= -ROUNDING * size

    @compiled(forceinline=True, **COMPILER_OPTIONS)
    def fitting_side(contact: LaneRows, c: int, is_fitting: bool) -> float:
        """Return the side of a contact, another one if it does not fit."""
        f, rounding = contact[force + c], ROUNDING * (contact[high + c] - contact[low + c])
        if contact[side + c] != 0.0:
            return contact[side + c] if is_fitting else 0.0
        return 1.0 if f > contact[high + c] + rounding else -1.0 if f < contact[low + c] - rounding else 0.0

    @compiled(**COMPILER_OPTIONS)
    def balance(compliance: LaneRows, first: int, row: int, contact: LaneRows) -> None:
        for c in places:
            contact[side + c] = 0.0 if contact[high + c] > contact[low + c] else 1.0
        for _ in range(MAX_PIVOTS):
            solve(compliance, first, row, contact)
            is_done = True
            for c in places:
                way = fitting_side(contact, c, set_change(compliance, first, row, contact, c))
                if is_done and way != contact[side + c]:
                    contact[side + c], is_done = way, False
            if is_done:
                break

    return balance
