"""Which friction law, of a machine of which nothing is known: the law, its numbers, the plant, and what none fits."""

from dataclasses import replace

import numpy as np
import pytest
from fraexp_plugins.identification.whole_record._shared.free_parameters import FreeParameters
from fraexp_plugins.identification.whole_record._shared.scaled_friction import shape_parameters

from fraexp.components.kinds import Controller, Estimator, Excitation, FrictionModel, Plant
from fraexp.components.registry import create, discover
from fraexp.data.results import Outcome
from fraexp.errors import RecordError
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics
from tests.identification.test_maximum_likelihood import LUGRE, MACHINE, RESOLUTION, metrics, plant_at, recorded
from tests.machines import decibel, degrees

__all__ = ["recorded"]
SINE = {"name": "stepped_sine", "amplitude": 12.0, "points": 20}


def comparison(**given):
    parameters = {"resolution": RESOLUTION, "noise": 0.0, "input_dead_time": MACHINE["loop"]["input_dead_time"]}
    return create(discover(), Estimator, {"name": "friction_law_comparison", **parameters, **given})


def candidates_of(signals, *names):
    """Return those of the models at which a comparison begins by itself, by the names of their laws."""
    return [model.spec() for model in comparison()._starts(signals) if model.name in names]


def test_shape_parameters_are_those_that_scales_do_not_change(registry):
    friction = create(registry, FrictionModel, LUGRE)
    assert set(shape_parameters(friction)) == {
        "viscous_coefficient", "static_force", "bristle_damping", "stribeck_velocity"
    }  # fmt: skip
    rolling = create(registry, FrictionModel, MACHINE["friction"])
    assert set(shape_parameters(rolling)) == {"viscous_coefficient", "curve.min_knot", "curve.max_knot"}


def test_the_start_is_near_without_any_knowledge(recorded, registry):
    starts = comparison()._starts(recorded(excitation=SINE))
    curve = MACHINE["friction"]["curve"]
    assert [model.name for model in starts] == ["rolling", "dahl", "lugre"]
    assert starts[0].curve.coulomb_force == pytest.approx(curve["coulomb_force"], rel=0.1)
    width = curve["characteristic_displacement"]
    assert starts[0].curve.characteristic_displacement == pytest.approx(width, rel=0.1)


def test_too_few_records_are_refused(recorded):
    signals = recorded(excitation=SINE)
    with pytest.raises(RecordError, match=r"there are 5 records; expected 8 or more"):
        comparison().estimate(replace(signals, segments=signals.segments[:5]))


@pytest.mark.thorough
def test_law_numbers_and_plant_are_found_of_a_machine_of_which_nothing_is_known(recorded, registry):
    signals = recorded(excitation=SINE)
    result = comparison(candidates=candidates_of(signals, "rolling", "dahl")).estimate(signals)
    assert result.outcome is Outcome.OK, result.message
    assert "rolling predicts the records best" in result.message
    found, curve = metrics(result), MACHINE["friction"]["curve"]
    assert found["verdict"] == 1
    assert found["rolling: held-out residual"] < 1.1
    assert "not carried to the end, as they leave more along the measured motion: dahl" in result.message
    assert found["dahl: residual along the motion"] > 10 * found["rolling: residual along the motion"]
    assert found["Coulomb force"] == pytest.approx(curve["coulomb_force"], abs=found["Coulomb force, 95 %"])
    assert found["Coulomb force, 95 %"] < 1e-3 * curve["coulomb_force"]
    friction = create(registry, FrictionModel, result.fits[1].component)
    assert friction.curve.coulomb_force == pytest.approx(curve["coulomb_force"], rel=1e-4)
    ratio = result.response.response / plant_at(registry, result)
    assert np.abs(decibel(ratio)).max() < 0.1
    assert np.abs(degrees(ratio)).max() < 1.5


def test_a_parameter_that_records_do_not_tell_stays_within_limits():
    free = FreeParameters(("force_scale", "viscous_coefficient", "input_dead_time"))
    np.testing.assert_array_equal(free.limit(np.array([0.3, 800.0, 7.0])), [0.3, 5.0, 7.0])
    np.testing.assert_array_equal(free.limit(np.array([-800.0, -0.1, -7.0])), [-5.0, -0.1, -7.0])


@pytest.mark.thorough
def test_none_fits_where_the_machines_law_is_no_candidate(recorded):
    signals = recorded(excitation=SINE)
    result = comparison(candidates=candidates_of(signals, "dahl")).estimate(signals)
    assert result.outcome is Outcome.INACCURATE
    assert result.message.startswith("none of 1 laws fits")
    assert metrics(result)["verdict"] == 0


@pytest.mark.thorough
def test_the_simpler_of_two_laws_that_both_fit_wins(recorded):
    dahl = {"name": "dahl", "stiffness": 1.5e5, "coulomb_force": 17.9, "viscous_coefficient": 10.0}
    lugre = {**LUGRE, "static_force": 18.0}
    signals = recorded(dahl, {"name": "stepped_sine", "amplitude": 25.0, "points": 20})
    result = comparison(candidates=[lugre, dahl]).estimate(signals)
    assert result.message.startswith("dahl predicts the records best")
    assert metrics(result)["verdict"] == 1


STIFFNESS = [
    409628, 220488, 535451, 337237, 169414, 212502, 105833, 151146, 183516, 175749, 121640, 110768, 71605, 73603
]  # fmt: skip
LIMIT_FORCE = [0.474, 0.316, 1.02, 0.793, 0.87, 1.702, 0.856, 1.411, 1.917, 2.035, 1.462, 3.248, 3.174, 5.825]


@pytest.mark.thorough
def test_a_light_mode_is_found_although_the_viscous_coefficient_hides_it(registry):
    """A viscous coefficient wrong by a factor of two falsifies the observer's response by more than the mode."""
    friction = {"name": "rolling", "stiffness": STIFFNESS, "limit_force": LIMIT_FORCE, "viscous_coefficient": 29.4}
    plant = {
        "name": "modal", "rigid_body_gain": 0.5585, "frequencies": [19.665], "damping_ratios": [0.01925],
        "modal_gain_ratios": [0.05474],
    }  # fmt: skip
    pid = {
        "name": "pid", "proportional": 106.1, "integral_time": 0.924, "derivative_time": 0.1925, "filter_time": 0.0232
    }  # fmt: skip
    delays = {"input_dead_time": 4.9e-4, "output_dead_time": 2.1e-4, "output_time_constants": [1.47e-4]}
    machine = Machine(
        create(registry, Plant, plant),
        create(registry, FrictionModel, friction),
        create(registry, Controller, pid),
        ControlLoop.parse({"sample_time": 2e-4, "divergence_limit": 100.0, "resolution": RESOLUTION, **delays}, "loop"),
        Numerics(),
    )
    sine = {"name": "stepped_sine", "amplitude": 60.0, "min_frequency": 2.0, "points": 16}
    signals = simulate_loop(machine, create(registry, Excitation, sine), lambda _: None)
    wrong = {
        **friction, "stiffness": (0.6 * np.array(STIFFNESS)).tolist(),
        "limit_force": (0.731 * np.array(LIMIT_FORCE)).tolist(), "viscous_coefficient": 57.4,
    }  # fmt: skip
    result = comparison(candidates=[wrong], **delays).estimate(signals)
    assert result.outcome is Outcome.OK, result.message
    assert metrics(result)["rolling: held-out residual"] < 1.1
    (found,) = (fit for fit in result.fits if fit.kind == "plant")
    assert found.component["frequencies"] == pytest.approx([19.665], rel=1e-4)
