"""An independent simulation of coupled bodies with elasto-slide friction: Runge-Kutta steps, far finer than a sample.

It shares no code with the loop: the equations of motion are written with mass matrices, friction is a sum of springs
that slide, and the controller is a difference equation.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Sliders:
    """Springs that slide at a limit force, and viscous friction, along x = vᵀq."""

    port: NDArray[np.float64]
    stiffness: NDArray[np.float64]
    limit: NDArray[np.float64]
    viscous: float
    ratio: Callable[[float], float] = lambda x: 1.0
    """Factor on the springs' force at x [m]."""
    cogging: Callable[[float], float] = lambda x: 0.0
    """Force against the displacement [N] at x [m]."""


@dataclass
class DifferenceEquation:
    """A controller: from the position pᵀq of a port to the force along it, which dead samples delay."""

    numerator: NDArray[np.float64]
    denominator: NDArray[np.float64]
    dead_samples: int

    def __post_init__(self) -> None:
        self.errors, self.outputs = np.zeros(self.numerator.size), np.zeros(self.denominator.size - 1)
        self.waiting = [0.0] * self.dead_samples

    def step(self, position: float, excitation: float = 0.0) -> tuple[float, float]:
        """Return the control input of a sample, with the excitation, and the force that acts in it."""
        self.errors = np.concatenate([[-position], self.errors[:-1]])
        control = float(self.numerator @ self.errors - self.denominator[1:] @ self.outputs)
        self.outputs = np.concatenate([[control], self.outputs[:-1]])
        self.waiting.append(control + excitation)
        return control + excitation, self.waiting.pop(0)


@dataclass(frozen=True)
class FineLoop:
    """Bodies in a sampled loop from the position pᵀq to the force along the same port."""

    mass: NDArray[np.float64]
    damping: NDArray[np.float64]
    stiffness: NDArray[np.float64]
    contacts: Sequence[Sliders]
    thrust: NDArray[np.float64]
    positions: Mapping[str, NDArray[np.float64]]
    """The first is fed back."""
    numerator: NDArray[np.float64]
    denominator: NDArray[np.float64]
    sample_time: float
    dead_samples: int
    held: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    """Further thrusts, each with a controller of the same kind, that holds the position of its name."""

    def responses(self, amplitude: float, samples: int, periods: int, substeps: int) -> dict[str, complex]:
        """Return y/u of each position at the fundamental, in the last of `periods` periods of `samples` samples."""
        recorded, inputs = self.last_period(amplitude, samples, periods, substeps)
        basis = np.exp(-2j * np.pi * np.arange(samples) / samples)
        motion, force = basis @ recorded, basis @ inputs
        return {name: complex(port @ motion / force) for name, port in self.positions.items()}

    def last_period(
        self, amplitude: float, samples: int, periods: int, substeps: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the coordinates, shape (samples, bodies), and the control input, (samples,), of the last period."""
        q, v = np.zeros(len(self.mass)), np.zeros(len(self.mass))
        deflections = [np.zeros(contact.stiffness.size) for contact in self.contacts]
        inverse, h = np.linalg.inv(self.mass), self.sample_time / substeps
        coefficients = self.numerator, self.denominator, self.dead_samples
        driven, holding = (
            DifferenceEquation(*coefficients),
            {name: DifferenceEquation(*coefficients) for name in self.held},
        )
        recorded, inputs = [], []
        fed_back = next(iter(self.positions.values()))

        def friction(q: NDArray[np.float64], begin: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
            total = np.zeros(len(q))
            for contact, deflection in zip(self.contacts, deflections, strict=True):
                springs = contact.stiffness * (deflection + contact.port @ (q - begin))
                x = float(contact.port @ q)
                force = contact.ratio(x) * float(np.clip(springs, -contact.limit, contact.limit).sum())
                total += contact.port * (force + contact.viscous * (contact.port @ v) + contact.cogging(x))
            return total

        for sample in range(samples * periods):
            control, force = driven.step(float(fed_back @ q), amplitude * np.sin(2 * np.pi * sample / samples))
            thrust = self.thrust * force
            for name, port in self.held.items():
                thrust = thrust + port * holding[name].step(float(self.positions[name] @ q))[1]
            if sample >= samples * (periods - 1):
                recorded.append(q)
                inputs.append(control)
            for _ in range(substeps):
                begin = q

                def acceleration(q: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
                    force = thrust - self.damping @ v - self.stiffness @ q - friction(q, begin, v)  # noqa: B023
                    return np.asarray(inverse @ force)

                a1 = acceleration(q, v)
                a2 = acceleration(q + h / 2 * v, v + h / 2 * a1)
                a3 = acceleration(q + h / 2 * v + h**2 / 4 * a1, v + h / 2 * a2)
                a4 = acceleration(q + h * v + h**2 / 2 * a2, v + h * a3)
                q = q + h * v + h**2 / 6 * (a1 + a2 + a3)
                v = v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
                for number, contact in enumerate(self.contacts):
                    reach = contact.limit / contact.stiffness
                    deflections[number] = np.clip(deflections[number] + contact.port @ (q - begin), -reach, reach)
        return np.array(recorded), np.array(inputs)
