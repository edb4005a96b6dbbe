"""Higher-order sinusoidal-input describing functions: closed forms, and a loop that answers the harmonics."""

import numpy as np
import pytest
from fraexp_plugins.estimators.higher_order_describing_functions import HigherOrderDescribingFunctions
from fraexp_plugins.excitations.multisine import Multisine
from fraexp_plugins.friction.coulomb import Coulomb
from fraexp_plugins.friction.rolling import Rolling

from fraexp.data.signals import Segment, Signals
from fraexp.errors import RecordError
from tests.machines import guide, simulated
from tests.refusals import refused

SAMPLES = 4000


def static(function, amplitudes=(1.0,)):
    """Return the signals of sines through a static nonlinearity, with a phase."""
    phase = 2 * np.pi * np.arange(SAMPLES) / SAMPLES + 0.3
    segments = [
        Segment(1e-4, {"u": a * np.cos(phase)[None], "y": function(a * np.cos(phase))[None]}, np.array([1]))
        for a in amplitudes
    ]
    return Signals(tuple(segments), {"u": "N", "y": "m"})


def driven(friction, amplitude):
    y = amplitude * np.cos(2 * np.pi * np.arange(SAMPLES) / SAMPLES)
    channels = {"displacement": y[None], "friction": friction.force(y, 1e-4, periodic=True)[None]}
    return Signals((Segment(1e-4, channels, np.array([1])),), {"displacement": "m", "friction": "N"})


def orders(result):
    return {
        curve.name: curve.columns["magnitude"][0] * np.exp(1j * curve.columns["phase"][0])
        for curve in result.curves[:-1]
    }


def test_a_cubic():
    """u + α u³: H1 = 1 + ¾αA², H3 = ¼αA², and the third harmonic is in phase: 0.0232558 of the first."""
    found = orders(
        HigherOrderDescribingFunctions(remove_input_harmonics=False).estimate(static(lambda u: u + 0.1 * u**3))
    )
    assert found["H1"] == pytest.approx(1.075, abs=1e-12)
    assert found["H3"] / found["H1"] == pytest.approx(0.0232558, abs=1e-7)
    assert max(abs(found[name]) for name in ("H2", "H4", "H5", "H6", "H7")) < 1e-12


def test_even_orders_of_a_square():
    found = orders(
        HigherOrderDescribingFunctions(remove_input_harmonics=False).estimate(static(lambda u: u + 0.2 * u**2))
    )
    assert found["H2"] == pytest.approx(0.1, abs=1e-12)
    assert abs(found["H3"]) < 1e-12


@pytest.mark.parametrize(
    ("ratio", "third", "fifth"), [(2.0, 0.1790, 0.0358), (5.0, 0.2732, 0.1076), (10.0, 0.3035, 0.1502)]
)
def test_an_elasto_slide_element(ratio, third, fifth):
    element = Rolling(stiffness=(1.0,), limit_force=(1.0,))
    estimator = HigherOrderDescribingFunctions(input="displacement", output="friction", remove_input_harmonics=False)
    found = orders(estimator.estimate(driven(element, ratio)))
    assert abs(found["H3"] / found["H1"]) == pytest.approx(third, abs=1e-4)
    assert abs(found["H5"] / found["H1"]) == pytest.approx(fifth, abs=1e-4)
    assert abs(found["H2"]) < 1e-9


def test_coulomb_friction_distorts_by_half():
    """A square wave: √(π²/8 - 1) = 0.483426 over all harmonics."""
    estimator = HigherOrderDescribingFunctions(
        input="displacement", output="friction", remove_input_harmonics=False, max_order=50
    )
    result = estimator.estimate(driven(Coulomb(coulomb_force=1.0, static_force=1.0), 1.0))
    square = np.sqrt(sum(1 / k**2 for k in range(3, 51, 2)))
    assert result.metrics[0].value == pytest.approx(square, abs=2e-3)
    assert result.metrics[0].value < 0.483426


def test_friction_makes_odd_orders_alone():
    """On the paper's machine, which the controller holds at a symmetric friction."""
    result = HigherOrderDescribingFunctions(refer_to_plant=True, input_dead_time=1e-3, max_order=3).estimate(
        simulated(guide(), (5.0, 10.0, 15.0, 20.0, 30.0), 12.0, tolerance=1e-7)
    )
    magnitudes = {curve.name: curve.columns["magnitude"] for curve in result.curves[:-1]}
    assert magnitudes["H3"][1] > 100 * magnitudes["H2"][1]
    assert 0.01 < result.metrics[0].value < 1


def test_several_lines_at_once_are_refused():
    wave = Multisine(rms=1.0).periods(1e-3)[0]
    signals = Signals(
        (Segment(1e-3, {"u": wave.waveform[None], "y": wave.waveform[None]}, wave.lines),), {"u": "N", "y": "m"}
    )
    with refused(RecordError, "150 lines", "stepped_sine"):
        HigherOrderDescribingFunctions().estimate(signals)
