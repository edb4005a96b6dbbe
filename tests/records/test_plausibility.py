"""Units that no machine has are questioned; those of real machines, small and large, are not."""

import numpy as np
import pytest

from fraexp.data.findings import Finding
from fraexp.data.signals import Segment
from fraexp.records.record_doubts import implausible_units

LINES = np.array([3, 7])


def record(mass: float, force: float, units: tuple[str, str] = ("N", "m")) -> list[Finding]:
    """Return the findings on a free mass [kg or kg m²] that a force [N or N m] moves at 3 and 7 Hz."""
    time = np.arange(1000) / 1000
    waves = np.sin(2 * np.pi * np.outer(time, LINES))
    position = -force / mass * waves @ (1 / (2 * np.pi * LINES) ** 2)
    channels = {"u": force * waves.sum(axis=1)[None], "y": position[None]}
    return list(implausible_units([Segment(1e-3, channels, LINES)], dict(zip(("u", "y"), units, strict=True))))


@pytest.mark.parametrize(("mass", "force"), [(1e-3, 1e-2), (7.6, 12.0), (5e3, 2e4)])
def test_machines_are_not_questioned(mass: float, force: float) -> None:
    assert record(mass, force) == record(mass, force, ("N m", "rad")) == []


def test_a_mass_of_94_t_is_questioned() -> None:
    (mass,), (inertia,) = record(94e3, 12.0), record(1e7, 12.0, ("N m", "rad"))
    assert (mass.place, mass.quantities[0].value) == ("'u' over 'y'", pytest.approx(94e3))
    assert (inertia.quantities[0].name, inertia.quantities[0].value) == ("apparent inertia", pytest.approx(1e7))


def test_a_stroke_of_40_m_is_questioned() -> None:
    (found,) = record(1e-3, 10.0)
    assert (found.place, found.quantities[0].value) == ("'y'", pytest.approx(66.6, rel=1e-3))
    assert record(1e-3, 10.0, ("A", "rad")) == []  # a motor may turn on


def test_channels_that_stand_still_are_not() -> None:
    still = Segment(1e-3, {"u": np.zeros((1, 1000)), "y": np.zeros((1, 1000))}, LINES)
    assert list(implausible_units([still], {"u": "N", "y": "m"})) == []
