"""Checks of friction models: the law as a function, and along whole motions, on which loop and observer rely."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st
from hypothesis import target
from hypothesis.strategies import SearchStrategy
from numpy.typing import ArrayLike, NDArray

from fraexp.components.kinds import Component, FrictionModel
from fraexp.components.parameters import TYPICAL, unit_of, value_bounds
from fraexp.testing.conformance_check import NotApplicableError, ViolationError, require
from fraexp.testing.examples import is_number, strategy, try_build
from fraexp.testing.walk import (
    SLOW_TIME_STEP_S,
    Drive,
    Interpreted,
    Walk,
    back_and_forth_strategy,
    breakaway_displacement,
    describe_component,
    loop_strategy,
)

SPEEDS_M_S = np.geomspace(1e-15, 10.0, 17)
"""Speeds from rest to beyond those of any axis, one per decade."""
REST, SLOW = 0, 3
"""Indices of two speeds near rest, a factor of 1000 apart."""
TIME_STEPS_S = (1e-2, 1e-5)
"""Steps that give one force at one velocity."""
TOLERANCE = 1e-6
"""Difference of forces, relative to the greatest one, that rounding of dy/dt can cause."""


def continuous_at_rest(model: FrictionModel) -> None:
    """Raise ViolationError if the force at the slowest motion is not far smaller than at a faster one."""
    forces = _forces(model, TIME_STEPS_S[0])
    require(
        abs(forces[REST]) <= 0.5 * abs(forces[SLOW]) + TOLERANCE * np.max(np.abs(forces)),
        f"it jumps at rest, to {forces[REST]:.4g} N at {SPEEDS_M_S[REST]:g} m/s; expected a transition, such as "
        "tanh(v / vs), a spring at rest, which needs a state, or velocity_law, as coulomb has it",
    )


def function_of_velocity(model: FrictionModel) -> None:
    """Raise ViolationError if steps of another length give another force at the same velocity."""
    coarse, fine = (_forces(model, time_step) for time_step in TIME_STEPS_S)
    worst = int(np.argmax(np.abs(coarse - fine)))
    require(
        abs(coarse[worst] - fine[worst]) <= TOLERANCE * float(np.max(np.abs(fine))),
        f"at {SPEEDS_M_S[worst]:.3g} m/s the force is {coarse[worst]:.6g} N with steps of {TIME_STEPS_S[0]:g} s, "
        f"{fine[worst]:.6g} N with steps of {TIME_STEPS_S[1]:g} s; expected, without states, a function of dy / dt",
    )


def _forces(model: FrictionModel, time_step: float) -> NDArray[np.float64]:
    """Return the force [N] at each speed, from steps of one length [s]."""
    return np.array([Walk(model, time_step).move(speed * time_step) for speed in SPEEDS_M_S.tolist()])


STEPS = (200, 3200, 51200)
"""Steps per period, in which errors and jumps of the force must shrink."""
QUICK_STEPS = (100, 800, 3200)
"""Steps per period for plain Python, which is slower."""
RESOLVING = 16
"""Factor on the steps that resolves what coarse and fine steps both missed."""
MAX_MISSED = 0.01
"""Greatest rms error, relative to the force, that can come from something too short for the steps."""
FINER, QUICK_FINER = 16, 2
"""Parts into which the steps of a closed path are divided, so that its energy is that of the law."""
INTEGRATION_ORDER_RATIO = 8.0
"""Factor by which the error of the integration falls at least with four times as many steps."""
ENDURANCE_REVERSALS, ENDURANCE_STEPS = 5000, 8
"""Reversals while the motion grows, and as many while it shrinks; steps from one to the next."""
ENDURANCE_SIZES = (1e-3, 1e3)
"""Smallest and largest motion, in breakaway displacements."""
ENERGY_TOLERANCE = 1e-3
"""Energy that a closed path may release, relative to the work done along it: the error that the steps may cause."""


@dataclass(frozen=True)
class Wave:
    """A friction model and a smooth periodic motion: a sine with a harmonic."""

    model: FrictionModel
    amplitude: float
    """In the model's breakaway displacements."""
    harmonic: float
    """Third harmonic's share of the fundamental."""
    period: float
    """Duration [s]."""
    steps: tuple[int, int, int] = STEPS
    """Steps per period: coarse, fine, and so many that the result counts as exact."""

    def record(self, steps: int) -> NDArray[np.float64]:
        """Return one period of the displacement [m], shape (steps,)."""
        phase = 2 * np.pi * np.arange(steps) / steps
        shape = np.sin(phase) + self.harmonic * np.sin(3 * phase + 1.0)
        return self.amplitude * breakaway_displacement(self.model) * shape

    def force(self, steps: int, periodic: bool = True) -> NDArray[np.float64]:
        """Return the force [N] over the period, shape (steps,)."""
        return self.model.force(self.record(steps), self.period / steps, periodic=periodic)

    def __str__(self) -> str:
        """One line for a report."""
        length = self.amplitude * breakaway_displacement(self.model)
        wave = f"a sine of {length:.3g} m, period {self.period:g} s, third {self.harmonic:g}"
        return f"{describe_component(self.model)}; {wave}"


def closed_path_strategy(component: type[Component]) -> SearchStrategy[Drive]:
    """Return the strategy of closed paths for a friction model: short ones for a law in plain Python."""
    return back_and_forth_strategy(component) if issubclass(component, Interpreted) else loop_strategy(component)


def wave_strategy(component: type[Component]) -> SearchStrategy[Wave]:
    """Return the strategy of waves of a friction model."""
    return st.builds(
        Wave,
        strategy(component),
        st.sampled_from([4.0, 1.0, 0.25, 20.0]),
        st.sampled_from([0.0, 0.3, 0.9]),
        st.sampled_from([1.0, 0.1, 10.0, 0.01]),
        st.just(QUICK_STEPS if issubclass(component, Interpreted) else STEPS),
    )


def continuous(wave: Wave) -> None:
    """The force does not jump at a reversal: its steps shrink with the steps of the motion."""
    if wave.model.state_size == 0:
        continuous_at_rest(wave.model)
        return
    jumps = []
    coarse, fine, _ = wave.steps
    for steps in (coarse, fine):
        record, force = wave.record(steps), wave.force(steps)
        turning = np.flatnonzero(np.diff(np.sign(np.diff(record))) != 0)
        near = np.unique(np.clip(turning[:, None] + np.arange(-1, 4), 1, steps - 1))
        jumps.append(float(np.max(np.abs(np.diff(force)[near - 1]), initial=0.0)))
    scale = float(np.max(np.abs(force))) or 1.0
    jump = f"{jumps[0]:.4g} N with {coarse} steps, {jumps[1]:.4g} N with {fine}"
    require(jumps[1] <= 0.5 * jumps[0] + FORCE_TOLERANCE * scale, f"it jumps at a reversal by {jump}")


def refinement(wave: Wave) -> None:
    """Smaller steps of the same motion converge to one force; a law without rate effects gives it with any steps."""
    if wave.model.state_size == 0:
        function_of_velocity(wave.model)
        return
    errors = _step_errors(wave, wave.steps)
    coarse, fine, _ = wave.steps
    if not _converges(errors) and errors[0] <= MAX_MISSED:
        # A steep Stribeck curve is a peak of the force at each reversal, so short that neither number of steps shows
        # it: their errors are alike until the steps resolve it.
        coarse, fine, exact = (RESOLVING * steps for steps in wave.steps)
        errors = _step_errors(wave, (coarse, fine, exact))
    change = f"they differ by {errors[0]:.2e} of the force with {coarse} steps, by {errors[1]:.2e} with {fine}"
    require(_converges(errors), f"smaller steps do not converge: {change}")


def _step_errors(wave: Wave, counts: Sequence[int]) -> list[float]:
    """Return the rms errors with all but the last of these numbers of steps, relative to the greatest force."""
    forces = [wave.force(steps, periodic=False)[:: steps // counts[0]] for steps in counts]
    scale = float(np.max(np.abs(forces[-1]))) or 1.0
    return [float(np.sqrt(np.mean((force - forces[-1]) ** 2))) / scale for force in forces[:-1]]


def _converges(errors: Sequence[float]) -> bool:
    return errors[1] <= max(0.5 * errors[0], FORCE_TOLERANCE)


def energy(drive: Drive) -> None:
    """The law is passive: along a closed path ∮ f dy ≥ 0."""
    finer = QUICK_FINER if isinstance(drive.model, Interpreted) else FINER
    gained, effort = _released_energy(drive, finer)
    target(gained / effort if effort else 0.0)
    if gained > ENERGY_TOLERANCE * effort:
        # Long steps one way and short ones the other integrate a curved force differently. That error falls with the
        # square of the step; what a law gives does not.
        finest, _ = _released_energy(drive, 4 * finer)
        require(
            finest <= gained / INTEGRATION_ORDER_RATIO,
            f"a closed path releases {gained:.4g} J; the work along it is {effort:.4g} J",
        )


def _released_energy(drive: Drive, finer: int) -> tuple[float, float]:
    """Return the energy [J] that a closed path releases, and the work along it, in steps divided by `finer`."""
    at = np.arange(finer * drive.record.size) / finer
    record = np.interp(at, np.arange(drive.record.size + 1), [*drive.record, 0.0])
    step = drive.time_step / finer
    force = drive.model.force(record, step, periodic=True)
    dy = np.roll(record, -1) - record
    viscous = drive.model.viscous * float(np.sum(dy**2)) / step
    work = (force + np.roll(force, -1)) / 2 * dy
    effort = float(np.sum(np.abs(work))) + viscous
    return -(float(np.sum(work)) + viscous), effort


def endurance(model: FrictionModel) -> None:
    """The force is finite, and the law stays within its memory, through thousands of reversals of all sizes."""
    length = breakaway_displacement(model)
    ends = (
        length
        * np.geomspace(*ENDURANCE_SIZES, ENDURANCE_REVERSALS)
        * np.where(np.arange(ENDURANCE_REVERSALS) % 2, -1, 1)
    )
    ends = np.concatenate([ends, ends[::-1]])
    record = np.interp(np.arange(ENDURANCE_STEPS * ends.size) / ENDURANCE_STEPS, np.arange(ends.size), ends)
    for time_step in (1e-3, 1e-5):
        forces = model.force(record - record[0], time_step)
        wrong = np.flatnonzero(~np.isfinite(forces))
        if wrong.size:
            dy = np.diff(record, prepend=record[0])[wrong[0]]
            require(False, f"the force is {forces[wrong[0]]} N after {wrong[0]} steps, the last of {dy:.3g} m")


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
        start = abs(value) or TYPICAL.get(unit_of(info), 1.0)
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
