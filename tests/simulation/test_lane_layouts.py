"""An experiment has the same bits in each layout of lanes: how many there are, and whether they share constants."""

from dataclasses import replace

import numpy as np
import pytest

from fraexp.components.periods import Period, Schedule
from fraexp.kernels.lane_layout import choose_layout
from fraexp.kernels.lanes import NARROW, WIDE
from fraexp.simulation.experiment_run import run_experiments
from fraexp.simulation.experiments import Experiment, Setup
from fraexp.simulation.loop_setup import prepare_setup
from fraexp.simulation.machine import ControlLoop, Machine, Numerics
from tests.examples import some
from tests.machines import LEAD, TABLE, guide


@pytest.fixture(scope="module")
def setup() -> Setup:
    return prepare_setup(
        Machine(TABLE, guide(), LEAD, ControlLoop(sample_time=500e-6, noise=1e-8), Numerics(steps_per_sample=5))
    )


def position(setups: list[Setup]) -> np.ndarray:
    """Return the position [m] that the first of several experiments records, each of which has another frequency."""
    phases = [2 * np.pi * (number + 1) * np.arange(100) / 100 for number in range(len(setups))]
    periods = [Period(12.0 * np.sin(phase), np.array([number + 1])) for number, phase in enumerate(phases)]
    experiments = [
        Experiment(each, period, Schedule(ramp=0.1), number)
        for number, (each, period) in enumerate(zip(setups, periods, strict=True))
    ]
    first = run_experiments(experiments, lambda _: None)[0]
    assert first is not None
    return first.channels["y"]


@pytest.mark.parametrize("count", [2, NARROW + 1])
@pytest.mark.parametrize("is_shared", some([False, True], True))
def test_an_experiment_has_the_same_bits_in_each_layout(setup: Setup, count: int, is_shared: bool) -> None:
    others = [setup if is_shared else replace(setup) for _ in range(count - 1)]
    assert np.array_equal(position([setup, *others]), position([setup]))


def test_wide_vectors_serve_more_experiments_than_narrow_ones_hold() -> None:
    assert [choose_layout(True, count, 1).width for count in (1, NARROW, NARROW + 1)] == [NARROW, NARROW, WIDE]
    assert [choose_layout(True, 20, machines).is_shared for machines in (1, 2)] == [True, False]
    assert choose_layout(False, 20, 1).width == 1
