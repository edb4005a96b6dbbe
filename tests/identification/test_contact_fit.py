"""Plant and friction at two contacts from one position: a drive of an independent simulation, and what is refused."""

import numpy as np
import pytest

from fraexp.analysis.confidence import circle_factor
from fraexp.components.kinds import Controller, Estimator, Plant
from fraexp.components.registry import create, discover
from fraexp.data.results import Outcome
from fraexp.data.signals import Segment, Signals
from fraexp.errors import ParameterError
from tests.physics.fine_bodies import FineLoop, Sliders

SAMPLE, RESOLUTION, DEAD_SAMPLES = 500e-6, 1e-7, 2
SAMPLES = (400, 250, 160, 110, 64, 44, 36, 28, 20)
"""Samples of a period: 5 to 100 Hz. The drive's mode is at 52 Hz."""
SETTLED_S, SUBSTEPS = 0.6, 12
MASSES, STIFFNESS, DAMPING = (3.0, 5.0), 2e5, 20.0
FRICTION = {"motor": ([4e5, 1.5e5, 6e4], [4.0, 6.0, 5.0], 4.0), "load": ([2e5, 8e4], [2.5, 3.0], 2.0)}
"""Stiffness [N/m] and limit force [N] of the elements, and viscous coefficient [N s/m], of each contact."""
SCALES = ("force_scale", "displacement_scale")
CONTROLLER = {"name": "pid", "proportional": 8000.0, "derivative_time": 0.04, "filter_time": 0.004}


@pytest.fixture(scope="module")
def record():
    """Periods at 20 N of a simulation that shares no code with the loop, their position rounded."""
    coupling = np.array([[1.0, -1.0], [-1.0, 1.0]])
    ports = dict(zip(FRICTION, np.eye(2), strict=True))
    contacts = [Sliders(ports[n], np.array(k), np.array(f), d) for n, (k, f, d) in FRICTION.items()]
    controller = create(discover(), Controller, CONTROLLER).transfer_function(SAMPLE)
    loop = FineLoop(
        np.diag(MASSES), DAMPING * coupling, STIFFNESS * coupling, contacts, ports["motor"], ports, *controller, SAMPLE,
        DEAD_SAMPLES,
    )  # fmt: skip
    segments = []
    for samples in SAMPLES:
        motion, control = loop.last_period(20.0, samples, round(SETTLED_S / SAMPLE / samples) + 2, SUBSTEPS)
        position = np.round(motion[:, 0] / RESOLUTION) * RESOLUTION
        segments.append(Segment(SAMPLE, {"u": control[None, :], "y": position[None, :]}, np.array([1])))
    return Signals(tuple(segments), {"u": "N", "y": "m"})


def plant(factors=(1.0, 1.0, 1.0, 1.0)):
    names = ("motor_mass", "load_mass", "stiffness", "damping")
    values = np.multiply((*MASSES, STIFFNESS, DAMPING), factors).tolist()
    return {"name": "two_mass", **dict(zip(names, values, strict=True))}


def friction(contact, force=1.0, displacement=1.0, viscous=1.0):
    stiffness, limit, coefficient = FRICTION[contact]
    return {
        "name": "rolling", "stiffness": (np.array(stiffness) * force / displacement).tolist(),
        "limit_force": (np.array(limit) * force).tolist(), "viscous_coefficient": viscous * coefficient,
    }  # fmt: skip


def estimator(motor=(1.0, 1.0), load=(1.0, 1.0), numbers=(1.0, 1.0, 1.0, 1.0), **given):
    common = {
        "name": "maximum_likelihood", "nominal_plant": plant(numbers), "resolution": RESOLUTION,
        "frictions": {"motor": friction("motor", *motor), "load": friction("load", *load)}, "noise": 0.0,
        "input_dead_time": DEAD_SAMPLES * SAMPLE,
    }  # fmt: skip
    return create(discover(), Estimator, {**common, **given})


@pytest.mark.thorough
def test_plant_and_friction_of_both_contacts_are_found_from_a_wrong_start(record, registry):
    wrong = {"motor": (1.15, 0.9, 0.9), "load": (0.85, 1.1, 1.2), "numbers": (1.1, 0.9, 0.88, 1.2)}
    result = estimator(**wrong).estimate(record)
    assert result.outcome is Outcome.OK, result.message
    response = result.response
    truth = create(registry, Plant, plant()).response(2 * np.pi * response.frequency)
    radius = circle_factor(np.inf) * response.standard_deviation + response.numerical_error * np.abs(truth)
    assert (np.abs(response.response - truth) <= radius).all()
    assert (radius < 0.01 * np.abs(truth)).all()
    known = {metric.name: metric.value for metric in result.metrics}
    scales = {f"{c}.{s}": 1 / f for c in ("motor", "load") for s, f in zip(SCALES, wrong[c][:2], strict=True)}
    viscous = {f"{contact}.viscous_coefficient": own[2] for contact, own in FRICTION.items()}
    numbers = {key: value for key, value in plant().items() if key != "name"}
    for name, value in {**scales, **viscous, **numbers}.items():
        assert known[name] == pytest.approx(value, abs=1.5 * known[f"{name}, 95 %"]), name
        assert known[f"{name}, 95 %"] < (0.1 if name in (*viscous, "damping") else 0.01) * value, name
    (fit,) = result.fits
    assert fit.component["name"] == "two_mass"


@pytest.mark.thorough
def test_a_contact_without_its_friction_does_not_fit(record):
    result = estimator(frictions={"motor": friction("motor")}).estimate(record)
    assert result.outcome is Outcome.INACCURATE
    assert result.findings[0].kind == "misfit"


@pytest.mark.thorough
def test_what_is_not_free_stays_as_given_and_the_dead_time_is_found(record):
    free = ["load.force_scale", "stiffness", "input_dead_time"]
    result = estimator(load=(1.05, 1.0), free=free, input_dead_time=0.9e-3).estimate(record)
    known = {metric.name: metric.value for metric in result.metrics}
    assert known["input_dead_time"] == pytest.approx(DEAD_SAMPLES * SAMPLE, abs=1e-7)
    assert result.outcome is Outcome.OK, result.message
    assert known["load.force_scale"] == pytest.approx(1 / 1.05, rel=1e-3)
    assert "motor_mass" not in known
    (fit,) = result.fits
    assert fit.component["motor_mass"] == MASSES[0]


def test_what_does_not_go_together_is_refused():
    with pytest.raises(ParameterError, match=r"no parameter 'motor.force_scales' that is not 0; did you mean"):
        estimator(free=["motor.force_scales"])
    with pytest.raises(ParameterError, match="free names 'stiffness' twice"):
        estimator(free=["stiffness", "stiffness"])
    positioned = {**friction("load"), "position_dependence": {"cogging": [{"period": 0.02, "amplitude": 1.0}]}}
    with pytest.raises(ParameterError, match=r"frictions\.load has a position_dependence"):
        estimator(frictions={"motor": friction("motor"), "load": positioned})
    with pytest.raises(ParameterError, match=r"the nominal plant has no contact 'nut'; known: motor, load"):
        estimator(frictions={"nut": friction("motor")})


def test_a_study_fills_in_the_models_of_the_contacts_or_that_of_one(registry):
    spec = {"name": "maximum_likelihood", "nominal_plant": plant()}
    both = {"friction": {contact: friction(contact) for contact in FRICTION}}
    assert list(registry.create("estimator", spec, both).frictions) == ["motor", "load"]
    one = registry.create("estimator", {"name": "maximum_likelihood"}, {"friction": friction("motor")})
    assert (one.law.name, one.frictions) == ("rolling", {})
    with pytest.raises(ParameterError, match="nominal_plant is missing; expected the plant of all contacts"):
        registry.create("estimator", {"name": "maximum_likelihood"}, both)
