"""A friction model that is driven along a record after the samples before it."""

import numpy as np
import pytest
from fraexp_plugins.friction.rolling import Rolling

from fraexp.api import Motion

STIFFNESS, DAMPING, AMPLITUDE, FREQUENCY_HZ = 1e5, 300.0, 1e-6, 7.0
POINTS = 16
"""Points of the record per sample of the lead-in."""


def motion(periodic: bool, samples: int = 64) -> Motion:
    """Return whole periods of a sine after a lead-in whose samples are farther apart."""
    step = 1 / (FREQUENCY_HZ * samples)

    def sine(times):
        return AMPLITUDE * np.sin(2 * np.pi * FREQUENCY_HZ * times + 0.7)

    record = sine(np.arange(samples * POINTS) * step / POINTS)
    return Motion(record, step / POINTS, periodic, sine(np.arange(-3 * samples, 0) * step), step)


@pytest.mark.parametrize("periodic", [True, False])
def test_the_lead_in_ends_at_the_first_point_of_the_record(periodic):
    """Spring and damper without slip: f = K x + D dx/dt. The step to the first point is one of the lead-in."""
    model = Rolling(stiffness=(STIFFNESS,), limit_force=(1e9,), damping=(DAMPING,), viscous_coefficient=0.0)
    driven = motion(periodic)
    (force,) = model.forces([driven])
    angle = 2 * np.pi * FREQUENCY_HZ * np.arange(force.size) * driven.time_step + 0.7
    velocity = 2 * np.pi * FREQUENCY_HZ * AMPLITUDE * np.cos(angle)
    deflection = driven.displacement - driven.lead_in[0]  # the lead-in begins at rest
    expected = STIFFNESS * deflection + DAMPING * velocity
    assert np.abs(force - expected).max() < 0.01 * np.abs(expected).max()


def test_a_damped_element_that_slips_has_no_spike_at_the_first_points():
    """With a limit that the damping alone reaches, a step that counts as too short turned the force round."""
    model = Rolling(stiffness=(STIFFNESS,), limit_force=(0.08,), damping=(30 * DAMPING,), viscous_coefficient=0.0)
    driven = motion(periodic=True)
    after_lead_in, from_rest = model.forces([driven, driven._replace(lead_in=np.empty(0))])
    np.testing.assert_allclose(after_lead_in, from_rest, atol=1e-9)
