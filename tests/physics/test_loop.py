"""The simulated loop against exact sampled-data results and an independent library."""

from dataclasses import replace

import control
import numpy as np
import pytest
from fraexp_plugins.controllers.pid import Pid
from fraexp_plugins.controllers.transfer_function import TransferFunction
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.excitations.stepped_sine import SteppedSine

from fraexp.analysis.delays import hold_response, image_factor, path_response
from fraexp.analysis.fourier import phasors
from fraexp.components.ports import StateSpace
from fraexp.data.results import Outcome
from fraexp.errors import ParameterError
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics
from tests.examples import some
from tests.machines import FRICTIONLESS, LEAD, TABLE, decibel, degrees, guide, simulated
from tests.refusals import refused

SAMPLE = 500e-6
FREQUENCIES = (1.0, 5.0, 22.0, 39.0, 80.0, 199.0)


def sampled(omega: np.ndarray, dead_time: float, plant=TABLE) -> np.ndarray:
    """Exact response of the plant after hold and dead time, sampled: the images' sum, from its state space."""
    model: StateSpace = plant.state_space()
    whole, rest = divmod(dead_time + 1e-15, SAMPLE)
    identity = np.eye(model.b.size)
    z = np.exp(1j * omega * SAMPLE)
    result = []
    from scipy.linalg import expm

    def held(time: float) -> tuple[np.ndarray, np.ndarray]:
        block = np.zeros((model.b.size + 1, model.b.size + 1))
        block[:-1, :-1], block[:-1, -1] = model.a, model.b
        big = expm(block * time)
        return big[:-1, :-1], big[:-1, -1]

    transition, gamma = held(SAMPLE)
    late = held(SAMPLE - rest)[1]
    for value in z:
        drive = late + (gamma - late) / value
        result.append(model.c @ np.linalg.solve(value * identity - transition, drive) * value**-whole)
    return np.array(result)


@pytest.mark.parametrize("dead_time", [0.0, 1e-3, 0.37e-3, 1.234e-3])
def test_without_friction_both_methods_give_the_sampled_plant(dead_time):
    signals = simulated(FRICTIONLESS, FREQUENCIES, tolerance=1e-8, input_dead_time=dead_time)
    conventional = Conventional().estimate(signals).response
    method = EffectiveInput(friction=FRICTIONLESS, input_dead_time=dead_time)
    with_images = method.model_copy(update={"interpolation_tolerance": 0.1})
    plant, proposed = (each.estimate(signals).response for each in (method, with_images))
    omega = 2 * np.pi * conventional.frequency
    truth = sampled(omega, dead_time)
    path = path_response(omega, dead_time, ()) * hold_response(omega, SAMPLE)
    path = path * image_factor(omega, SAMPLE, dead_time, (), 2)
    assert np.max(np.abs(conventional.response / truth - 1)) < 1e-6
    assert np.max(np.abs(proposed.response * path / truth - 1)) < 1e-6
    assert np.max(np.abs(plant.response / TABLE.response(omega) - 1)) < 1e-4


def test_images_are_exact_for_a_double_integrator():
    omega = 2 * np.pi * np.array([1.0, 50.0, 200.0, 700.0])
    z = np.exp(1j * omega * SAMPLE)
    exact = SAMPLE**2 / 2 * (z + 1) / (z - 1) ** 2
    found = hold_response(omega, SAMPLE) * image_factor(omega, SAMPLE, 0.0, (), 2) / (1j * omega) ** 2
    assert np.max(np.abs(found / exact - 1)) < 1e-5  # the images beyond the fiftieth


@pytest.mark.parametrize("output_dead_time", [0.0, 0.2e-3, 0.5e-3, 1.3e-3])
def test_lags_and_fractional_delays_on_both_sides_are_undone_exactly(output_dead_time):
    delays = {
        "input_dead_time": 0.7e-3,
        "input_time_constants": (0.3e-3, 0.1e-3),
        "output_dead_time": output_dead_time,
        "output_time_constants": (0.2e-3,),
    }
    signals = simulated(FRICTIONLESS, FREQUENCIES, tolerance=1e-8, **delays)
    response = Conventional(refer_to_plant=True, **delays).estimate(signals).response
    error = response.response / TABLE.response(2 * np.pi * response.frequency) - 1
    assert np.max(np.abs(error)) < 5e-5  # images that the modes shift a little


def test_closed_loop_agrees_with_python_control():
    signals = simulated(FRICTIONLESS, FREQUENCIES, tolerance=1e-8)
    model = TABLE.state_space()
    plant = control.c2d(control.ss(model.a, model.b[:, None], model.c[None, :], 0), SAMPLE, "zoh")
    numerator, denominator = LEAD.transfer_function(SAMPLE)
    feedback = control.tf(numerator, denominator, SAMPLE)
    for segment in signals.segments:
        z = np.exp(2j * np.pi * segment.frequency[0] * SAMPLE)
        loop = plant(z) * z**-2 * feedback(z)
        sensitivity = 1 / (1 + loop)
        bins = np.fft.rfft(segment.channels["u"][-1])[segment.lines[0]] * 2 / segment.samples
        assert abs(bins) == pytest.approx(12 * abs(sensitivity), rel=1e-6)


@pytest.mark.parametrize("amplitude", [12.0, 75.0])
def test_matched_proposed_method_recovers_the_plant_at_any_amplitude(amplitude):
    friction = guide()
    signals = simulated(friction, (1.0, 3.0, 12.0, 25.0, 39.0, 80.0, 150.0, 200.0), amplitude)
    response = EffectiveInput(friction=friction, input_dead_time=1e-3).estimate(signals).response
    ratio = response.response / TABLE.response(2 * np.pi * response.frequency)
    assert np.max(np.abs(decibel(ratio))) < 0.005
    assert np.max(np.abs(degrees(ratio))) < 0.02
    assert response.settled.all()


def describing(friction, amplitude: float) -> complex:
    y = amplitude * np.cos(2 * np.pi * np.arange(4000) / 4000)
    return complex(np.fft.rfft(friction.force(y, 1e-4, periodic=True))[1] / np.fft.rfft(y)[1])


def test_conventional_method_follows_the_describing_function_at_high_frequency():
    friction = guide()
    signals = simulated(friction, (35.0, 40.0, 60.0, 80.0, 120.0, 180.0))  # below, the third harmonic meets a mode
    response = Conventional(refer_to_plant=True, input_dead_time=1e-3).estimate(signals).response
    omega = 2 * np.pi * response.frequency
    plant = TABLE.response(omega)
    n = np.array([describing(friction, a) for a in response.output_amplitude]) + 1j * omega * friction.viscous
    assert np.max(np.abs(decibel(response.response / (plant / (1 + plant * n))))) < 0.15


@pytest.mark.parametrize(("force_scale", "displacement_scale"), [(1.1, 1.0), (0.9, 1.0), (1.0, 1.1), (1.0, 0.9)])
def test_error_law_of_the_proposed_method_above_25_hz(force_scale, displacement_scale):
    friction = guide()
    signals = simulated(friction, (26.0, 40.0, 60.0, 80.0, 120.0, 180.0))
    estimator = EffectiveInput(
        friction=friction, input_dead_time=1e-3, force_scale=force_scale, displacement_scale=displacement_scale
    )
    response = estimator.estimate(signals).response
    plant = TABLE.response(2 * np.pi * response.frequency)
    right = np.array([describing(friction, a) for a in response.output_amplitude])
    wrong = np.array(
        [describing(friction, a / displacement_scale) / displacement_scale for a in response.output_amplitude]
    )
    predicted = 1 / (1 / plant + right - force_scale * wrong)
    assert np.max(np.abs(decibel(response.response / predicted))) < 0.1


def test_halving_the_step_converges_with_second_order():
    friction = guide()
    errors = []
    for steps in (1, 2, 4):
        signals = simulated(friction, (80.5,), steps=steps, tolerance=1e-7)
        response = EffectiveInput(friction=friction, input_dead_time=1e-3).estimate(signals).response
        errors.append(abs(response.response[0] / TABLE.response(2 * np.pi * response.frequency)[0] - 1))
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.25)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.25)


def test_an_unstable_loop_is_an_outcome_with_a_remedy():
    signals = simulated(FRICTIONLESS, (10.0,), controller=Pid(proportional=5e6))
    assert signals.outcome is Outcome.DIVERGED
    assert "at 10 Hz" in signals.message
    assert "controller" in signals.outcome.value
    assert Conventional().estimate(signals).response is None


def test_what_has_not_settled_says_so():
    machine_without_feedback = TransferFunction(numerator=(0.0,))
    signals = simulated(FRICTIONLESS, (200.0,), controller=machine_without_feedback, tolerance=1e-13)
    assert signals.outcome is Outcome.NOT_SETTLED
    assert not Conventional().estimate(signals).response.settled.any()


def test_noise_and_quantisation_are_repeatable_by_seed_and_shape_the_measurement():
    settings = {"resolution": 1e-7, "noise": 3e-8}
    first, same, other = (simulated(FRICTIONLESS, (10.0,), seed=seed, **settings) for seed in (1, 1, 2))
    y = first.segments[0].channels["y"]
    assert np.array_equal(y, same.segments[0].channels["y"])
    assert not np.array_equal(y, other.segments[0].channels["y"])
    assert np.allclose(y / 1e-7, np.round(y / 1e-7), atol=1e-6)
    assert first.segments[0].settling.settled


def test_the_controller_holds_the_machine_about_its_reference():
    integrating = Pid(proportional=6052.9, integral_time=0.3, derivative_time=0.0566, filter_time=0.00629)
    signals = simulated(FRICTIONLESS, (10.0,), controller=integrating, tolerance=1e-9, reference=2e-3)
    assert np.mean(signals.segments[0].channels["y"]) == pytest.approx(2e-3, rel=1e-4)


def test_a_slow_transient_settles_under_noise_too():
    settings = {"resolution": 1e-7, "noise": 1e-7, "seed": 3}
    quiet = simulated(FRICTIONLESS, (45.0,), amplitude=75.0).segments[0].settling
    noisy = simulated(FRICTIONLESS, (45.0,), amplitude=75.0, **settings).segments[0].settling
    assert quiet.settled
    assert noisy.settled
    assert 0.7 < noisy.time < quiet.time  # the stand rings on until it drowns in the noise


def test_lags_after_the_position_do_not_hide_the_motion_from_the_friction_model():
    friction, lags = guide(), (5e-3,)
    signals = simulated(friction, (2.0, 12.0, 30.0), amplitude=75.0, output_time_constants=lags)
    response = (
        EffectiveInput(friction=friction, input_dead_time=1e-3, output_time_constants=lags).estimate(signals).response
    )
    ratio = response.response / TABLE.response(2 * np.pi * response.frequency)
    assert np.max(np.abs(ratio - 1)) < 5e-4


def test_nothing_counts_as_settled_before_it_has_arrived():
    signals = simulated(FRICTIONLESS, (50.0,), controller=TransferFunction(numerator=(0.0,)), input_dead_time=1.5)
    assert signals.segments[0].settling.time > 1.5
    assert np.ptp(signals.segments[0].channels["y"]) > 0


def test_a_scale_that_shows_nothing_is_no_result():
    signals = simulated(guide(), (10.0, 150.0), resolution=1e-3)
    result = Conventional().estimate(signals)
    assert result.outcome is Outcome.NO_MOTION
    assert np.isnan(result.response.response).all()
    assert not result.response.settled.any()


@pytest.mark.parametrize("dead_time", some([0.1, 3.0, 10.0], 3.0))
def test_an_unstable_loop_is_not_taken_for_settled_before_it_has_heard_of_itself(dead_time):
    signals = simulated(guide(), (10.0,), 75.0, input_dead_time=dead_time)
    assert signals.outcome is Outcome.DIVERGED
    assert EffectiveInput(friction=guide()).estimate(signals).outcome is Outcome.DIVERGED


class MovingReference(SteppedSine, name="moving_reference", version=1):
    """A sine in the position reference, and none in the force."""

    def periods(self, sample_time):
        return tuple(
            replace(period, waveform=0.0 * period.waveform, reference=1e-6 * period.waveform)
            for period in super().periods(sample_time)
        )


def test_a_moving_reference_is_followed_as_the_closed_loop_says():
    loop = ControlLoop(sample_time=SAMPLE, input_dead_time=1e-3, reference=2e-3)
    excitation = MovingReference(amplitude=1.0, frequencies=FREQUENCIES, settling_tolerance=1e-8)
    machine = Machine(TABLE, FRICTIONLESS, LEAD, loop, Numerics())
    signals = simulate_loop(machine, excitation, lambda _: None)
    omega = 2 * np.pi * np.array([segment.frequency[0] for segment in signals.segments])
    open_loop = sampled(omega, 1e-3) * LEAD.response(omega, SAMPLE)
    found = np.array([phasors(segment, "y")[0, 0] for segment in signals.segments])
    sent = np.array([phasors(segment, "u")[0, 0] for segment in signals.segments]) / LEAD.response(omega, SAMPLE)
    assert np.max(np.abs(found / (found + sent) / (open_loop / (1 + open_loop)) - 1)) < 1e-6  # r = y + e
    assert np.max(np.abs(np.abs(found + sent) / 1e-6 - 1)) < 1e-6


def test_a_reference_that_does_not_fit_its_waveform_is_refused():
    class Short(SteppedSine, name="short_reference", version=1):
        def periods(self, sample_time):
            return tuple(replace(period, reference=np.zeros(3)) for period in super().periods(sample_time))

    machine = Machine(TABLE, FRICTIONLESS, LEAD, ControlLoop(sample_time=SAMPLE), Numerics())
    with refused(ParameterError, "(3,)", "(400,)"):
        simulate_loop(machine, Short(amplitude=1.0, frequencies=(20.0,)), lambda _: None)
