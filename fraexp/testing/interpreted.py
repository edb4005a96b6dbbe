"""Friction models whose force is computed in plain Python: what a quick check looks at, without the compiler."""

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from fraexp.components.kinds import Component, FrictionModel, Motion
from fraexp.testing.walk import Walk

MAX_PASSES = 6
"""Times that a periodic record is run through."""
CLOSED = 1e-10
"""Change of the force from one pass to the next, relative to the greatest force, that counts as periodic."""


class Interpreted:
    """Put before a friction model among the bases of a class: its forces are then those of the law in plain Python."""

    def forces(self: Any, motions: Sequence[Motion]) -> list[np.ndarray]:
        """Return the law's force [N] along each of several motions."""
        self.rehearse()
        return [_driven(self, motion) for motion in motions]


@cache
def interpreted(component: type[Component]) -> type[Component]:
    """Return a component class as it is when nothing is to be compiled: of friction models, an interpreted one."""
    if not issubclass(component, FrictionModel):
        return component
    named = {"__doc__": component.__doc__, "__module__": component.__module__, "__qualname__": component.__qualname__}
    metaclass: Any = type(component)
    made: type[Component] = metaclass(component.__name__, (Interpreted, component), named)
    return made


def _driven(model: FrictionModel, motion: Motion) -> np.ndarray:
    """Return the force [N] along a motion, as the compiled kernel does it: from rest, until it repeats itself."""
    record, walk = np.asarray(motion.displacement, dtype=float), Walk(model, motion.lead_in_step)
    walk.along(motion.lead_in)
    walk.time_step = motion.time_step
    begun = motion.lead_in.size > 0
    steps = np.diff(record, prepend=motion.lead_in[-1] if begun else record[0]).tolist()
    force = np.array([walk.step(dy) for dy in steps])
    for _ in range(MAX_PASSES if motion.periodic else 0):
        closing = walk.step(record[0] - record[-1])
        if begun and abs(closing - force[0]) <= CLOSED * np.max(np.abs(force)):
            break
        force, begun = np.array([closing, *(walk.step(dy) for dy in steps[1:])]), True
    return force
