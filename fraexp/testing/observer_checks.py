"""The check of the purpose of friction models: an observer that knows the machine's friction finds its plant."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

from fraexp.analysis.fourier import phasors
from fraexp.components.kinds import Component, Estimator, FrictionModel, Plant
from fraexp.components.registry import create
from fraexp.data.results import Outcome
from fraexp.testing import example_loop
from fraexp.testing.conformance_check import NotApplicableError, require
from fraexp.testing.examples import installed_components, strategy
from fraexp.testing.walk import SLOW_TIME_STEP_S, Walk, breakaway_displacement, describe_component

TOLERANCE = 5e-3
"""Relative error of P̂ (0.04 dB, 0.3°), times |P N| where friction outweighs the plant."""
STUCK_RESONANCE_HZ = 60.0
"""Resonance of the mass that is stuck on the friction's stiffness [Hz]."""
MAX_ACCELERATION = 20.0
"""Greatest acceleration by the friction force [m/s²]."""


@dataclass(frozen=True)
class Exposure:
    """A friction model on a mass that suits it, excited by a multiple of its force."""

    model: FrictionModel
    push: float
    """Amplitude of the excitation in multiples of the friction force."""

    @property
    def force(self) -> float:
        """Friction force [N] in gross sliding."""
        return abs(Walk(self.model, SLOW_TIME_STEP_S).move(10 * breakaway_displacement(self.model))) or 1.0

    @property
    def mass(self) -> float:
        """Moving mass [kg]."""
        return max(
            self.model.max_stiffness / (2 * np.pi * STUCK_RESONANCE_HZ) ** 2, self.force / MAX_ACCELERATION, 1e-6
        )

    def __str__(self) -> str:
        """One line for a report."""
        return f"{describe_component(self.model)}; {self.mass:.4g} kg pushed by {self.push * self.force:.4g} N"


def exposure_strategy(component: type[Component]) -> SearchStrategy[Exposure]:
    """Return the strategy of exposures of a friction model."""
    return st.builds(Exposure, strategy(component), st.sampled_from([4.0, 0.5, 1.5]))


def observer(exposure: Exposure) -> None:
    """An observer with the machine's own friction model finds the plant: P̂ = P within 0.5 % of max(1, |P N|)."""
    parts = example_loop.experiment(exposure.mass, exposure.push * exposure.force, exposure.model.spec())
    signals = example_loop.simulate_experiment(parts, exposure.model)
    if signals.outcome is Outcome.NOT_SETTLED:
        raise NotApplicableError("the machine's motion did not become periodic")
    require(signals.outcome is Outcome.OK, signals.message)
    estimator: Any = installed_components().provider(Estimator.kind, "effective_input").component
    response = estimator(friction=exposure.model).estimate(signals).response
    omega = 2 * np.pi * response.frequency
    plant = create(installed_components(), Plant, parts["plant"]).response(omega)
    describing = np.array([abs(phasors(s, "friction") / phasors(s, "displacement")).max() for s in signals.segments])
    error = np.abs(response.response / plant - 1) / np.maximum(1.0, np.abs(plant) * describing)
    worst = int(np.argmax(error))
    require(
        error[worst] <= TOLERANCE,
        f"P̂/P is off by {error[worst]:.2%} of max(1, |P N|) at {response.frequency[worst]:.3g} Hz",
    )
