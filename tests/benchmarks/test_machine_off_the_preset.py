"""A machine unlike the preset, whose numbers were ok and wrong once, against the benchmarks' fine simulation."""

import drawn_machines
import pytest
import random_machines
import reference_laws
import reference_loop

STIFFNESS = (4e5, 2.5e5, 1.2e5, 6e4, 3e4, 1.2e4, 5e3)
WIDTHS = (2e-6, 5e-6, 12e-6, 25e-6, 45e-6, 80e-6, 140e-6)
DAMPING = (300.0, 200.0, 150.0, 100.0, 60.0, 30.0, 15.0)
LIMITS = tuple(k * y for k, y in zip(STIFFNESS, WIDTHS, strict=True))
FREQUENCIES = (2.0, 5.0, 12.0, 30.0, 80.0, 150.0)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("damping", "viscous", "amplitude"),
    [(DAMPING, 2.0, 8.0), (DAMPING, 2.0, 12.0), ((0.0,) * 7, 60.0, 8.0)],
    ids=["damped, 8 N", "damped, 12 N", "narrow, 8 N"],
)
def test_what_is_ok_is_within_its_tolerance_or_band(damping, viscous, amplitude):
    """Once 0.08 dB and 0.17 dB from the plant, ok, and no setting of a tolerance changed it."""
    parameters = tuple(number for triple in zip(STIFFNESS, damping, WIDTHS, strict=True) for number in triple)
    modes = ((23.0, 0.01, 0.15), (140.0, 0.3, -0.4))
    reference = reference_loop.ReferenceMachine(
        0.5,
        modes,
        viscous,
        reference_laws.ELEMENTS,
        parameters,
        7,
        (800.0, 0.0, 0.03, 0.004),
        0.8e-3,
        (26, 9),
        ((0.6e-3,), ()),
    )
    friction = {"name": "rolling", "stiffness": STIFFNESS, "limit_force": LIMITS, "viscous_coefficient": viscous}
    if any(damping):
        friction["damping"] = damping
    machine = drawn_machines.DrawnMachine(0, "rolling", friction, reference, amplitude, 1.0, FREQUENCIES)
    report = random_machines.compared(machine)
    assert len(report.findings) == len(FREQUENCIES)
    assert not any(any(finding.missed) for finding in report.findings), random_machines.line(report)
    assert sum(finding.is_ok[0] for finding in report.findings) >= 5
    assert sum(finding.is_ok[1] for finding in report.findings) >= 5
