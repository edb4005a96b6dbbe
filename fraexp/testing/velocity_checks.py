"""Checks of friction models without states: what they give is a function of the velocity alone."""

import numpy as np
from numpy.typing import NDArray

from fraexp.components.kinds import FrictionModel
from fraexp.testing.conformance_check import require
from fraexp.testing.walk import Walk

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
