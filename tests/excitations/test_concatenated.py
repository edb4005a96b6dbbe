"""Several excitations in one experiment: their periods in order, the strictest schedule, and what cannot be joined."""

import numpy as np
import pytest

from fraexp.components.kinds import Excitation
from fraexp.components.periods import Schedule
from fraexp.components.registry import create
from fraexp.errors import ParameterError
from tests.refusals import refused

TS = 500e-6
SINE = {"name": "stepped_sine", "amplitude": 12.0, "frequencies": [10.0, 40.0]}


@pytest.fixture
def made(registry):
    """Return what builds a sequence of these parts."""
    return lambda *parts: create(registry, Excitation, {"name": "concatenated", "parts": list(parts)})


def test_the_periods_are_those_of_the_parts_in_order(registry, made):
    multisine = {"name": "multisine", "rms": 5.0, "realisations": 2}
    found = made(SINE, multisine).periods(TS)
    parts = [create(registry, Excitation, spec).periods(TS) for spec in (SINE, multisine)]
    assert len(found) == 4
    for one, other in zip(found, [*parts[0], *parts[1]], strict=True):
        assert np.array_equal(one.waveform, other.waveform)
        assert np.array_equal(one.lines, other.lines)


def test_the_strictest_schedule_holds_for_all(made):
    quick = {**SINE, "ramp": 0.5, "settling_tolerance": 1e-3, "settling_timeout": 5.0, "recorded_periods": 6}
    careful = {**SINE, "ramp": 0.1, "settling_tolerance": 1e-6, "settling_timeout": 50.0, "min_record_time": 2.0}
    assert made(quick, careful).schedule == Schedule(0.5, 1e-6, 50.0, 6, 2.0)


@pytest.mark.parametrize(
    ("parts", "names"),
    [
        ((), ["parts"]),
        (({"name": "displacement_sine", "amplitude": 1e-5, "frequency": 1.0},), ["displacement_sine"]),
        ((SINE, {"name": "response_controlled", "displacement": 2e-5, "max_force": 50.0}), ["response_controlled"]),
        (({"name": "multisine", "rms": 5.0, "transient": True},), ["multisine"]),
    ],
)
def test_what_cannot_be_joined_is_refused(made, parts, names):
    with refused(ParameterError, *names):
        made(*parts)


def test_a_part_that_cannot_be_sampled_is_refused(made):
    with refused(ParameterError, "1200 Hz", "Nyquist"):
        made(SINE, {**SINE, "frequencies": [1200.0]}).check(TS)
