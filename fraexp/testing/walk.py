"""A friction model and a path, as an example; and its law in plain Python, step by step."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

import numpy as np
from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy
from numpy.typing import NDArray

from fraexp.components.kinds import Component, FrictionModel, Motion
from fraexp.components.law_step import law_place, step_fault, step_text
from fraexp.testing.conformance_check import ViolationError
from fraexp.testing.examples import strategy

MAX_PASSES = 6
"""Maximum number of further passes through a periodic displacement."""
CLOSURE_TOLERANCE = 1e-10
"""Change of the force from one pass to the next, relative to the greatest force, that counts as periodic."""


class Interpreted:
    """Mixin for a friction model, placed before it: its forces are then those of the law in plain Python."""

    def forces(self: Any, motions: Sequence[Motion]) -> list[NDArray[np.float64]]:
        """Return the law's force [N] along each of several motions."""
        self.check_law()
        return [_interpreted_force(self, motion) for motion in motions]


@cache
def interpreted_class(component: type[Component]) -> type[Component]:
    """Return a component class that compiles nothing: the class itself, or of a friction model its interpreted form."""
    if not issubclass(component, FrictionModel):
        return component
    attributes = {
        "__doc__": component.__doc__,
        "__module__": component.__module__,
        "__qualname__": component.__qualname__,
    }
    metaclass: Any = type(component)
    subclass: type[Component] = metaclass(component.__name__, (Interpreted, component), attributes)
    return subclass


def _interpreted_force(model: FrictionModel, motion: Motion) -> NDArray[np.float64]:
    """Return the force [N] along a motion, as the compiled kernel does: from rest, until the force is periodic."""
    record, walk = np.asarray(motion.displacement, dtype=float), Walk(model, motion.lead_in_step)
    walk.move_along(motion.lead_in)
    walk.time_step = motion.time_step
    has_history = motion.lead_in.size > 0  # else the record begins at rest
    steps = np.diff(record, prepend=motion.lead_in[-1] if has_history else record[0]).tolist()
    force = np.array([walk.move(dy) for dy in steps])
    for _ in range(MAX_PASSES if motion.periodic else 0):
        closing = walk.move(record[0] - record[-1])
        if has_history and abs(closing - force[0]) <= CLOSURE_TOLERANCE * np.max(np.abs(force)):
            break
        force, has_history = np.array([closing, *(walk.move(dy) for dy in steps[1:])]), True
    return force


SLOW_TIME_STEP_S = 1e30
"""Time step [s] at which no rate matters."""
MIN_BREAKAWAY_M, MAX_BREAKAWAY_M = 1e-12, 1e-3
"""Displacements [m] between which a law's breakaway is looked for."""


class Walk:
    """A law in plain Python, with exactly the memory that the model declares."""

    def __init__(self, model: FrictionModel, time_step: float) -> None:
        self.name = model.name
        self.law, self.arguments, self.time_step = model.law, model.law_arguments(), time_step
        self.z = np.zeros(model.state_size)

    def try_step(self, dy: float) -> tuple[float, NDArray[np.float64]]:
        """Return force [N] and new memory after a displacement by dy [m]; the walk stays where it is."""
        z_next = np.full(self.z.size, np.nan)
        try:
            force: object = self.law(self.z, dy, self.time_step, z_next, *self.arguments)
        except (
            ArithmeticError
        ):  # an overflow, which compiled code makes infinite; whoever asked knows whether it may be
            raise
        except Exception as error:
            fault = step_fault(self.name, self.law, self.arguments, self.z, dy, self.time_step, error)
            raise ViolationError(fault) from error
        if not isinstance(force, float | int) or np.isnan(force):
            found = f"gives a force of {force!r:.60} {step_text(dy, self.time_step)}"
            raise ViolationError(f"the law of {self.name} ({law_place(self.law)}) {found}; expected a finite number")
        return float(force), z_next

    def move(self, dy: float) -> float:
        """Move by dy [m] and return the force [N]."""
        force, self.z = self.try_step(dy)
        return force

    def move_along(self, record: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the forces [N] along a displacement record [m], from rest at its beginning."""
        return np.array([self.move(dy) for dy in np.diff(record, prepend=record[:1]).tolist()])


@dataclass(frozen=True)
class Drive:
    """A friction model that is moved along straight legs."""

    model: FrictionModel
    legs: tuple[tuple[int, int], ...]
    """Where each leg ends, in quarters of the model's `length`, and in how many steps."""
    time_step: float
    """Length of a step [s]."""

    @cached_property
    def length(self) -> float:
        """Displacement [m] from rest at which the slow law has lost half of its stiffness."""
        return breakaway_displacement(self.model)

    @cached_property
    def record(self) -> NDArray[np.float64]:
        """The path [m], shape (steps,), from 0."""
        ends = np.array([0, *(end for end, _ in self.legs)]) * self.length / 4
        legs = zip(ends[:-1], ends[1:], (steps for _, steps in self.legs), strict=True)
        return np.concatenate([[0.0], *(np.linspace(begin, end, steps + 1)[1:] for begin, end, steps in legs)])

    @cached_property
    def force(self) -> NDArray[np.float64]:
        """Forces [N] of the law in plain Python, shape (steps,)."""
        return Walk(self.model, self.time_step).move_along(self.record)

    @cached_property
    def max_force(self) -> float:
        """Greatest force along the path [N], to which errors are compared; 1 N if all are 0 N."""
        return float(np.max(np.abs(self.force), initial=0.0)) or 1.0

    def slow_copy(self) -> "Drive":
        """Return the same path in steps that take so long that no rate matters."""
        return replace(self, time_step=SLOW_TIME_STEP_S)

    def walks(self) -> Iterator[tuple[Walk, float]]:
        """Yield the walk at every step of the path, with the displacement that is about to follow [m]."""
        walk = Walk(self.model, self.time_step)
        for dy in np.diff(self.record).tolist():
            yield walk, dy
            walk.move(dy)

    def __str__(self) -> str:
        """One line for a report."""
        ends = ", ".join(f"{end * self.length / 4:.3g} m in {steps}" for end, steps in self.legs)
        return f"{describe_component(self.model)}; from 0 m to {ends} steps of {self.time_step:g} s"


def breakaway_displacement(model: FrictionModel) -> float:
    """Return the displacement [m] from rest at which the secant stiffness of a slow motion has fallen to one half."""
    lengths = np.geomspace(MIN_BREAKAWAY_M, MAX_BREAKAWAY_M, 46)
    walk = Walk(model, SLOW_TIME_STEP_S)
    forces = np.array([walk.try_step(length)[0] for length in lengths.tolist()])
    secants = np.nan_to_num(forces / lengths)
    slipped = np.flatnonzero(np.abs(secants) < 0.5 * abs(secants[0]))
    return float(lengths[slipped[0]]) if slipped.size else float(MAX_BREAKAWAY_M if secants[0] else 1e-5)


def describe_component(component: Component) -> str:
    """Return a component with its parameters, in one short line."""
    return f"{component.name}({', '.join(f'{key}={_short_text(value)}' for key, value in component.plain().items())})"


def _short_text(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list):
        inner = [_short_text(item) for item in value]
        return f"[{', '.join(inner if len(inner) < 4 else [inner[0], '...', inner[-1]])}]"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key}={_short_text(item)}' for key, item in value.items() if item is not None)}}}"
    return str(value)


def drive_strategy(component: type[Component]) -> SearchStrategy[Drive]:
    """Return the strategy of paths for a friction model."""
    return _legs_strategy(component, st.integers(1, 12))


def loop_strategy(component: type[Component]) -> SearchStrategy[Drive]:
    """Return the strategy of closed paths: of any kind, or alternately in tiny steps and in one long step."""
    creep, dash = st.integers(4, 24), st.integers(4, 24)
    creeping = st.tuples(creep, dash).map(lambda to: ((to[0], 1024), (sum(to), 1), (to[1], 1024), (0, 1)))
    return st.one_of(
        back_and_forth_strategy(component),
        st.builds(Drive, strategy(component), creeping, st.sampled_from([1e-4, 1e-5])),
    )


def back_and_forth_strategy(component: type[Component]) -> SearchStrategy[Drive]:
    """Return the strategy of back-and-forth paths, in few steps and in many."""
    return _legs_strategy(component, st.sampled_from([8, 1, 64]))


def _legs_strategy(component: type[Component], steps: SearchStrategy[int]) -> SearchStrategy[Drive]:
    leg = st.tuples(st.integers(-16, 16), steps)
    legs = st.lists(leg, min_size=1, max_size=6).map(tuple)
    return st.builds(Drive, strategy(component), legs, st.sampled_from([1e-3, 1e-4, 1e-5]))
