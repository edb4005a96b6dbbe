"""The arrays of a batch: one row for each machine, and experiments that share one."""

import numpy as np

from fraexp.components.periods import Period, Schedule
from fraexp.simulation.batch_preparation import prepare_batch
from fraexp.simulation.experiments import Experiment, ExperimentPlan, Setup
from fraexp.simulation.loop_setup import prepare_setup
from fraexp.simulation.machine import ControlLoop, Machine, Numerics
from tests.machines import FRICTIONLESS, LEAD, TABLE


def setup() -> Setup:
    return prepare_setup(Machine(TABLE, FRICTIONLESS, LEAD, ControlLoop(sample_time=500e-6, noise=1e-8), Numerics()))


def plans(setups: list[Setup]) -> list[ExperimentPlan]:
    period = Period(np.sin(2 * np.pi * np.arange(100) / 100), np.array([1]))
    experiments = [Experiment(each, period, Schedule(), number) for number, each in enumerate(setups)]
    return [ExperimentPlan.from_experiment(experiment) for experiment in experiments]


def test_experiments_of_one_setup_share_a_machine_and_differ_in_noise() -> None:
    one = setup()
    batch = prepare_batch(plans([one, one, one]), one)
    assert batch.arrays.machines.shape[0] == 1
    assert batch.arrays.jobs["machine"].tolist() == [0, 0, 0]
    assert len(set(batch.arrays.jobs["seed"].tolist())) == 3
