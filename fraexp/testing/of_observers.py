"""The check of what friction models are for: the machine's friction, seen by an observer that knows it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from hypothesis import strategies as st

from fraexp.analysis.fourier import phasors
from fraexp.components.kinds import Component, Estimator, FrictionModel, Plant
from fraexp.components.registry import create
from fraexp.data.results import Outcome
from fraexp.testing import bench
from fraexp.testing.conformance_check import NotApplicableError, require
from fraexp.testing.examples import installed, strategy
from fraexp.testing.walk import SLOW, Walk, described, slip_length

TOLERANCE = 5e-3
"""Relative error of P̂ (0.04 dB, 0.3°), times |P N| where friction outweighs the plant."""
STUCK = 60.0
"""Resonance of the mass that is stuck on the friction's stiffness [Hz]."""
GENTLE = 20.0
"""Acceleration by the friction force [m/s²], at most."""


@dataclass(frozen=True)
class Exposure:
    """A friction model on a mass that suits it, excited by a multiple of its force."""

    model: FrictionModel
    push: float
    """Amplitude of the excitation in multiples of the friction force."""

    @property
    def force(self) -> float:
        """Friction force [N] far beyond the first slip."""
        return abs(Walk(self.model, SLOW).step(10 * slip_length(self.model))) or 1.0

    @property
    def mass(self) -> float:
        """Moving mass [kg]."""
        return max(self.model.greatest_stiffness / (2 * np.pi * STUCK) ** 2, self.force / GENTLE, 1e-6)

    def __str__(self) -> str:
        """One line for a report."""
        return f"{described(self.model)}; {self.mass:.4g} kg pushed by {self.push * self.force:.4g} N"


def exposures(component: type[Component]) -> Any:
    """Return the strategy of exposures of a friction model."""
    return st.builds(Exposure, strategy(component), st.sampled_from([4.0, 0.5, 1.5]))


def observer(exposure: Exposure) -> None:
    """An observer with the machine's own friction model finds the plant: P̂ = P within 0.5 % of max(1, |P N|)."""
    parts = bench.experiment(exposure.mass, exposure.push * exposure.force, exposure.model.spec())
    signals = bench.simulated(parts, exposure.model)
    if signals.outcome is Outcome.NOT_SETTLED:
        raise NotApplicableError("the machine's motion did not become periodic")
    require(signals.outcome is Outcome.OK, signals.message)
    estimator: Any = installed().supply(Estimator.kind, "proposed").component
    response = estimator(friction=exposure.model).estimate(signals).response
    omega = 2 * np.pi * response.frequency
    plant = create(installed(), Plant, parts["plant"]).response(omega)  # type: ignore[type-abstract]
    describing = np.array([abs(phasors(s, "friction") / phasors(s, "displacement")).max() for s in signals.segments])
    error = np.abs(response.response / plant - 1) / np.maximum(1.0, np.abs(plant) * describing)
    worst = int(np.argmax(error))
    require(
        error[worst] <= TOLERANCE,
        f"P̂/P is off by {error[worst]:.2%} of max(1, |P N|) at {response.frequency[worst]:.3g} Hz",
    )
