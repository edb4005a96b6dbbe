"""Records of displacement and friction force, made by a model."""

import numpy as np
from fraexp_plugins.friction.coulomb import Coulomb
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.identification.friction_identification import FrictionIdentification

from fraexp.components.kinds import FrictionModel
from fraexp.data.results import Result
from fraexp.data.signals import Segment, Settling, Signals

THREE = Rolling(stiffness=(3e5, 1e5, 5e4), limit_force=(2.0, 4.0, 6.0), viscous_coefficient=4.69)
"""Elements whose deflections are 6.7, 40 and 120 µm."""


def motion(samples: int, cycles: int, amplitude: float = 400e-6) -> np.ndarray:
    """Return a displacement to and fro with reversals inside [m]."""
    phase = 2 * np.pi * np.arange(samples * cycles) / samples
    return amplitude * (np.sin(phase) + 0.3 * np.sin(7 * phase))


def driven(
    model: FrictionModel, y: np.ndarray, time_step: float, *, noise: float = 0.0, seed: int = 0, offset: float = 0.0
) -> np.ndarray:
    """Return the force of a model along a displacement [N], with noise relative to its greatest value."""
    force = model.force(y, time_step) + model.viscous * np.gradient(y, time_step) + offset
    return force + noise * np.abs(force).max() * np.random.default_rng(seed).normal(size=y.size)


def signals(y: np.ndarray, force: np.ndarray, time_step: float, cycles: int, *, from_rest: bool = False) -> Signals:
    """Return a measured record of so many cycles, or one that is known to begin at rest."""
    channels = {"displacement": y.reshape(cycles, -1), "friction": force.reshape(cycles, -1)}
    settling = Settling(True, 0.0, 0.0) if from_rest else None
    return Signals((Segment(time_step, channels, np.array([1]), settling),), {"displacement": "m", "friction": "N"})


def record(model: FrictionModel, *, samples: int = 1000, cycles: int = 8, **how: float) -> Signals:
    """Return a measured record of a model."""
    y = motion(samples, cycles)
    return signals(y, driven(model, y, 1 / samples, **how), 1 / samples, cycles)


def values(result: Result) -> dict[str, float]:
    """Return the metrics by name."""
    return {metric.name: metric.value for metric in result.metrics}


def sliding(**given: object) -> FrictionIdentification:
    """Return the estimator of mass and friction from sliding."""
    common = {"laws": (Coulomb,), "thrust": "u", "displacement": "y", "max_frequency": 15.0}
    return FrictionIdentification(**{**common, **given})
