"""Units that no machine has are questioned; those of real machines, small and large, are not."""

import numpy as np
import pytest

from fraexp.data.signals import Segment
from fraexp.records.source import unit_questions

LINES = np.array([3, 7])


def record(mass: float, force: float, units: tuple[str, str] = ("N", "m")) -> str:
    """Return the questions about a free mass [kg or kg m²] that a force [N or N m] moves at 3 and 7 Hz."""
    time = np.arange(1000) / 1000
    waves = np.sin(2 * np.pi * np.outer(time, LINES))
    position = -force / mass * waves @ (1 / (2 * np.pi * LINES) ** 2)
    channels = {"u": force * waves.sum(axis=1)[None], "y": position[None]}
    return unit_questions([Segment(1e-3, channels, LINES)], dict(zip(("u", "y"), units, strict=True)))


@pytest.mark.parametrize(("mass", "force"), [(1e-3, 1e-2), (7.6, 12.0), (5e3, 2e4)])
def test_machines_are_not_questioned(mass: float, force: float) -> None:
    assert record(mass, force) == ""
    assert record(mass, force, ("N m", "rad")) == ""


def test_a_mass_of_94_t_is_questioned() -> None:
    assert (
        record(94e3, 12.0) == "'u' over 'y' is an apparent mass of 9.4e+04 kg or more: are their units and gains right?"
    )
    assert "inertia of 1e+07 kg m² or more" in record(1e7, 12.0, ("N m", "rad"))


def test_a_stroke_of_40_m_is_questioned() -> None:
    assert "'y' spans 66.6 m: are its unit and gain right?" in record(1e-3, 10.0)
    assert record(1e-3, 10.0, ("A", "rad")) == ""  # a motor may turn on


def test_channels_that_stand_still_are_not() -> None:
    still = Segment(1e-3, {"u": np.zeros((1, 1000)), "y": np.zeros((1, 1000))}, LINES)
    assert unit_questions([still], {"u": "N", "y": "m"}) == ""
