"""Counting the work of a sweep without doing it."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fraexp.components.kinds import Excitation
from fraexp.components.periods import Period, Schedule
from fraexp.components.registry import Registry
from fraexp.execution.estimates.loop_work import looks_vectorised, samples_of
from fraexp.execution.estimates.workload import UNKNOWN_WORK, CountedExperiment, estimator_work, experiment_work
from fraexp.simulation import experiments
from fraexp.simulation.experiments import Setup
from fraexp.simulation.loop_setup import prepare_setup
from fraexp.workspace.workspace_service import WorkspaceService
from tests.machines import FRICTIONLESS, LEAD, TABLE, table_models

LOOP = {"sample_time": 500e-6, "input_dead_time": 1e-3}


@pytest.fixture(scope="module")
def experiment(registry: Registry) -> dict[str, Any]:
    """A loop on the paper's machine at three frequencies."""
    (study,) = WorkspaceService.open(".").studies(["quick"], ["excitation.frequencies=[10, 20, 40]"])
    return dict(study.sweeps[0].experiment)


def counted(experiment: dict[str, Any], registry: Registry, **excitation: Any) -> CountedExperiment:
    changed = {**experiment["excitation"], **excitation}
    return experiment_work({**experiment, "excitation": changed}, registry)


@pytest.fixture(scope="module")
def setup() -> Setup:
    from fraexp.simulation.machine import ControlLoop, Machine, Numerics

    return prepare_setup(Machine(TABLE, FRICTIONLESS, LEAD, ControlLoop.parse(LOOP, "loop"), Numerics()))


@pytest.mark.parametrize("block", [7, 200, 400, 12_000])
@pytest.mark.parametrize(
    "schedule",
    [
        Schedule(),
        Schedule(ramp=0.1, recorded_periods=20),
        Schedule(ramp=0.1, recorded_periods=1, min_record_time=3.0),
        Schedule(settling_timeout=0.0, recorded_periods=4),
    ],
)
def test_samples_are_those_that_the_loop_expects(setup: Setup, block: int, schedule: Schedule) -> None:
    period = Period(np.zeros(block), np.array([1]))
    plan = experiments.ExperimentPlan.from_experiment(experiments.Experiment(setup, period, schedule, 0))
    before, recorded = samples_of(period, schedule, setup.sample_time, setup.delay)
    assert recorded == plan.record
    assert before + recorded == plan.expected_samples


def test_a_stepped_sine_is_counted_frequency_by_frequency(experiment: dict[str, Any], registry: Registry) -> None:
    found = counted(experiment, registry)
    assert found.shape.segments == found.shape.lines == 3
    assert found.shape.recorded >= 3 * 400
    assert not found.shape.repeated
    assert found.rows == found.shape.recorded + found.shape.lead_in
    assert found.work[0].kind == "loop/rolling/lanes"
    assert found.work[0].settling == "settling/stepped_sine/rolling"


def test_more_periods_are_more_work(experiment: dict[str, Any], registry: Registry) -> None:
    one, twenty = (counted(experiment, registry, recorded_periods=periods) for periods in (1, 20))
    assert twenty.shape.recorded == 20 * one.shape.recorded
    assert twenty.shape.repeated
    assert twenty.work[0].seconds > 3 * one.work[0].seconds


def test_eight_frequencies_take_as_long_as_one_where_they_run_side_by_side(
    experiment: dict[str, Any], registry: Registry
) -> None:
    one = counted(experiment, registry, frequencies=[20.0])
    eight = counted(experiment, registry, frequencies=[20.0 + 1e-9 * number for number in range(8)])
    sixteen = counted(experiment, registry, frequencies=[20.0 + 1e-9 * number for number in range(16)])
    assert eight.work[0].seconds == pytest.approx(one.work[0].seconds)
    assert sixteen.work[0].seconds == pytest.approx(2 * one.work[0].seconds)


def test_steps_cost(experiment: dict[str, Any], registry: Registry) -> None:
    few, many = (
        experiment_work({**experiment, "numerics": {"tolerance": 1e-4, "steps_per_sample": steps}}, registry)
        for steps in (8, 80)
    )
    assert 3 < many.work[0].seconds / few.work[0].seconds < 10


def test_an_estimator_is_counted_with_what_it_holds(experiment: dict[str, Any], registry: Registry) -> None:
    shape = counted(experiment, registry, recorded_periods=4).shape
    friction = experiment["friction"]
    nested = {
        "name": "effective_input",
        "friction": friction,
        "oversampling": 4,
        "method": {"name": "local_polynomial"},
    }
    alone = estimator_work({"name": "local_polynomial"}, experiment, shape, registry)
    both = estimator_work(nested, experiment, shape, registry)
    assert [work.kind for work in alone] == ["estimate/local_polynomial"]
    assert [work.kind for work in both] == ["estimate/effective_input+local_polynomial", "drive/rolling/lanes"]
    assert both[0].seconds > alone[0].seconds


def test_an_observer_works_more_where_noise_makes_the_periods_differ(
    experiment: dict[str, Any], registry: Registry
) -> None:
    estimator = {"name": "effective_input", "friction": experiment["friction"]}
    noisy = {**experiment, "loop": {**experiment["loop"], "noise": 30e-9}}
    ideal = {**experiment, "loop": {**experiment["loop"], "noise": 0.0, "resolution": 0.0}}

    def work(of: dict[str, Any], periods: int) -> float:
        shape = counted(of, registry, recorded_periods=periods).shape
        return estimator_work(estimator, of, shape, registry)[0].seconds

    assert work(noisy, 5) > 5 * work(ideal, 5)
    assert work(noisy, 1) == work(ideal, 1)


def test_an_identification_is_more_work_than_a_response(experiment: dict[str, Any], registry: Registry) -> None:
    shape = counted(experiment, registry).shape
    (fast,) = estimator_work({"name": "conventional"}, experiment, shape, registry)
    (slow,) = estimator_work({"name": "plant_and_friction"}, experiment, shape, registry)
    assert slow.seconds > 50 * fast.seconds


def test_a_record_is_counted_by_its_samples(registry: Registry, checkout: Path) -> None:
    (study,) = WorkspaceService.open(checkout).studies(["record"])
    found = experiment_work(study.sweeps[0].experiment, registry)
    segments = study.sweeps[0].experiment["record"]["segments"]
    assert found.shape.recorded == sum(segment["periods"] * segment["samples"] for segment in segments)
    assert found.work[0].kind == "record/csv"


def test_a_fit_that_is_not_there_yet_is_counted_as_the_machines_own_component(
    registry: Registry, checkout: Path
) -> None:
    (study,) = WorkspaceService.open(checkout).studies(["paper/fig08_identified"])
    assert UNKNOWN_WORK not in [experiment_work(sweep.experiment, registry) for sweep in study.sweeps]


class Broken(Excitation, name="broken_in_test", version=1):
    """Raises where it ought to tell its periods."""

    def periods(self, sample_time: float) -> tuple[Period, ...]:
        raise ZeroDivisionError("a stranger's mistake")

    @property
    def schedule(self) -> Schedule:
        return Schedule()


def test_a_plugin_that_fails_while_it_is_counted_breaks_no_plan(experiment: dict[str, Any]) -> None:
    from fraexp.components.registry import discover

    registry = discover()
    registry.add(Broken, "test")
    found = experiment_work({**experiment, "excitation": {"name": "broken_in_test"}}, registry)
    assert found == UNKNOWN_WORK
    assert estimator_work({"name": "not_there"}, experiment, found.shape, registry)[0].seconds > 0


@pytest.mark.parametrize(
    "name", ["rolling", "gms", "elastoplastic", "lugre", "dahl", "coulomb", "rolling_force_slider"]
)
def test_lanes_are_guessed_as_the_compiler_decides(name: str, registry: Registry) -> None:
    model = table_models(registry)[name]
    assert looks_vectorised(model.law) == model.is_vectorisable


@pytest.mark.thorough
def test_a_plan_does_not_load_the_compiler(tmp_path: Path) -> None:
    code = (
        "import sys; from fraexp.workspace.workspace_service import WorkspaceService; "
        f"planned = WorkspaceService.open({str(tmp_path)!r}).plan('quick')[1][0]; "
        "print(planned.seconds > 0, 'numba' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=tmp_path)
    assert done.stdout.split() == ["True", "False"]
