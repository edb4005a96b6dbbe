"""A friction model that is wrong: its error follows the error law, and the band of the response holds the plant."""

import numpy as np
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.plants.two_mass import TwoMass
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.signal import resample

from fraexp.analysis.confidence import USUAL_MAGNITUDE, confidence_limits
from fraexp.analysis.fourier import phasors
from fraexp.components.kinds import Plant
from fraexp.data.results import FrequencyResponse
from tests.examples import portion
from tests.machines import LEAD, TABLE, guide, simulated, table_models
from tests.physics.test_contacts import CONTROLLERS

FREQUENCIES = tuple(np.geomspace(2.0, 100.0, 6))
DRIVE = TwoMass(motor_mass=3.0, load_mass=5.0, stiffness=2e5, damping=20.0)
TABLE_FORCE_N, WIDTH_M = 17.9, 46.8e-6
TABLE_FRICTION = guide(TABLE_FORCE_N, WIDTH_M, viscous=0.0)
WRONG = 10 ** (2 * USUAL_MAGNITUDE / 20)
"""Factor by which the plant is beyond the band of a response that is wrong: twice the usual accuracy."""
amplitudes = st.floats(0.3, 5.0)  # over the Coulomb force
errors = st.floats(-0.1, 0.1)
"""Within one standard deviation of what a model is uncertain by where nothing is stated."""
encoders = st.sampled_from([{"resolution": 1e-7}, {"resolution": 1e-7, "noise": 3e-8}, {"noise": 1e-8}])


def estimated(signals, **given: object) -> FrequencyResponse:
    return EffectiveInput(input_dead_time=1e-3, relative_degree=2, **given).estimate(signals).response


def sprung_force(displacement: np.ndarray, stiffness: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """Return the force of springs that slip over a period of displacement, after one period that leads to it."""
    force, forces = np.zeros(stiffness.size), []
    for step in np.tile(np.diff(displacement, prepend=displacement[-1]), 2):
        force = np.minimum(np.maximum(force + stiffness * step, -limit), limit)
        forces.append(force.sum())
    return np.array(forces[displacement.size :])


@settings(max_examples=portion(25))
@given(st.floats(0.7, 1.4), st.floats(0.7, 1.4), amplitudes)
def test_the_inverse_response_is_off_by_the_error_of_the_describing_function(force, deflection, amplitude):
    """1/P̂ - 1/P = N - N̂, with N̂ from slipping springs along the recorded motion."""
    signals = simulated(TABLE_FRICTION, FREQUENCIES, amplitude * TABLE_FORCE_N, steps=16)
    scales = {"force_scale": force, "displacement_scale": deflection, "corrects_friction": False}
    found = estimated(signals, friction=TABLE_FRICTION, **scales)
    wrong = guide(force * TABLE_FORCE_N, deflection * WIDTH_M, 0.0)
    stiffness, limit = np.array(wrong.stiffness), np.array(wrong.limit_force)
    for segment, response in zip(signals.segments, found.response, strict=True):
        omega, line = 2 * np.pi * segment.frequency, segment.lines[0]
        motion, true_force = (phasors(segment, name)[0, 0] for name in ("y", "friction"))
        displacement = resample(segment.channels["y"][-1], 400 * line)
        model, moved = (
            np.fft.rfft(each)[line] for each in (sprung_force(displacement, stiffness, limit), displacement)
        )
        true, shift = true_force / motion, 1 / response - 1 / TABLE.response(omega)[0]
        assert abs(shift - (true - model / moved)) < 2e-3 * abs(true) + 3e-4 * abs(1 / response)


def distance(response: FrequencyResponse, plant: Plant) -> float:
    """Return by which factor the plant is beyond the band's limits of magnitude at a settled frequency, at most."""
    known = response.settled
    ratio = np.abs(plant.response(2 * np.pi * response.frequency[known]) / response.response[known])
    low, high = confidence_limits(response).magnitude[:, known]
    return float(np.maximum(low / ratio, ratio / high).max(initial=0.0))


LAWS = ("rolling", "gms", "elastoplastic", "lugre", "dahl", "coulomb", "rolling_force_slider", "composite")


@settings(max_examples=portion(25))
@example(
    law="coulomb", amplitude=1.33, force=0.022, deflection=-0.093, encoder={"noise": 1e-8}
)  # noise hides that it stands for a part of the period
@given(law=st.sampled_from(LAWS), amplitude=amplitudes, force=errors, deflection=errors, encoder=encoders)
def test_the_band_of_any_law_holds_the_plant(registry, law, amplitude, force, deflection, encoder):
    friction = table_models(registry)[law]
    signals = simulated(friction, FREQUENCIES, amplitude * TABLE_FORCE_N, controller=LEAD, **encoder)
    scales = {"force_scale": 1 + force, "displacement_scale": 1 + deflection}
    response = estimated(signals, friction=friction, **scales, **encoder)
    assert distance(response, TABLE) < WRONG


@settings(max_examples=portion(10))
@given(amplitudes, errors, errors, encoders)
def test_the_band_of_two_contacts_holds_the_plant(amplitude, motor, load, encoder):
    def models(*factors: float) -> dict[str, object]:
        return {"motor": guide(12.0 * factors[0]), "load": guide(6.0 * factors[1], elements=8)}

    signals = simulated(
        models(1, 1), FREQUENCIES, amplitude * 18.0, plant=DRIVE, controller=CONTROLLERS["two_mass"], **encoder
    )
    response = estimated(signals, frictions=models(1 + motor, 1 + load), nominal_plant=DRIVE, **encoder)
    assert distance(response, DRIVE) < WRONG
