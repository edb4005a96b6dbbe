"""Points that count as settled are in their steady state, also where a lightly damped mode beats with the sine."""

import numpy as np
import pytest
from fraexp_plugins.friction.none import Frictionless
from fraexp_plugins.plants.modal import Modal

from fraexp.analysis.fourier import phasors
from fraexp.components.kinds import FrictionModel
from fraexp.data.signals import Signals
from tests.machines import FRICTIONLESS, guide, simulated
from tests.physics.test_loop import sampled

RINGING = Modal(
    rigid_body_gain=0.132, frequencies=(25.05, 61.0), damping_ratios=(0.004, 0.006), modal_gain_ratios=(0.2, 0.1)
)
NEAR = (24.7, 25.0, 25.1, 25.6, 60.6, 61.5)
"""Frequencies [Hz] that beat with a mode at 0.05 to 0.6 Hz, within some windows or over many of them."""
DEAD_TIME = 1e-3


def ringing(friction: FrictionModel = FRICTIONLESS, **settings: object) -> Signals:
    return simulated(friction, NEAR, 12.0, plant=RINGING, steps=4, **settings)


def ratios(signals: Signals) -> np.ndarray:
    """Return y/u at the settled frequencies, NaN at the others."""
    return np.array([
        phasors(each, "y")[0, 0] / phasors(each, "u")[0, 0] if each.settling.settled else np.nan
        for each in signals.segments
    ])  # fmt: skip


def errors(found: Signals, truth: np.ndarray) -> np.ndarray:
    """Return the relative errors of the settled points; they must be most of them."""
    error = np.abs(ratios(found) / truth - 1)
    assert np.isfinite(error).sum() >= len(NEAR) - 2
    return error[np.isfinite(error)]


def test_a_beat_without_friction_has_settled_where_it_is_said():
    found = ringing()
    frequency = np.concatenate([segment.frequency for segment in found.segments])
    assert errors(found, sampled(2 * np.pi * frequency, DEAD_TIME, RINGING)).max() < 3e-5


@pytest.mark.parametrize("friction", [guide(), Frictionless(viscous_coefficient=2.0)], ids=["rolling", "viscous"])
def test_a_beat_with_friction_has_settled_where_it_is_said(friction: FrictionModel):
    assert errors(ringing(friction), ratios(ringing(friction, tolerance=1e-10))).max() < 1e-4


@pytest.mark.parametrize("resolution", [1e-7, 1e-6])
def test_an_encoder_does_not_hide_a_slow_beat(resolution: float):
    """It changes less from window to window than the encoder resolves, and yet was 3e-3 off: 40 times the rounding."""
    found, ideal = ringing(resolution=resolution), ringing(tolerance=1e-10)
    motion = np.array([abs(phasors(each, "y")[0, 0]) for each in ideal.segments])
    size = np.array([each.channels["y"].size for each in found.segments])
    rounding = resolution / np.sqrt(12) * np.sqrt(2 / size) / motion
    assert np.all(np.abs(ratios(found) / ratios(ideal) - 1) < 3e-5 + 10 * rounding)  # rounding is no white noise
