"""Checks of friction models that look at the law as a function: what loop and observer rely on."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fraexp.components.kinds import FrictionModel
from fraexp.testing.conformance_check import NotApplicableError, ViolationError, require
from fraexp.testing.examples import is_number, try_build, typical_magnitude, value_bounds
from fraexp.testing.walk import SLOW_TIME_STEP_S, Drive, Walk, breakaway_displacement

FORCE_TOLERANCE = 1e-9
"""Forces that differ by less, relative to the greatest one, count as equal."""
MAX_OVERSTATEMENT = 4.0
"""Greatest factor by which the stiffness may be overstated: a reversal from full slip may double that at rest."""
HARDENING = 2.0
"""Factor on the slope at rest beyond which a law hardens: a reversal from full slip may double the slope."""
EXTREME_FACTOR = 1e6
"""Factor on a parameter without a bound."""


def finite(drive: Drive) -> None:
    """The force is finite on every path, also for steps of 0 m and for very long ones."""
    _require_finite(drive.force, drive.record)
    walk = Walk(drive.model, drive.time_step)
    for dy in (0.0, 0.0, 1e3 * drive.length, 0.0, -1e3 * drive.length, -0.0, 1e-300):
        force = walk.move(dy)
        require(np.isfinite(force), f"the force is {force} N after a step of {dy:.3g} m")


def rest(model: FrictionModel) -> None:
    """A model that has never moved has no force."""
    for time_step in (1e-5, 1.0):
        force = Walk(model, time_step).move(0.0)
        require(force == 0, f"the force is {force:.4g} N before anything has moved")


def limits(model: FrictionModel) -> None:
    """The force is finite with each parameter at its declared bounds."""
    for name, info in type(model).model_fields.items():
        value = getattr(model, name)
        if not is_number(info) or value is None:
            continue
        low, high = value_bounds(info)
        start = abs(value) or typical_magnitude(info)
        for extreme in (
            low if low is not None else -start * EXTREME_FACTOR,
            high if high is not None else start * EXTREME_FACTOR,
        ):
            other = try_build(type(model), {**dict(model), name: extreme})
            if other is None:
                continue
            try:
                path = breakaway_displacement(other) * np.array([0.0, 0.5, 3.0, 3.0, -2.0, EXTREME_FACTOR])
                forces = Walk(other, 1e-4).move_along(path)
            except ArithmeticError as error:
                raise ViolationError(f"with {name} = {extreme:.4g}: {type(error).__name__}: {error}") from None
            except ViolationError as violation:
                raise ViolationError(f"with {name} = {extreme:.4g}: {violation}") from None
            require(np.isfinite(forces).all(), f"with {name} = {extreme:.4g} the forces are {forces.tolist()} N")


def trial(drive: Drive) -> None:
    """A step leaves z unchanged: another step from there gives the same result as without it."""
    for walk, dy in drive.walks():
        before, expected = walk.z.copy(), walk.try_step(dy)
        for other in (-2 * dy, drive.length, 0.0):
            walk.try_step(other)
            changed = np.flatnonzero(walk.z != before)
            require(not changed.size, f"the law writes z{changed[:1].tolist()}; it may write only z_next")
        force, z_next = walk.try_step(dy)
        require(_have_same_bits(force, expected[0]), f"the same step gives {expected[0]!r} N, then {force!r} N")
        require(_have_same_bits(z_next, expected[1]), "the same step gives another memory when it is tried again")


def state_size(drive: Drive) -> None:
    """Every step writes all of z_next, and nothing beyond the declared size."""
    for walk, dy in drive.walks():
        for step in (dy, 0.0):
            _, z_next = walk.try_step(step)
            unwritten = np.flatnonzero(np.isnan(z_next))
            require(not unwritten.size, f"a step of {step:.3g} m leaves z_next{unwritten.tolist()} unwritten or NaN")


def pure(model: FrictionModel) -> None:
    """The law is a function of its arguments: no random numbers, no clock, no memory beside z, a bounded size."""
    model.check_law()


def compiled(drive: Drive) -> None:
    """The compiled law gives the same forces as plain Python, to the last bits."""
    forces = drive.model.force(drive.record, drive.time_step)
    different = np.flatnonzero(forces != drive.force)
    if different.size:
        at = different[0]
        raise ViolationError(f"step {at}: {forces[at]!r} N compiled, {drive.force[at]!r} N in plain Python")


def order(drive: Drive) -> None:
    """The force does not depend on other computations, before or in between."""
    first = drive.model.force(drive.record, drive.time_step)
    walk, other = Walk(drive.model, drive.time_step), Walk(drive.model, 3 * drive.time_step)
    interleaved = []
    for dy in np.diff(drive.record, prepend=0.0).tolist():
        interleaved.append(walk.move(dy))
        other.move(drive.length - 2 * dy)
    drive.model.force(-2 * drive.record[::-1], 3 * drive.time_step, periodic=True)
    again = drive.model.force(drive.record, drive.time_step)
    require(_have_same_bits(first, again), "a second computation gives another force")
    require(
        _have_same_bits(np.array(interleaved), drive.force), "the forces differ if another law is stepped in between"
    )


def present(drive: Drive) -> None:
    """The force of a step is that at its end: implicit, not held from the step before."""
    for walk, _ in drive.slow_copy().walks():
        small = drive.length / 64
        for dy in (small, -small):
            before, _ = walk.try_step(0.0)
            moved, z_next = walk.try_step(dy)
            later = Walk(drive.model, SLOW_TIME_STEP_S)
            later.z = z_next
            held, _ = later.try_step(0.0)
            change = max(abs(held - before), abs(moved - before))
            require(
                abs(held - moved) <= 0.2 * change + FORCE_TOLERANCE * drive.max_force,
                _late_force_reason(dy, moved, held),
            )


def _late_force_reason(dy: float, moved: float, held: float) -> str:
    return f"after a slow step of {dy:.3g} m the force is {moved:.6g} N, and {held:.6g} N once it stands still"


def monotone(drive: Drive) -> None:
    """A slow step, up to the breakaway displacement, gives no less force than a shorter one: one implicit solution."""
    slow = drive.slow_copy()
    steps = slow.length * np.concatenate([np.linspace(-1, 1, 25), np.geomspace(1e-6, 1e-2, 5)])
    steps.sort()
    for walk, _ in slow.walks():
        forces = np.array([walk.try_step(dy)[0] for dy in steps.tolist()])
        falls = np.flatnonzero(np.diff(forces) < -FORCE_TOLERANCE * slow.max_force)
        if falls.size:
            at = falls[0]
            numbers_ = (steps[at], steps[at + 1], forces[at], forces[at + 1])
            raise ViolationError("a slow step of {:.4g} m or {:.4g} m gives {:.6g} N or {:.6g} N".format(*numbers_))


def stiffness(drive: Drive) -> None:
    """`max_stiffness`, which determines the loop's step length, is the slope of the steepest slow step."""
    if drive.model.state_size == 0:
        raise NotApplicableError("without a state its force depends on the velocity alone, and has no stiffness")
    slow, declared, steepest = drive.slow_copy(), drive.model.max_stiffness, 0.0
    small = slow.length * 1e-4
    for walk, _ in slow.walks():
        base = walk.try_step(0.0)[0]
        steepest = max(steepest, *((walk.try_step(dy)[0] - base) / dy for dy in (small, -small)))
    slopes = f"a slope of {steepest:.5g} N/m; max_stiffness is {declared:.5g} N/m"
    if steepest > HARDENING * _slope_at_rest(slow) * (1 + 1e-6) and declared >= _slope_at_rest(slow):
        raise NotApplicableError(
            "its stiffness grows with the displacement: max_stiffness is that of the travel it has"
        )
    require(steepest <= declared * (1 + 1e-6) + FORCE_TOLERANCE * slow.max_force / small, slopes)
    require(
        declared <= MAX_OVERSTATEMENT * steepest,
        f"no slope above {steepest:.5g} N/m; max_stiffness is {declared:.5g} N/m",
    )


def _slope_at_rest(slow: Drive) -> float:
    """Return the slope of force over displacement at rest [N/m]."""
    small = slow.length * 1e-4
    return abs(Walk(slow.model, slow.time_step).move(small)) / small


def translation(drive: Drive) -> None:
    """The force depends only on displacement increments: the same path elsewhere gives the same force."""
    record = np.round(drive.record / (drive.length / 4096)) * 2.0**-30  # so that adding the offset is exact
    forces = drive.model.force(record, drive.time_step)
    moved = drive.model.force(record + 2.0**-4, drive.time_step)
    scale = float(np.max(np.abs(forces), initial=0.0))
    require(
        np.allclose(forces, moved, rtol=0, atol=FORCE_TOLERANCE * scale),
        "the force changes if the path begins at another position",
    )


def odd(drive: Drive) -> None:
    """The opposite path gives the opposite force."""
    mirrored = Walk(drive.model, drive.time_step).move_along(-drive.record)
    worst = int(np.argmax(np.abs(mirrored + drive.force)))
    agrees = np.allclose(mirrored, -drive.force, rtol=0, atol=FORCE_TOLERANCE * drive.max_force)
    require(agrees, f"step {worst}: {drive.force[worst]:.6g} N, and {mirrored[worst]:.6g} N on the opposite path")


def bound(drive: Drive) -> None:
    """The force stays within `force_bound`, where the model declares one."""
    most = drive.model.force_bound
    if most is None:
        raise NotApplicableError("it declares no force_bound")
    far = EXTREME_FACTOR * drive.length * np.array([0.0, 1.0, -1.0])
    for forces in (drive.force, drive.slow_copy().force, Walk(drive.model, SLOW_TIME_STEP_S).move_along(far)):
        greatest = float(np.max(np.abs(forces), initial=0.0))
        require(
            greatest <= most * (1 + FORCE_TOLERANCE), f"the force reaches {greatest:.6g} N; force_bound is {most:.6g} N"
        )


def _require_finite(forces: NDArray[np.float64], record: NDArray[np.float64]) -> None:
    """Raise ViolationError for the first force along a displacement record that is not finite."""
    wrong = np.flatnonzero(~np.isfinite(forces))
    if wrong.size:
        dy = np.diff(record, prepend=0.0)[wrong[0]]
        raise ViolationError(f"the force is {forces[wrong[0]]} N after a step of {dy:.3g} m")


def _have_same_bits(first: ArrayLike, second: ArrayLike) -> bool:
    return np.asarray(first, dtype=float).tobytes() == np.asarray(second, dtype=float).tobytes()
