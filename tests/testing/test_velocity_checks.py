"""Laws of the velocity: what the conformance kit expects of a friction model without states."""

import math

import pytest

from fraexp.api import FrictionModel
from fraexp.testing.conformance_check import ViolationError
from fraexp.testing.friction_motion_checks import continuous_at_rest, function_of_velocity


class OfVelocity(FrictionModel, name="of_velocity_in_a_test", version=1):
    """Smoothed Coulomb friction."""

    states = ()

    @staticmethod
    def advance(z, dy, dt, z_next):
        return 10 * math.tanh(dy / dt / 1e-6)


class Jumping(FrictionModel, name="jumping_in_a_test", version=1):
    """Coulomb friction."""

    states = ()

    @staticmethod
    def advance(z, dy, dt, z_next):
        return math.copysign(10.0, dy)


class OfSteps(FrictionModel, name="of_steps_in_a_test", version=1):
    """A force of the increment, which vanishes with it."""

    states = ()

    @staticmethod
    def advance(z, dy, dt, z_next):
        return 1e6 * dy


def test_a_smooth_function_of_the_velocity_passes_however_narrow_its_transition() -> None:
    continuous_at_rest(OfVelocity())
    function_of_velocity(OfVelocity())


def test_a_jump_is_named_with_its_remedies() -> None:
    with pytest.raises(ViolationError, match=r"it jumps at rest, to 10 N at 1e-15 m/s; expected .*velocity_law"):
        continuous_at_rest(Jumping())


def test_a_force_of_the_step_is_no_function_of_the_velocity() -> None:
    with pytest.raises(ViolationError, match="expected, without states, a function of dy / dt"):
        function_of_velocity(OfSteps())
