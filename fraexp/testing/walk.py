"""A friction model and a path, as an example; and its law in plain Python, step by step."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from hypothesis import strategies as st

from fraexp.components.kinds import Component, FrictionModel
from fraexp.testing.conformance_check import ViolationError
from fraexp.testing.examples import strategy

SLOW = 1e30
"""Time step [s] at which no rate matters."""
SHORTEST, LONGEST = 1e-12, 1e-3
"""Displacements [m] between which a law's first slip is looked for."""


class Walk:
    """A law in plain Python, with exactly the memory that the model declares."""

    def __init__(self, model: FrictionModel, time_step: float) -> None:
        self.law, self.arguments, self.time_step = model.law, model.law_arguments(), time_step
        self.z = np.zeros(model.state_size)

    def trial(self, dy: float) -> tuple[float, np.ndarray]:
        """Return force [N] and new memory after a displacement by dy [m]; the walk stays where it is."""
        z_next = np.full(self.z.size, np.nan)
        try:
            force = self.law(self.z, dy, self.time_step, z_next, *self.arguments)
        except IndexError as error:
            raise ViolationError(f"the law reaches beyond its state_size of {self.z.size}: {error}") from None
        return float(force), z_next

    def step(self, dy: float) -> float:
        """Move by dy [m] and return the force [N]."""
        force, self.z = self.trial(dy)
        return force

    def along(self, record: np.ndarray) -> np.ndarray:
        """Return the forces [N] along a displacement record [m], from rest at its beginning."""
        return np.array([self.step(dy) for dy in np.diff(record, prepend=record[:1]).tolist()])


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
        return slip_length(self.model)

    @cached_property
    def record(self) -> np.ndarray:
        """The path [m], shape (steps,), from 0."""
        ends = np.array([0, *(end for end, _ in self.legs)]) * self.length / 4
        legs = zip(ends[:-1], ends[1:], (steps for _, steps in self.legs), strict=True)
        return np.concatenate([[0.0], *(np.linspace(begin, end, steps + 1)[1:] for begin, end, steps in legs)])

    @cached_property
    def force(self) -> np.ndarray:
        """Forces [N] of the law in plain Python, shape (steps,)."""
        return Walk(self.model, self.time_step).along(self.record)

    @cached_property
    def scale(self) -> float:
        """Greatest force along the path [N], to compare errors with."""
        return float(np.max(np.abs(self.force), initial=0.0)) or 1.0

    def slowly(self) -> "Drive":
        """Return the same path in steps that take so long that no rate matters."""
        return replace(self, time_step=SLOW)

    def walks(self) -> Iterator[tuple[Walk, float]]:
        """Yield the walk at every step of the path, with the displacement that is about to follow [m]."""
        walk = Walk(self.model, self.time_step)
        for dy in np.diff(self.record).tolist():
            yield walk, dy
            walk.step(dy)

    def __str__(self) -> str:
        """One line for a report."""
        ends = ", ".join(f"{end * self.length / 4:.3g} m in {steps}" for end, steps in self.legs)
        return f"{described(self.model)}; from 0 m to {ends} steps of {self.time_step:g} s"


def slip_length(model: FrictionModel) -> float:
    """Return the displacement [m] from rest at which the slow secant stiffness is half of the first one."""
    lengths = np.geomspace(SHORTEST, LONGEST, 46)
    walk = Walk(model, SLOW)
    forces = np.array([walk.trial(length)[0] for length in lengths.tolist()])
    secants = np.nan_to_num(forces / lengths)
    slipped = np.flatnonzero(np.abs(secants) < 0.5 * abs(secants[0]))
    return float(lengths[slipped[0]]) if slipped.size else float(LONGEST if secants[0] else 1e-5)


def described(component: Component) -> str:
    """Return a component with its parameters, as short as it can be read."""
    return f"{component.name}({', '.join(f'{key}={_short(value)}' for key, value in component.plain().items())})"


def _short(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list):
        inner = [_short(item) for item in value]
        return f"[{', '.join(inner if len(inner) < 4 else [inner[0], '...', inner[-1]])}]"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key}={_short(item)}' for key, item in value.items() if item is not None)}}}"
    return str(value)


def drives(component: type[Component]) -> Any:
    """Return the strategy of drives of a friction model."""
    return _drives(component, st.integers(1, 12))


def loops(component: type[Component]) -> Any:
    """Return the strategy of drives to and fro: of any kind, or creeping, then dashing on."""
    creep, dash = st.integers(4, 24), st.integers(4, 24)
    creeping = st.tuples(creep, dash).map(lambda to: ((to[0], 1024), (sum(to), 1), (to[1], 1024), (0, 1)))
    return st.one_of(
        to_and_fro(component),
        st.builds(Drive, strategy(component), creeping, st.sampled_from([1e-4, 1e-5])),
    )


def to_and_fro(component: type[Component]) -> Any:
    """Return the strategy of drives to and fro, in few steps and in many."""
    return _drives(component, st.sampled_from([8, 1, 64]))


def _drives(component: type[Component], steps: Any) -> Any:
    leg = st.tuples(st.integers(-16, 16), steps)
    legs = st.lists(leg, min_size=1, max_size=6).map(tuple)
    return st.builds(Drive, strategy(component), legs, st.sampled_from([1e-3, 1e-4, 1e-5]))


def turns(component: type[Component]) -> Any:
    """Return the strategy of drives to and fro along one and the same path."""
    return st.builds(Drive, strategy(component), st.just(((6, 4), (-9, 7), (3, 5))), st.just(1e-4))
