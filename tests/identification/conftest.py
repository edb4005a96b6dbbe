"""Records of the paper's machine, with a friction law and with noise."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fraexp.components.kinds import Controller, Excitation, FrictionModel, Plant
from fraexp.components.registry import Registry, create
from fraexp.data.signals import Signals
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics
from tests.identification.plant_responses import MACHINE, SCALE

LAW = MACHINE["friction"]


@pytest.fixture(scope="module")
def recorded(registry: Registry) -> Any:
    """Return what records the machine."""

    def record(excitation: Any, friction: Any = None, force_noise: float = 0.0, **loop: Any) -> Signals:
        machine = Machine(
            create(registry, Plant, MACHINE["plant"]),
            friction if isinstance(friction, FrictionModel) else create(registry, FrictionModel, friction or LAW),
            create(registry, Controller, MACHINE["controller"]),
            ControlLoop.parse({**MACHINE["loop"], **SCALE, **loop}, "loop"),
            Numerics(),
        )
        signals = simulate_loop(machine, create(registry, Excitation, excitation), lambda _: None)
        generator = np.random.default_rng(0)
        segments = []
        for segment in signals.segments:
            u = segment.channels["u"]
            noisy = u + force_noise * generator.standard_normal(u.shape)
            segments.append(replace(segment, channels={**segment.channels, "u": noisy}))
        return replace(signals, segments=tuple(segments))

    return record
