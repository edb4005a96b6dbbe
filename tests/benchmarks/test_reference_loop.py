"""The benchmarks' fine simulation against DOP853 with event location, and fraexp against it on a few machines."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import reference_laws as kinds
import reference_loop as fine

from tests.machines import LEAD, TABLE
from tests.physics import event_location as exact

SAMPLE, DEAD_SAMPLES, VISCOUS, FREQUENCY = 500e-6, 2, 4.69, 40.0
STRIBECK = exact.Stribeck(17.9, 22.0)
ELEMENTS = ((2e5, 1.5), (1e5, 4.0), (6e4, 6.0), (2e4, 6.4))
SLIPS = ((2e5, 0.2), (1.5e5, 0.3), (5e4, 0.5))
PINNED = (7, 11)
"""Machines of benchmarks/random_machines.py: coulomb, and rolling with damped elements."""


def laws():
    """Return each kind's number and parameters for the fine simulation, and its law for event location."""
    triples = [number for k, force in ELEMENTS for number in (k, 0.0, force / k)]
    slips = [number for pair in SLIPS for number in pair]
    elements = tuple(zip(*ELEMENTS, strict=True))
    return {
        "elements": (kinds.ELEMENTS, triples, exact.Elements(*elements)),
        "sliders": (kinds.FORCE_SLIDERS, triples, exact.Elements(*elements)),
        "dahl": (kinds.BRISTLE, (3.9e5, 0, 17.9, 17.9, 1, 0), exact.Bristle(3.9e5, 0.0, exact.Stribeck(17.9, 17.9))),
        "lugre": (kinds.BRISTLE, (3.9e5, 400, 17.9, 22.0, 1e-3, 0), exact.Bristle(3.9e5, 400.0, STRIBECK)),
        "elastoplastic": (kinds.BRISTLE, (3.9e5, 400, 17.9, 22, 1e-3, 3e-5), exact.Bristle(3.9e5, 400, STRIBECK, 3e-5)),
        "gms": (
            kinds.GMS, (17.9, 22.0, 1e-3, 2.0, 500.0, *slips),
            exact.MaxwellSlip(*zip(*SLIPS, strict=True), STRIBECK, 500.0),
        ),
        "coulomb": (kinds.COULOMB, (17.9, 17.9, 1.0, 2.0), exact.SetValued(exact.Stribeck(17.9, 17.9))),
        "stribeck": (kinds.COULOMB, (17.9, 22.0, 1e-3, 2.0), exact.SetValued(STRIBECK)),
    }  # fmt: skip


@pytest.mark.thorough
def test_the_fine_simulation_converges_to_event_location():
    modes = tuple(zip(TABLE.frequencies, TABLE.damping_ratios, TABLE.modal_gain_ratios, strict=True))
    pid = (LEAD.proportional, 0.0, LEAD.derivative_time, LEAD.filter_time)
    number = np.arange(300)
    rise = np.minimum(1, number * SAMPLE / fine.RAMP_S)
    excitation = 75.0 * rise * np.sin(2 * np.pi * FREQUENCY * number * SAMPLE)
    loop = exact.Loop(TABLE.state_space(), VISCOUS, *LEAD.transfer_function(SAMPLE), SAMPLE, DEAD_SAMPLES)
    for name, (kind, parameters, law) in laws().items():
        machine = fine.ReferenceMachine(
            TABLE.rigid_body_gain, modes, VISCOUS, kind, parameters, 7, pid, SAMPLE,
            (DEAD_SAMPLES * fine.FINE_CLOCK, 0), ((), ()),
        )  # fmt: skip
        y = fine.ReferenceRun(machine, FREQUENCY, 75.0, 160).advance(number.size)[1]
        truth = exact.simulate(loop, law, excitation).y
        assert np.max(np.abs(y - truth)) < (2e-5 if name == "gms" else 5e-7) * np.max(np.abs(truth)), name


@pytest.mark.thorough
def test_machines_drawn_at_random_are_right_where_they_are_called_ok(checkout: Path) -> None:
    script = checkout / "benchmarks" / "random_machines.py"
    command = [sys.executable, str(script), "--seed", "2026", "--only", *map(str, PINNED)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.rstrip().endswith("0 missed")
