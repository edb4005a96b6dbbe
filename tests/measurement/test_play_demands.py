"""What is predicted of a play that is stopped, against the motion after a stop at each of its samples."""

import numpy as np
import pytest
from fraexp_plugins.friction.coulomb import Coulomb
from scipy.linalg import expm

from fraexp.components.kinds import FrictionModel
from fraexp.components.machine_session import PlayRequest
from fraexp.measurement.measurement_plan import planning_setup
from fraexp.measurement.play_demands import SimulatedPlay, simulate_demands
from fraexp.simulation.experiment_run import LiveLoop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics
from fraexp.simulation.motion_limits import NO_DEMAND, Demand
from tests.machines import FRICTIONLESS, LEAD, TABLE

SAMPLE_TIME, SILENCE = 1e-3, 4000


def shortfall(period: int, repetitions: int, settling: int) -> float:
    """Return the greatest demand of a stop at each third sample of a sine, over what a close look finds."""
    setup = planning_setup(Machine(TABLE, FRICTIONLESS, LEAD, ControlLoop(sample_time=SAMPLE_TIME), Numerics()))
    request = PlayRequest(0, 60 * np.sin(2 * np.pi * np.arange(period) / period), repetitions, 0.02, 10)
    (found,) = simulate_demands([SimulatedPlay(setup, request, [1], settling, NO_DEMAND)], closely=True)
    asked = []
    for stop in range(1, request.full_samples, 3):
        moved = LiveLoop(setup).play(request.excitation(0, stop + request.ramp_out + SILENCE, stop))
        asked.append(Demand.of_samples(moved["displacement"], moved["u"], SAMPLE_TIME))
    return float((np.max(asked, axis=0) / np.array(found)).max())


@pytest.mark.parametrize(("period", "repetitions", "settling"), [(29, 20, 25), (17, 3, 2)])
def test_no_stop_of_a_short_play_asks_for_more_than_a_close_look_finds(
    period: int, repetitions: int, settling: int
) -> None:
    """Without friction, what follows a stop takes longer than the play itself to come to rest.

    The last play ends still by itself; stopped before, it goes 1.4 times as far as it has gone a few samples later.
    """
    assert shortfall(period, repetitions, settling) < 1.005


def rising_force_rate(noise: float, seed: int) -> float:
    """Return the force rate that is found of a play that rises at once."""
    loop = ControlLoop(sample_time=SAMPLE_TIME, noise=noise, seed=seed)
    setup = planning_setup(Machine(TABLE, FRICTIONLESS, LEAD, loop, Numerics()))
    request = PlayRequest(0, np.cos(2 * np.pi * np.arange(200) / 200), 2, 1.0, 50)
    (demand,) = simulate_demands([SimulatedPlay(setup, request, [1], 25, NO_DEMAND)])
    return demand.force_rate


def test_a_rise_that_all_stops_have_in_common_is_judged_by_more_than_one_noise() -> None:
    """One noise takes off as much as it adds where the force rate is greatest in a single sample."""
    assert min(rising_force_rate(1e-7, seed) for seed in range(4)) > rising_force_rate(0.0, 0)


def velocity_of_held_force(force: np.ndarray, delay: int, parts: int) -> np.ndarray:
    """Return the velocity of the table in `parts` of each sample, for a held force that acts `delay` parts later."""
    modes = zip(TABLE.frequencies, TABLE.damping_ratios, TABLE.modal_gain_ratios, strict=True)
    kinds = [(0.0, 0.0, 1.0), *((2 * np.pi * frequency, damping, ratio) for frequency, damping, ratio in modes)]
    total = np.zeros(force.size * parts)
    for omega, damping, ratio in kinds:
        gain = TABLE.rigid_body_gain * ratio
        block = np.array([[0.0, 1.0, 0.0], [-(omega**2), -2 * damping * omega, gain], [0.0, 0.0, 0.0]])
        step, state = expm(block * SAMPLE_TIME / parts), np.zeros(3)
        for k in range(total.size):
            state[2] = force[(k - delay) // parts] if k >= delay else 0.0
            state = step @ state
            total[k] += state[1]
    return total


@pytest.mark.parametrize("friction", [FRICTIONLESS, Coulomb(coulomb_force=1e-6)])
@pytest.mark.parametrize("waveform", [(1, 1, 1, -3), (1, -1), (1, 0, -1, 0), (1, 1, -1, -1, 1, -2, 1)])
def test_velocities_between_few_samples_a_period_are_found(waveform: tuple[int, ...], friction: FrictionModel) -> None:
    """Between samples the table is faster than the samples show, for a force that alternates from one to the next."""
    loop = ControlLoop(sample_time=SAMPLE_TIME, input_dead_time=0.2 * SAMPLE_TIME)
    setup = planning_setup(Machine(TABLE, friction, LEAD, loop, Numerics()))
    request = PlayRequest(0, np.array(waveform, dtype=float), 100 // len(waveform), 0.2, 10)
    (found,) = simulate_demands([SimulatedPlay(setup, request, [1], 25, NO_DEMAND)])
    moved = LiveLoop(setup).play(request.excitation(0, request.full_samples, request.full_samples))
    velocity = velocity_of_held_force(moved["u"], 2, 10)
    mean = velocity.reshape(-1, 10).mean(axis=1)[5:-1] * SAMPLE_TIME
    assert np.diff(moved["displacement"])[5:] == pytest.approx(mean, abs=0.1 * np.ptp(mean))
    assert np.abs(velocity).max() <= found.velocity < 2.5 * np.abs(velocity).max()
