"""A rotary axis is a straight one on a lever: the same motion in other units (closed form: y = R θ, τ = R F)."""

import numpy as np
import pytest

import fraexp
from tests.refusals import refused

ARM = 0.1
"""Lever arm R [m]."""
FACTORS = {
    "rad": 1 / ARM,
    "N m": ARM,
    "kg m**2": ARM**2,
    "N m/rad": ARM**2,
    "N m s/rad": ARM**2,
    "rad/(N m)": ARM**-2,
    "rad/(N m s**2)": ARM**-2,
    "rad/s": 1 / ARM,
    "N m/s": ARM,
}
"""Factor from the number of a straight axis to that of a rotary one, by the latter's unit; 1 for other units."""
STRAIGHT = {
    "plant": {
        "name": "modal", "rigid_body_gain": 0.132, "frequencies": [38.8, 80.0],
        "damping_ratios": [0.04634, 0.02], "modal_gain_ratios": [0.342, 0.3],
    },
    "friction": {
        "name": "rolling", "viscous_coefficient": "4.69 N s/m",
        "curve": {
            "shape": "exponential", "coulomb_force": "17.9 N", "characteristic_displacement": "45.36 um",
            "elements": 20, "min_knot": "0.5 um", "max_knot": "100 um",
        },
    },
    "controller": {
        "name": "pid", "proportional": 6052.93, "derivative_time": 0.0566204, "filter_time": 0.00629115,
    },
    "loop": {"sample_time": 500e-6, "input_dead_time": 1e-3},
}  # fmt: skip
ROTARY = {
    "plant": {**STRAIGHT["plant"], "rigid_body_gain": f"{0.132 / ARM**2!r} rad/(N m s^2)"},
    "friction": {
        "name": "rolling", "viscous_coefficient": f"{4.69 * ARM**2!r} N m s/rad",
        "curve": {
            "shape": "exponential", "coulomb_force": f"{17.9 * ARM!r} N m",
            "characteristic_displacement": f"{45.36 / ARM!r} urad", "elements": 20,
            "min_knot": f"{0.5 / ARM!r} urad", "max_knot": f"{100 / ARM!r} urad",
        },
    },
    "controller": {**STRAIGHT["controller"], "proportional": f"{6052.93 * ARM**2!r} N m/rad"},
    "loop": {**STRAIGHT["loop"], "rotary": True, "divergence_limit": f"{1 / ARM!r} rad"},
}  # fmt: skip
STEPPED = ({"name": "stepped_sine", "points": 20, "amplitude": 12.0}, {"amplitude": f"{12.0 * ARM!r} N m"})
SLIDING = (
    {"name": "slow_triangle", "amplitude": 0.04, "velocities": [0.02, 0.06, 0.15], "inner_amplitude_ratios": [0.5]},
    {"amplitude": 0.04 / ARM, "velocities": [0.02 / ARM, 0.06 / ARM, 0.15 / ARM], "acceleration": 0.5 / ARM},
)
TRIANGLE = (
    {"name": "slow_triangle", "amplitude": "6 mm", "velocities": [0.01, 0.03], "inner_amplitude_ratios": [0.5, 0.1]},
    {"amplitude": f"{6 / ARM!r} mrad", "velocities": [0.01 / ARM, 0.03 / ARM], "acceleration": 0.5 / ARM},
)
MOVE = (
    {"name": "point_to_point", "targets": [1.5e-3], "duration": 0.04, "dwell_time": 0.16},
    {"targets": [1.5e-3 / ARM]},
)
DRIVEN = ({"name": "displacement_sine", "amplitude": 300e-6, "frequency": 1.0}, {"amplitude": 300e-6 / ARM})
GMS = (
    {
        "name": "gms", "stiffness": [2e5, 6e4], "force_fractions": [0.4, 0.6], "coulomb_force": 10.0,
        "static_force": 14.0, "stribeck_velocity": 1e-3, "attraction_rate": 500.0, "viscous_coefficient": 50.0,
    },
    {
        "stiffness": [2e5 * ARM**2, 6e4 * ARM**2], "coulomb_force": 10.0 * ARM, "static_force": 14.0 * ARM,
        "stribeck_velocity": 1e-3 / ARM, "attraction_rate": 500.0 * ARM, "viscous_coefficient": 50.0 * ARM**2,
    },
)  # fmt: skip
"""Friction of which the record tells each parameter: GMS fitted to rolling elements has no single minimum."""
IDENTIFIED = {"thrust": "u", "displacement": "y"}
EXPERIMENTS = [
    pytest.param(STEPPED, {"name": "conventional"}, id="conventional"),
    pytest.param(STEPPED, {"name": "effective_input"}, id="effective_input"),
    pytest.param(MOVE, {"name": "positioning_metrics"}, id="positioning"),
    pytest.param(
        SLIDING,
        {"name": "friction_identification", "laws": ["coulomb"], **IDENTIFIED},
        id="sliding",
        marks=pytest.mark.thorough,
    ),
    pytest.param(TRIANGLE, {"name": "friction_identification", **IDENTIFIED}, id="rolling", marks=pytest.mark.thorough),
    pytest.param(
        DRIVEN,
        {"name": "friction_identification", "laws": ["gms"], "elements": 2},
        id="gms",
        marks=pytest.mark.thorough,
    ),
]
"""An excitation of the straight axis, what differs of it on the rotary one, and an estimator."""
ROUNDING = {"friction_identification": 1e-6, "positioning_metrics": 1e-8}
"""Difference of estimates that are minima of flat functions; 1e-9 for all others."""


@pytest.mark.parametrize(("excitations", "estimator"), EXPERIMENTS)
def test_a_rotary_axis_is_a_straight_one_on_a_lever(tmp_path, excitations, estimator) -> None:
    workspace, (excitation, changes) = fraexp.Workspace(tmp_path), excitations
    frictions = (GMS[0], {**GMS[0], **GMS[1]}) if excitations is DRIVEN else (STRAIGHT["friction"], ROTARY["friction"])
    machines = [{**machine, "friction": law} for machine, law in zip((STRAIGHT, ROTARY), frictions, strict=True)]
    straight = workspace.estimate(workspace.simulate(machines[0], excitation), estimator)
    turning = workspace.estimate(workspace.simulate(machines[1], {**excitation, **changes}), estimator)
    tolerance = ROUNDING.get(estimator["name"], 1e-9)
    assert straight.outcome == turning.outcome == "ok"
    if straight.result.response is not None:
        assert turning.unit == "rad/(N m)"
        np.testing.assert_allclose(turning.response, straight.response * ARM**-2, rtol=tolerance)
    for one, other in zip(straight.result.fits, turning.result.fits, strict=True):
        factors = [FACTORS.get(unit, 1.0) for unit in other.units]
        np.testing.assert_allclose(other.values, one.values * factors, rtol=tolerance)
    metrics = {metric.name: metric for metric in turning.result.metrics}
    for name in {"Coulomb force", "mass", "overshoot", "peak thrust", "stroke"} & metrics.keys():
        expected = next(metric.value for metric in straight.result.metrics if metric.name == name)
        assert metrics[name].value == pytest.approx(expected * FACTORS[metrics[name].unit], rel=tolerance)


@pytest.mark.parametrize(
    ("section", "given", "names"),
    [
        ("excitation", {"amplitude": "12 N"}, ["amplitude", "'N'", "'N m'"]),
        ("friction", {"viscous_coefficient": "1 N s/m"}, ["viscous_coefficient", "'N s/m'", "'N m s/rad'"]),
        ("loop", {"resolution": "0.1 um"}, ["resolution", "'um'", "'rad'"]),
        ("friction", {"viscous_coefficient": -1.0}, ["rolling.viscous_coefficient", "N m s/rad"]),
    ],
)
def test_a_unit_of_a_straight_axis_is_refused(tmp_path, section, given, names) -> None:
    sections = {"excitation": STEPPED[0], **ROTARY}
    changed = {**sections, section: {**sections[section], **given}}
    with refused(fraexp.FraexpError, f"[{section}]", *names):
        fraexp.Workspace(tmp_path).simulate(changed, changed.pop("excitation"))


def test_a_torque_is_refused_by_a_straight_axis(tmp_path) -> None:
    with refused(fraexp.FraexpError, "amplitude", "'N m'", "'N'", "loop.rotary = true"):
        fraexp.Workspace(tmp_path).simulate(STRAIGHT, {**STEPPED[0], "amplitude": "1 N m"})


def test_messages_are_in_the_units_of_the_axis(tmp_path) -> None:
    limited = {**ROTARY, "loop": {**ROTARY["loop"], "divergence_limit": "10 urad"}}
    recording = fraexp.Workspace(tmp_path).simulate(limited, {**STEPPED[0], "amplitude": "7 N m"})
    assert recording.outcome == "diverged"
    (found,) = recording.signals.findings
    assert (found.kind, found.quantities[0].unit, found.frequencies) == ("diverged", "rad", (1.0,))
    assert "loop.divergence_limit 10 µrad" in recording.signals.message
    assert set(recording.channels.values()) == {"N m", "rad"}
    assert recording.channels["y"] == recording.channels["displacement"] == "rad"


@pytest.mark.parametrize(
    ("limit", "names"),
    [
        ({"stroke": "1 urad"}, ["limits.stroke", "1e-06 rad"]),
        ({"force": "1 mN m"}, ["limits.force", "0.001 N m"]),
        ({"velocity": "1 urad/s"}, ["limits.velocity", "1e-06 rad/s"]),
        ({"stroke": "1 um"}, ["[limits]", "stroke", "'um'", "'rad'"]),
    ],
)
def test_limits_are_those_of_the_axis(tmp_path, limit, names) -> None:
    with refused(fraexp.FraexpError, *names):
        fraexp.Workspace(tmp_path).simulate({**ROTARY, "limits": limit}, {**STEPPED[0], "amplitude": "1 N m"})
