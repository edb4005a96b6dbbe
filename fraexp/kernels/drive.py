"""Friction force along prescribed displacements: as many side by side as there are lanes."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from fraexp.kernels.lanes import WIDTH
from fraexp.kernels.law import Law, cached, call
from fraexp.kernels.loop import bound, bound_argument, bound_state, get_number, part, put_number, taken_from
from fraexp.kernels.storage import stored, zeros

PASSES = 500
"""Times that a periodic record is run through at most."""
CLOSED = 1e-10
"""Change of the force from one pass to the next, relative to the greatest force, that counts as periodic."""
FOREVER = 1 << 62
LEAD, PASS, IDLE = range(3)
JOB, STAGE, AT, LEFT, DONE = range(5)


class Records(NamedTuple):
    """Displacements, one after another: of each a lead-in from rest, then the record, then its first value again."""

    displacement: np.ndarray
    """All samples [m], and a place for lanes that have nothing to do."""
    begin: np.ndarray
    """First sample of each lead-in, shape (records,)."""
    lead_in: np.ndarray
    """Samples of each lead-in."""
    size: np.ndarray
    """Samples of each record."""
    passes: np.ndarray
    """Times that each record is run through at most: once, or until its force repeats itself."""
    lead_in_step: np.ndarray
    """Time step of each lead-in [s]."""
    step: np.ndarray
    """Time step of each record [s]."""


def drive(law: Law, arguments: Any, states: int, motions: Sequence[Any], wide: bool) -> list[np.ndarray]:
    """Return the force [N] along each motion (displacement, time step, periodic, lead-in, its time step).

    It starts from the state at rest, or from where the lead-in left it; a periodic one is run through again until its
    force repeats itself, from its end to its beginning the displacement moves by their difference.
    """
    width = WIDTH if wide else 1
    records = _records(motions)
    force = np.empty_like(records.displacement)
    counters = np.zeros((width, 5), dtype=np.int64)
    counters[:, STAGE] = IDLE
    z, motion = zeros(2 * states, wide), zeros(3, wide)
    call(_make_drive, law, tuple(records), stored(arguments, wide), states, z, motion, counters, force)
    first = records.begin + records.lead_in
    return [force[begin : begin + size] for begin, size in zip(first, records.size, strict=True)]


def _records(motions: Sequence[Any]) -> Records:
    parts, begin, used = [], [], 0
    for displacement, _, _, lead_in, _ in motions:
        parts += [lead_in, displacement, displacement[:1]]
        begin.append(used)
        used += lead_in.size + displacement.size + 1
    columns = list(zip(*motions, strict=True))
    parts.append(np.zeros(max(part.size for part in parts) + 1))
    return Records(
        np.concatenate(parts, dtype=float),
        np.array(begin),
        np.array([lead_in.size for lead_in in columns[3]]),
        np.array([displacement.size for displacement in columns[0]]),
        np.where(columns[2], PASSES, 1),
        np.array(columns[4], dtype=float),
        np.array(columns[1], dtype=float),
    )


def _make_drive(law: Law, fingerprint: str) -> Any:
    def drive(records, arguments_of, states, z_of, motion_of, counters, force):  # type: ignore[no-untyped-def]
        _ = fingerprint  # a cell of the closure: an edited law is compiled again
        displacement = records[0]
        width, now, following = counters.shape[0], 0, 0
        place = np.zeros(width, np.int64)
        z, motion = bound_state(z_of), bound(motion_of)  # motion: displacement, time step, force
        arguments = bound_argument(arguments_of, motion)
        while True:
            rows, busy = FOREVER, False
            for lane in range(width):
                while counters[lane, LEFT] == 0:
                    following = _turn(lane, following, records, counters, z_of, motion_of, force)
                rows = min(rows, counters[lane, LEFT])
                place[lane] = counters[lane, AT]
                busy = busy or counters[lane, STAGE] != IDLE
            if not busy:
                return
            for row in range(rows):
                reached = taken_from(displacement, place, row, motion)
                z_now, z_next = part(z, now * states, states), part(z, (1 - now) * states, states)
                motion[2] = law(z_now, reached - motion[0], motion[1], z_next, *arguments)
                motion[0] = reached
                now = 1 - now
                for lane in range(width):
                    force[place[lane] + row] = get_number(motion_of, 2, lane)
            for lane in range(width):
                counters[lane, LEFT] -= rows
                counters[lane, AT] += rows if counters[lane, STAGE] != IDLE else 0

    return cached(drive, error_model="numpy")


@njit
def _turn(lane, following, records, counters, z, motion, force):  # type: ignore[no-untyped-def]
    """Take a lane from its lead-in to its record, to another pass of it, or to the next one; return the one after."""
    displacement, begin, lead_in, size, passes, lead_in_step, step = records
    job, stage = counters[lane, JOB], counters[lane, STAGE]
    if stage == LEAD:
        first = begin[job] + lead_in[job]
        if lead_in[job] == 0:
            put_number(motion, 0, lane, displacement[first])
        put_number(motion, 1, lane, step[job])
        counters[lane, STAGE], counters[lane, AT], counters[lane, LEFT] = PASS, first, size[job]
        if passes[job] > 1:
            counters[lane, LEFT] += 1
        return following
    if stage == PASS:
        counters[lane, DONE] += 1
        first = begin[job] + lead_in[job]
        begun = counters[lane, DONE] > 1 or lead_in[job] > 0  # before, the force came from rest
        if counters[lane, DONE] < passes[job] and not (begun and _closed(force, first, size[job])):
            force[first] = force[first + size[job]]
            counters[lane, AT], counters[lane, LEFT] = first + 1, size[job]
            return following
    for row in range(z.shape[0]):
        put_number(z, row, lane, 0.0)
    if following == begin.size:
        counters[lane, STAGE], counters[lane, LEFT] = IDLE, FOREVER
        counters[lane, AT] = begin[-1] + lead_in[-1] + size[-1] + 1
        return following
    counters[lane, JOB], counters[lane, STAGE], counters[lane, DONE] = following, LEAD, 0
    counters[lane, AT], counters[lane, LEFT] = begin[following], lead_in[following]
    put_number(motion, 0, lane, displacement[begin[following]])
    put_number(motion, 1, lane, lead_in_step[following])
    return following + 1


@njit
def _closed(force, first, size):  # type: ignore[no-untyped-def]
    """Return whether the force at the end of a pass is that at its beginning."""
    greatest = 0.0
    for k in range(first, first + size):
        greatest = max(greatest, abs(force[k]))
    return abs(force[first + size] - force[first]) <= CLOSED * greatest
