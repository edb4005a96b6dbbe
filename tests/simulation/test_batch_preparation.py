"""The arrays of a batch: one row for each machine, and experiments that share one."""

from dataclasses import replace

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
    assert batch.machines.shape[0] == 1
    assert batch.jobs["machine"].tolist() == [0, 0, 0]
    assert len(set(batch.jobs["seed"].tolist())) == 3


def test_setups_are_counted_in_the_order_of_their_experiments() -> None:
    one = setup()
    other = replace(one, frictions={"table": FRICTIONLESS}, reference=1e-3)
    batch = prepare_batch(plans([one, other, one, other]), one)
    assert batch.machines.shape[0] == 2
    assert batch.jobs["machine"].tolist() == [0, 1, 0, 1]
    assert batch.jobs["reference"].tolist() == [0.0, 1e-3, 0.0, 1e-3]


def test_periods_lie_one_after_another_before_silence() -> None:
    one = setup()
    batch = prepare_batch(plans([one, one]), one)
    assert batch.jobs["first_sample"].tolist() == [0, 100]
    assert batch.waveforms.size == 300
    assert not batch.waveforms[200:].any()
