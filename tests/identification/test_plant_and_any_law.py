"""Plant and friction whatever the law is: accuracy on simulated machines, intervals, and what is refused."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.friction.lugre import LuGre
from fraexp_plugins.identification._law_report import InverseResponse, identify_plant
from fraexp_plugins.identification._law_selection import sum_interval
from fraexp_plugins.identification.modal_fit import ModalFit
from fraexp_plugins.identification.plant_and_friction import PlantAndFriction
from fraexp_plugins.plants.modal import Modal

from fraexp.api import significant_deviation
from fraexp.data.results import Outcome
from fraexp.study.accuracy import Accuracy
from tests.identification.plant_responses import MACHINE, SCALE, measured
from tests.responses import judged

ESTIMATOR = PlantAndFriction(law="any", estimate_dead_time=True, validation=1, **SCALE)
FORCE, VISCOUS = 17.9, 4.69
LUGRE = {
    "name": "lugre", "bristle_stiffness": 0.4e6, "bristle_damping": 100.0, "viscous_coefficient": VISCOUS,
    "coulomb_force": FORCE, "static_force": 1.2 * FORCE, "stribeck_velocity": 1e-3,
}  # fmt: skip
WEAKENING = {
    "name": "gms", "stiffness": [0.1 * FORCE / (3e-6 * i) for i in range(1, 11)], "force_fractions": [0.1] * 10,
    "coulomb_force": FORCE, "static_force": 1.06 * FORCE, "stribeck_velocity": 0.04, "attraction_rate": 13 * FORCE,
    "viscous_coefficient": VISCOUS,
}  # fmt: skip
"""Friction that falls by 6 % in sliding, at velocities that few records reach, and with a lag of 77 ms."""


SINE = {"name": "stepped_sine", "points": 10, "recorded_periods": 2, "min_record_time": 0.3, "ramp": 0.5}
FRESH = {"name": "multisine", "rms": 2 * FORCE, "line_spacing": 1.0, "max_frequency": 100, "points": 12,
         "detection_group_size": 0}  # fmt: skip
LEVELS = {"name": "concatenated", "parts": [*({**SINE, "amplitude": r * FORCE} for r in (0.9, 1.4, 2.5, 6.0)), FRESH]}


def test_a_sum_that_others_may_replace_has_a_wide_interval() -> None:
    columns = np.array([[3.0, 3.0, 0.0], [4.0, 4.0, 0.0], [0.0, 0.0, 2.0]])
    target, rise = columns @ [1.0, 1.0, 4.0], 1.0
    # the first two columns are equal: together 2 +- 1/5, of which the first may have any part
    low, high = sum_interval(columns, target, np.array([True, False, False]), rise)
    assert (low, high) == (0.0, pytest.approx(2.2, abs=0.01))
    assert sum_interval(columns, target, np.array([True, True, False]), rise) == pytest.approx((1.8, 2.2), abs=0.01)
    assert sum_interval(columns, target, np.array([False, False, True]), rise) == pytest.approx((3.5, 4.5), abs=0.01)
    # both sums together: 6 +- sqrt(1/5² + 1/2²)
    sides = sum_interval(columns, target, np.ones(3, dtype=bool), rise)
    assert sides == pytest.approx((6 - np.hypot(0.2, 0.5), 6 + np.hypot(0.2, 0.5)), abs=0.01)


@pytest.mark.parametrize("viscous", [-8.0, 8.0])
def test_friction_that_falls_with_velocity_is_noticed_in_the_plant(viscous: float) -> None:
    """The Coulomb force is then lower beyond the records; the static force was taken for it, with a narrow interval."""
    frequency = np.geomspace(1.0, 100.0, 25)
    s = 2j * np.pi * frequency
    noise = (1e-3 * np.abs(20.0 * s**2)) ** 2
    inverse = InverseResponse(frequency, 20.0 * s**2 + viscous * s, noise, np.zeros((frequency.size, 1), complex))
    response = measured(Modal(rigid_body_gain=0.05), known=True, dead_time=0.0, frequency=frequency)
    plant = identify_plant(inverse, response, ModalFit(method=Conventional(), modes=0, dead_time=0.0))
    assert (plant.fall > significant_deviation(), plant.viscous > 0) == (viscous < 0, viscous > 0)


@pytest.mark.thorough
@pytest.mark.parametrize(("friction", "lag"), [(MACHINE["friction"], 0.0), (LUGRE, 0.0), (LUGRE, 8e-4)])
def test_plant_and_force_are_found_whatever_the_law(friction: dict[str, Any], lag: float, recorded: Any) -> None:
    signals = recorded(LEVELS, friction, input_time_constants=[lag] if lag else [])
    result = judged(ESTIMATOR, signals)
    metrics = {metric.name: metric.value for metric in result.metrics}
    assert result.outcome is Outcome.OK, result.message
    assert abs(metrics["Coulomb force"] - FORCE) <= metrics["Coulomb force, 95 %"]
    assert metrics["k0"] == pytest.approx(0.132, rel=0.01)
    assert metrics["f1"] == pytest.approx(38.8, abs=0.2)
    assert metrics["Coulomb force"] == pytest.approx(FORCE, rel=0.03)
    assert metrics["input_dead_time"] == pytest.approx(1e-3, abs=0.2 * 5e-4)
    assert metrics.get("input_time_constant", 0.0) == pytest.approx(lag, abs=5e-5)
    assert metrics["validation error"] < 0.03
    (table,) = [fit for fit in result.fits if fit.kind == "friction"]
    for name, value, deviation in zip(table.parameters, table.values, table.standard_deviation, strict=True):
        if name in friction and deviation > 0 and name != "viscous_coefficient":
            assert abs(value - friction[name]) <= 1.96 * deviation, name


@pytest.mark.thorough
def test_a_wrong_channel_has_no_good_verdict(recorded: Any) -> None:
    signals = recorded(LEVELS)
    gains = np.linspace(0.7, 1.3, len(signals.segments))  # a drive that applies another force than it reports
    order = np.random.default_rng(1).permutation(gains.size)
    segments = tuple(
        replace(segment, channels={**segment.channels, "u": gain * segment.channels["u"]})
        for segment, gain in zip(signals.segments, gains[order], strict=True)
    )
    few = ESTIMATOR.model_copy(update={"law": "elements", "laws": (LuGre,)})  # all would search for long
    result = judged(few, replace(signals, segments=segments))
    assert result.outcome is Outcome.INACCURATE


@pytest.mark.thorough
def test_friction_that_hides_its_weakening_has_no_false_verdict(recorded: Any) -> None:
    denser = {**LEVELS, "parts": [*({**part, "points": 16} for part in LEVELS["parts"][:-1]), FRESH]}
    signals = recorded(denser, {**WEAKENING, "stribeck_velocity": 0.1})
    result = judged(ESTIMATOR, signals)
    metrics = {metric.name: metric.value for metric in result.metrics}
    error = abs(metrics["Coulomb force"] - FORCE)
    assert error <= metrics["Coulomb force, 95 %"]
    allowed = Accuracy().relative_error
    assert result.outcome is not Outcome.OK or metrics["Coulomb force, 95 %"] <= allowed * metrics["Coulomb force"]
    assert metrics["validation error"] < 0.03  # which does not see it
