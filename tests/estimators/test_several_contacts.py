"""The proposed method with friction at several contacts: P is found although most of the thrust is friction."""

from dataclasses import replace

import numpy as np
import pytest
from fraexp_plugins.controllers.pid import Pid
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.plants.two_mass import TwoMass

from fraexp.components.kinds import Estimator
from fraexp.components.registry import create
from fraexp.errors import ParameterError, RecordError
from tests.machines import FRICTIONLESS, decibel, degrees, guide, simulated
from tests.refusals import refused

DRIVE = TwoMass(motor_mass=3.0, load_mass=5.0, stiffness=2e5, damping=20.0)
CONTROLLER = Pid(proportional=8000.0, derivative_time=0.04, filter_time=0.004)
MOTOR, LOAD = guide(17.9, 46.8e-6, 4.69), guide(8.0, 50e-6, 2.0, elements=8)
GRID = tuple(np.geomspace(2.0, 200.0, 8))
DEAD_TIME = 1e-3


def record(frictions, amplitude, position="", frequencies=GRID):
    return simulated(frictions, frequencies, amplitude, plant=DRIVE, controller=CONTROLLER, steps=10, position=position)


def without_motor_encoder(signals):
    return replace(signals, units={name: unit for name, unit in signals.units.items() if name != "y.motor"})


def observer(frictions, **changes):
    given = {"frictions": frictions, "nominal_plant": DRIVE, "input_dead_time": DEAD_TIME, "relative_degree": 3}
    return EffectiveInput(**{**given, **changes})


def errors(response, position="load"):
    ratio = response.response / DRIVE.ports().response(2 * np.pi * response.frequency, position)
    return np.abs(decibel(ratio)).max(), np.abs(degrees(ratio)).max()


@pytest.mark.thorough
@pytest.mark.parametrize("load", [FRICTIONLESS, LOAD])
def test_friction_at_one_end_or_both_is_taken_off(load):
    """The friction models are driven by the encoders at their ends, and the response is that of the load's position."""
    frictions = {"motor": MOTOR, "load": load}
    signals = record(frictions, 20.0)
    settings = {"output": "y.load", "input_dead_time": DEAD_TIME}
    conventional = Conventional(refer_to_plant=True, relative_degree=3, **settings).estimate(signals).response
    assert errors(conventional)[0] > 10
    magnitude, phase = errors(observer(frictions, output="y.load").estimate(signals).response)
    assert magnitude < 0.02
    assert phase < 0.1


@pytest.mark.thorough
def test_the_motors_motion_is_reconstructed_from_the_loads():
    frictions = {"motor": MOTOR, "load": LOAD}
    signals = without_motor_encoder(record(frictions, 20.0, position="load"))
    magnitude, phase = errors(observer(frictions, position="load").estimate(signals).response)
    assert magnitude < 0.02
    assert phase < 0.1


@pytest.mark.thorough
def test_the_band_contains_what_a_wrong_nominal_plant_costs():
    """Nominal plants 2 % wrong, drawn at random: the stated deviation of their parameters covers P."""
    frictions = {"motor": MOTOR, "load": LOAD}
    signals = without_motor_encoder(record(frictions, 20.0, "load", (2.0, 8.0, 25.0, 90.0)))
    names, draws, inside = ("motor_mass", "load_mass", "stiffness", "damping"), 20, 0
    random = np.random.default_rng(1)
    for _ in range(draws):
        factors = 1 + 0.02 * random.standard_normal(len(names))
        wrong = TwoMass(**{name: getattr(DRIVE, name) * factor for name, factor in zip(names, factors, strict=True)})
        deviations = [{"parameter": name, "std": 0.02 * getattr(wrong, name)} for name in names]
        given = {"nominal_plant": wrong, "position": "load", "plant_deviations": deviations}
        response = observer(frictions, **given).estimate(signals).response
        plant = DRIVE.ports().response(2 * np.pi * response.frequency, "load")
        change = 1 / plant - 1 / response.response
        parts = np.stack([change.real, change.imag], axis=1)
        inside += np.sum(np.einsum("ni,nij,nj->n", parts, np.linalg.inv(response.model_covariance), parts) < 5.99)
    assert inside >= 0.87 * draws * 4  # 95 % less two and a half standard deviations


@pytest.fixture(scope="module")
def rubbing_motor():
    """The signals of a drive whose motor alone has friction."""
    return record({"motor": MOTOR, "load": FRICTIONLESS}, 20.0)


def test_friction_at_the_thrust_needs_no_plant(rubbing_motor):
    """Whatever the nominal plant is, friction at the motor acts as its thrust does."""
    frictions = {"motor": MOTOR, "load": FRICTIONLESS}
    wrong = TwoMass(motor_mass=1.0, load_mass=9.0, stiffness=5e4)
    found = observer(frictions, nominal_plant=wrong, output="y.load").estimate(rubbing_motor).response
    assert errors(found)[0] < 0.02


@pytest.mark.parametrize(
    ("changes", "names"),
    [
        ({"output": "y.lod"}, ("output", "'y.lod'", "y, y.load")),
        ({"frictions": {"lod": MOTOR}}, ("effective_input.frictions", "'lod'", "motor, load")),
        ({"thrust": "lod"}, ("'lod'", "motor")),
    ],
)
def test_what_does_not_fit_is_named(rubbing_motor, changes, names):
    with refused(ParameterError, *names):
        observer(**{"frictions": {"motor": MOTOR, "load": LOAD}, **changes}).estimate(rubbing_motor)


def test_two_unknown_displacements_are_too_many(rubbing_motor):
    units = {name: unit for name, unit in rubbing_motor.units.items() if not name.startswith("y")}
    with refused(ParameterError, "motor", "load", "y.NAME"):
        observer({"motor": MOTOR, "load": LOAD}).estimate(replace(rubbing_motor, units=units))


@pytest.mark.parametrize("given", [{"friction": MOTOR.spec()}, {"laws": ["rolling"]}], ids=["friction", "laws"])
def test_methods_for_one_contact_refuse_the_record_of_several(given, registry):
    spec = {"name": "maximum_likelihood", "input_dead_time": DEAD_TIME, **given}
    method, few = create(registry, Estimator, spec), (20.0, 40.0)
    both = record({"motor": MOTOR, "load": LOAD}, 60.0, frequencies=few)
    with refused(RecordError, "motor, load", "maximum_likelihood.frictions"):
        method.estimate(both)


def test_a_method_for_one_contact_refuses_a_model_for_each(registry):
    frictions = {"motor": MOTOR.spec(), "load": LOAD.spec()}
    with refused(ParameterError, "hysteresis", "motor, load", "effective_input", "maximum_likelihood"):
        registry.create("estimator", {"name": "hysteresis"}, {"friction": frictions})


def test_a_plant_is_inherited_beside_several_contacts_only(registry):
    """With one contact the nominal plant would be no part of what is computed."""
    experiment = {"friction": {"motor": MOTOR.spec(), "load": LOAD.spec()}, "plant": DRIVE.spec()}
    several = registry.create("estimator", {"name": "effective_input"}, experiment)
    assert (several.friction, several.nominal_plant) == (None, DRIVE)
    one = registry.create("estimator", {"name": "effective_input"}, {**experiment, "friction": MOTOR.spec()})
    assert (one.frictions, one.nominal_plant) == ({}, None)
    with refused(ParameterError, "effective_input.nominal_plant", "frictions"):
        registry.create("estimator", {**one.spec(), "nominal_plant": DRIVE.spec()})
