"""Every friction model as the paper's machine and as the observer's model, at the amplitudes of the paper."""

from dataclasses import replace

import numpy as np
import pytest
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.excitations.stepped_sine import SteppedSine

from fraexp.simulation import loop_setup
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics
from tests.examples import some, thorough
from tests.machines import LEAD, TABLE, decibel, degrees, table_models

CARD = ("rolling", "gms", "elastoplastic")
GRID = tuple(np.geomspace(1.0, 200.0, 13))
DEAD_TIME = 1e-3


@pytest.fixture(scope="module")
def models(registry):
    return table_models(registry)


def signals(friction, frequencies, amplitude, *, steps=5, settling_timeout=30.0):
    loop = ControlLoop(sample_time=500e-6, input_dead_time=DEAD_TIME)
    machine = Machine(TABLE, friction, LEAD, loop, Numerics(steps_per_sample=steps))
    excitation = SteppedSine(amplitude=amplitude, frequencies=frequencies, settling_timeout=settling_timeout)
    return simulate_loop(machine, excitation, lambda _: None)


def error(response):
    ratio = response.response / TABLE.response(2 * np.pi * response.frequency)
    return np.max(np.abs(decibel(ratio))), np.max(np.abs(degrees(ratio)))


def matched(friction):
    return EffectiveInput(friction=friction, input_dead_time=DEAD_TIME)


@pytest.mark.thorough
@pytest.mark.parametrize("amplitude", some([12.0, 75.0], 75.0))
@pytest.mark.parametrize("name", some(CARD, "elastoplastic"))
def test_the_matched_observer_recovers_the_plant(models, name, amplitude):
    response = matched(models[name]).estimate(signals(models[name], GRID, amplitude)).response
    magnitude, phase = error(response)
    assert magnitude < 0.05
    assert phase < 0.3


@pytest.mark.thorough
def test_what_came_before_tells_which_of_two_periodic_forces_gms_has(models, monkeypatch):
    """An element may slip in every period or never, for one and the same motion: its past decides."""
    monkeypatch.setitem(globals(), "TABLE", TABLE.model_copy(update={"damping_ratios": (0.04634, 0.02)}))
    found = signals(models["gms"], (9.9833,), 12.0)
    segment = found.segments[0]
    alone = replace(found, segments=(replace(segment, lead_in={}),))
    matching, guessing = (error(matched(models["gms"]).estimate(each).response)[1] for each in (found, alone))
    assert segment.lead_in["y"][0] == 0.0
    assert matching < 0.1 * guessing


@pytest.mark.parametrize("name", some(["lugre", "dahl"], "lugre"))
@pytest.mark.parametrize(("amplitude", "lowest"), [thorough(12.0, 5.0), (75.0, 1.0)])
@pytest.mark.thorough
def test_so_it_does_where_models_that_creep_have_settled(models, name, amplitude, lowest):
    """Below 5 Hz at 12 N the mean position of these models is still on its way after 30 s, and the response says so."""
    frequencies = tuple(f for f in GRID if f >= lowest)
    response = matched(models[name]).estimate(signals(models[name], frequencies, amplitude)).response
    magnitude, phase = error(response)
    assert response.settled.all()
    assert magnitude < 0.05
    assert phase < 0.3


@pytest.mark.thorough
def test_a_creeping_model_says_that_it_has_not_settled(models):
    response = Conventional().estimate(signals(models["dahl"], (1.0,), 12.0)).response
    assert not response.settled.any()


@pytest.mark.thorough
def test_a_wrong_observer_is_worse_than_the_right_one(models):
    """A GMS machine seen through the rolling model lies away from P where friction matters, seen through GMS on it."""
    found = signals(models["gms"], (10.0, 20.0, 36.0), 12.0)
    right, wrong = (error(matched(models[name]).estimate(found).response)[0] for name in ("gms", "rolling"))
    assert right < 0.01
    assert wrong > 20 * right


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["rolling", "gms"])
def test_eight_at_a_time_and_one_by_one_agree(models, name, monkeypatch):
    """The predicted displacement is as good as the root where friction is soft; both are within the step's error."""
    frequencies, responses = (2.0, 10.0, 40.0, 150.0), []
    for soft in (1.0, 0.0):
        monkeypatch.setattr(loop_setup, "EXPLICIT_STIFFNESS_LIMIT", soft)
        found = signals(models[name], frequencies, 75.0)
        assert ("lanes" in found.numerics) == bool(soft)
        responses.append(Conventional().estimate(found).response.response)
    assert np.max(np.abs(responses[0] / responses[1] - 1)) < Numerics().tolerance
