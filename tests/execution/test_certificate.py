"""What is called ok is within its tolerance, or says that it is not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fraexp_plugins.estimators.conventional import Conventional

from fraexp.components.kinds import Plant
from fraexp.components.registry import Registry, create
from fraexp.data.results import Outcome, Result
from fraexp.data.signals import Verification
from fraexp.errors import ParameterError
from fraexp.execution.job import run_job
from fraexp.execution.sent_jobs import Job
from fraexp.execution.verdict import NUMERICAL_ERROR, certify
from fraexp.study.accuracy import Accuracy
from fraexp.study.study_file import load
from tests.machines import guide, simulated
from tests.refusals import refused

TABLE = {"name": "modal", "rigid_body_gain": 0.132, "viscous_coefficient": 0.0}


SINE = {"name": "stepped_sine", "amplitude": 25.0}
FREQUENCIES = [3.0, 5.0, 8.0, 12.0, 20.0, 30.0, 50.0, 80.0]
EXPERIMENT = {
    "source": "loop",
    "plant": TABLE,
    "controller": {"name": "pid", "proportional": 800.0, "derivative_time": 0.03, "filter_time": 0.004},
    "loop": {"sample_time": 5e-4, "input_dead_time": 1e-3},
    "numerics": {"tolerance": 1e-4},
}


def computed(friction: dict, steps: int = 0, frequency: float = 2.94, accuracy: float = 0.5) -> list[Result]:
    """Return what both methods find on a table at one frequency and its double."""
    experiment = {
        **EXPERIMENT,
        "friction": friction,
        "excitation": {**SINE, "frequencies": [frequency, 2 * frequency]},
        "numerics": {"tolerance": 1e-4, "steps_per_sample": steps},
        "accuracy": {"magnitude": accuracy},
    }
    observer = {"name": "effective_input", "friction": friction, "input_dead_time": 1e-3}
    results = run_job(Job(experiment, ({"name": "conventional"}, observer)), lambda _: None)
    assert all(isinstance(result, Result) for result in results), results
    return results


STICK = """
machine = "linear_motor_table"
friction = { name = "coulomb", coulomb_force = 17.9, viscous_coefficient = 4.69 }
loop = { resolution = 0.0 }
excitation = { name = "stepped_sine", amplitude = 25.0, frequencies = [2.0, 2.94, 4.33, 6.37, 12.0] }
estimator = { name = "effective_input" }
"""
ELEMENTS = {"name": "rolling", "stiffness": [4e5, 6e4, 1e4], "limit_force": [4.0, 8.0, 5.0], "viscous_coefficient": 5.0}


def test_a_machine_without_trouble_is_ok():
    for result in computed(ELEMENTS):
        assert result.outcome is Outcome.OK, result.message
        assert 0 < result.response.numerical_error.max() < 0.01


@pytest.mark.parametrize(("accuracy", "kinds"), [(0.5, []), (0.002, ["inexact computation"])])
def test_too_few_steps_are_said_where_they_matter(accuracy: float, kinds: list):
    result, _ = computed(ELEMENTS, steps=1, frequency=40.0, accuracy=accuracy)
    assert [found.kind for found in result.findings] == kinds
    assert result.outcome is (Outcome.INACCURATE if kinds else Outcome.OK)


@pytest.mark.parametrize(
    ("accuracy", "kinds"),
    [({}, []), ({"magnitude": 1e-3}, [("band by noise", "dB")]), ({"phase": "0.005 deg"}, [("band by noise", "°")])],
)
def test_a_band_is_judged_by_the_accuracy_of_the_study(accuracy: dict, kinds: list):
    loop = {**EXPERIMENT["loop"], "noise": 2e-6, "seed": 3}
    excitation = {**SINE, "frequencies": [10.0], "recorded_periods": 8}
    experiment = {**EXPERIMENT, "loop": loop, "friction": ELEMENTS, "excitation": excitation, "accuracy": accuracy}
    (result,) = run_job(Job(experiment, ({"name": "conventional"},)), lambda _: None)
    assert [(found.kind, found.quantities[0].unit) for found in result.findings] == kinds
    assert result.outcome is (Outcome.INACCURATE if kinds else Outcome.OK)


def test_an_accuracy_of_nothing_is_refused():
    with refused(ParameterError, "magnitude"):
        Accuracy.parse({"magnitude": 0.0}, "accuracy")
    assert Accuracy.parse({"magnitude": "1 dB", "phase": "5°"}, "accuracy") == Accuracy(
        magnitude=1, phase=np.radians(5)
    )
    with refused(ParameterError, "phase", 5):  # degrees without a word
        Accuracy.parse({"phase": 5}, "accuracy")


@pytest.mark.parametrize(("steps", "outcome"), [(0, Outcome.OK), (2, Outcome.INACCURATE)])
def test_metrics_state_how_exact_the_motion_is(steps: int, outcome: Outcome):
    move = {
        "name": "point_to_point", "targets": [1e-3], "profile": "jerk_limited", "duration": 0.02, "plant": TABLE,
        "friction": ELEMENTS,
    }  # fmt: skip
    numerics = {"tolerance": 1e-5, "steps_per_sample": steps}
    experiment = {**EXPERIMENT, "friction": ELEMENTS, "excitation": move, "numerics": numerics}
    (result,) = run_job(Job(experiment, ({"name": "positioning_metrics", "settling_window": 1e-4},)), lambda _: None)
    error = next(metric for metric in result.metrics if metric.name == NUMERICAL_ERROR)
    assert error.unit == "1"
    assert (0 < error.value <= 1e-5) is (outcome is Outcome.OK)
    assert result.outcome is outcome
    assert ("set numerics.steps_per_sample to 0" in result.message) is (outcome is Outcome.INACCURATE)


def test_friction_that_the_sampled_motion_does_not_show_is_said(registry: Registry, tmp_path: Path):
    """Where it sticks, the force of Coulomb friction is not in the motion: the plant is 10 dB off, and it says so."""
    file = tmp_path / "stick.toml"
    file.write_text(STICK, "utf-8")
    (sweep,) = load("stick", file, Path(__file__).parents[2], registry).sweeps
    (result,) = run_job(Job(sweep.experiment, (sweep.estimator,)), lambda _: None)
    response = result.response
    truth = create(registry, Plant, sweep.experiment["plant"]).response(2 * np.pi * response.frequency)
    error = np.abs(truth / response.response - 1)
    assert result.outcome is Outcome.INACCURATE
    assert "the motion does not show the friction force at standstill and reversal at 5 of 5" in result.message
    assert error.max() > 1
    assert np.all(error <= 2 * response.numerical_error)
    assert np.all(response.numerical_error <= 2 * error)


def test_what_the_motion_does_not_show_is_known_at_every_frequency(registry: Registry):
    """With an ideal encoder no frequency is left out, though only four are simulated again."""
    friction = {**ELEMENTS, "damping": [300.0, 60.0, 20.0]}
    experiment = {**EXPERIMENT, "friction": friction, "excitation": {**SINE, "frequencies": FREQUENCIES}}
    observer = {"name": "effective_input", "friction": friction, "input_dead_time": 1e-3}
    right, wrong = run_job(Job(experiment, (observer, {**observer, "force_scale": 1.1})), lambda _: None)
    assert isinstance(right, Result), right
    assert isinstance(wrong, Result), wrong
    plant = create(registry, Plant, TABLE).response(2 * np.pi * right.response.frequency)
    error = np.abs(right.response.response / plant - 1)
    assert np.all(error <= right.response.numerical_error)
    assert np.all(right.response.numerical_error <= error + 1e-4)
    assert wrong.response.numerical_error == pytest.approx(right.response.numerical_error)


def test_an_error_that_the_estimator_states_itself_is_added():
    """A fit that simulates has errors of its own steps, which those of the record's simulation must not replace."""
    signals = simulated(guide(), (5.0, 20.0), 12.0, tolerance=1e-4)
    found = Conventional().estimate(signals)
    own = replace(found, response=replace(found.response, numerical_error=np.array([3e-4, 0.0])))
    verification = Verification(found.response.frequency, np.full(2, 1e-5), signals.segments, {"y": np.ones(2)}, {})
    result = certify(Conventional(), replace(signals, verification=verification), own, 1e-4)
    assert result.response.numerical_error == pytest.approx([3.1e-4, 1e-5])
    assert result.outcome is found.outcome
