"""Margins of a family of loops are those of its members, found by brute force."""

import numpy as np
import pytest
from fraexp_plugins.controllers.notched_pid import NotchedPid
from fraexp_plugins.plants.modal import Modal
from fraexp_plugins.positioning._shared.design_model import DesignModel
from fraexp_plugins.tuning._shared.gain_search import LoopFamily, closed_loop_radius, damped_plant
from fraexp_plugins.tuning._shared.plant_band import PlantBand, _image

from tests.examples import some
from tests.tuning.loops import BODY, SAMPLE_TIME_S, lead

TS = SAMPLE_TIME_S


def disc_family(radius: float, gain: float = 1.0) -> LoopFamily:
    """Return loops around plants within a relative radius of a body, with a spring and a dashpot as friction."""
    frequency = np.geomspace(1, 900, 4000)
    omega = 2 * np.pi * frequency
    nominal = gain * BODY.response(omega)
    centre, inverse, outside = _image(nominal, radius * np.abs(nominal))
    band = PlantBand(frequency, nominal, radius * np.abs(nominal), centre, inverse, outside)
    friction = np.outer(np.ones(frequency.size), [0.0, 2e4]) + 1j * omega[:, None] * [4.0, 300.0]
    return LoopFamily(band, friction, np.exp(-1.5j * omega * TS), TS, 0.0, 0.0)


@pytest.mark.parametrize("radius", [0.01, 0.1, 0.3])
def test_the_largest_sensitivity_is_that_of_the_worst_plant(radius: float) -> None:
    family, controller = disc_family(radius), lead(6000.0)
    control = family.control(controller)
    angle = np.exp(2j * np.pi * np.arange(720) / 720)
    plants = family.band.nominal[:, None] * (1 + radius * angle)
    for column in range(2):
        inverse = 1 / plants + family.friction[:, column, None]
        brute = np.abs(inverse / (inverse + control[:, None])).max(axis=1)
        found = family.sensitivity(control)[:, column]
        finite = np.isfinite(found)
        assert finite.sum() > 3000
        assert np.all(found[finite] >= brute[finite] * (1 - 1e-9))
        np.testing.assert_allclose(found[finite], brute[finite], rtol=2e-3)


def test_margins_are_those_of_the_nyquist_curve() -> None:
    family, controller = disc_family(0.0), lead(6000.0)
    control = family.control(controller)
    loop = control[:, None] / (1 / family.band.nominal[:, None] + family.friction)
    margins = LoopFamily(family.band, family.friction, family.path, TS, 0.5, 0.0).margins(control)
    assert margins.modulus == pytest.approx(np.abs(1 + loop).min(), rel=0.02)
    gains = np.abs(loop)
    at = np.nonzero(np.diff(np.sign(gains - 1), axis=0))
    expected = np.mod(np.angle(loop[at]) + np.pi, 2 * np.pi).min()
    assert margins.phase == pytest.approx(expected, abs=0.02)
    crossing = [-1 / loop[i, k].real for k in range(2) for i in np.flatnonzero(np.diff(np.sign(loop[:, k].imag)))]
    rising = min(each for each in crossing if each > 1)
    assert margins.gain == pytest.approx(rising, rel=0.02)


def test_a_plant_that_may_vanish_is_safe_with_little_gain_only() -> None:
    family = disc_family(1.2)
    assert family.band.is_outside.all()
    assert np.isinf(family.sensitivity(1e-6 * family.control(lead(6000.0)) - family.friction[:, 0])).any()
    spring_free = LoopFamily(family.band, 0 * family.friction[:, :1], family.path, TS, 0.0, 0.0)
    low = 0.4 / np.abs(family.band.nominal)
    assert np.isfinite(spring_free.sensitivity(low.astype(complex))).all()
    high = (0.9 / np.abs(family.band.nominal)).astype(complex) * np.exp(0.3j)
    assert np.isinf(spring_free.sensitivity(high)).any()


@pytest.mark.parametrize("dead_time", some([0.0, 0.2e-3, 1e-3, 1.3e-3], 0.2e-3))
@pytest.mark.parametrize("order", ["lead", "notched"])
def test_poles_of_the_loop_are_what_it_does_in_time(dead_time: float, order: str) -> None:
    """The impulse response of a loop that is run sample by sample, on a fine grid of time, grows or decays by them."""
    plant = Modal(rigid_body_gain=0.132, frequencies=(38.8,), damping_ratios=(0.02,), modal_gain_ratios=(0.3,))
    notched = NotchedPid(
        proportional=2e4, integral_time=0.1, derivative_time=0.02, filter_time=1e-3,
        notch_frequencies=(38.8,), notch_widths=(0.3,), notch_depths=(0.2,),
    )  # fmt: skip
    controller = lead(9000.0) if order == "lead" else notched
    model = DesignModel.from_plant(damped_plant(plant, 5.0), TS, dead_time)
    b, a = controller.transfer_function(TS)
    parts = 10
    fine_state, fine_thrust = model.transition(TS / parts)
    late = round(dead_time / (TS / parts))
    state, history = np.zeros(model.b.size), [0.0] * (late + 1)
    state[1] = 1.0
    errors, controls, record = [0.0] * len(b), [0.0] * len(a), []
    for _ in range(6000):
        errors = [-history[-1 - late], *errors[:-1]]
        control = float(np.dot(b, errors) - np.dot(a[1:], controls[: len(a) - 1]))
        controls = [control, *controls[:-1]]
        record.append(errors[0])
        for _ in range(parts):
            state = fine_state @ state + fine_thrust * control
            history.append(float(model.measured @ state))
        del history[: -late - 1]
    first, second = np.abs(record[2000:4000]).max(), np.abs(record[4000:]).max()
    assert closed_loop_radius(model, controller) == pytest.approx((second / first) ** (1 / 2000), abs=3e-4)
