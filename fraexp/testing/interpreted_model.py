"""Friction models whose force is computed in plain Python: quick checks use them instead of the compiler."""

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fraexp.components.kinds import Component, FrictionModel, Motion
from fraexp.testing.walk import Walk

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
