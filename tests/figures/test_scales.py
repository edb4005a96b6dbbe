import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fraexp.figures.elements.bands import ordinate_limits
from fraexp.figures.elements.scales import continuous_phase, decibel, degrees, readable_unit


@pytest.mark.parametrize(
    ("unit", "factor", "shown"), [("m/N", 1000, "mm/N"), ("m", 1000, "mm"), ("rad/A", 1, "rad/A"), ("mm/N", 1, "mm/N")]
)
def test_lengths_are_shown_in_millimetres(unit: str, factor: float, shown: str) -> None:
    assert readable_unit(unit) == (factor, shown)


def test_decibel_and_degrees_of_what_is_no_number_are_gaps() -> None:
    response = np.array([1j, 0, np.nan, 100, np.inf])
    np.testing.assert_allclose(decibel(response), [0, np.nan, np.nan, 40, np.nan])
    np.testing.assert_allclose(degrees(response), [90, 0, np.nan, 0, np.nan])


def test_a_delay_is_drawn_without_jumps() -> None:
    frequency = np.linspace(1, 200, 400)
    true = -180 - 360 * frequency * 0.004
    wrapped = degrees(np.exp(1j * np.radians(true)))
    everywhere = np.ones(400, dtype=bool)
    np.testing.assert_allclose(continuous_phase(wrapped, everywhere, true), true, atol=1e-9)


def test_the_anchor_decides_steps_of_half_a_turn() -> None:
    # An undamped resonance with a little delay: -185° after 0° is also +175°.
    phase, anchor = np.array([-1.0, -2.0, 174.0, 173.0]), np.array([0.0, 0.0, -180.0, -180.0])
    everywhere = np.ones(4, dtype=bool)
    np.testing.assert_allclose(continuous_phase(phase, everywhere, anchor), [-1, -2, -186, -187])


def test_points_that_are_not_trusted_do_not_carry_the_branch_away() -> None:
    true = np.linspace(-100, -260, 17)
    phase, trusted = degrees(np.exp(1j * np.radians(true))), np.ones(17, dtype=bool)
    phase[[5, 6, 7]], trusted[[5, 6, 7]] = [170.0, -10.0, np.nan], False
    drawn = continuous_phase(phase, trusted)
    np.testing.assert_allclose(drawn[trusted], true[trusted])
    assert np.isnan(drawn[7])


@given(st.lists(st.floats(-180, 180), min_size=1, max_size=30), st.floats(-400, 400))
def test_the_branch_changes_no_phase_but_by_whole_turns(phase: list[float], anchor: float) -> None:
    given_phase = np.array(phase)
    everywhere = np.ones(len(phase), dtype=bool)
    turns = (continuous_phase(given_phase, everywhere, np.full(len(phase), anchor)) - given_phase) / 360
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-9)


@pytest.mark.parametrize(("lower", "upper", "expected"), [
    (-900.0, 1.0, (-75.0, 1.0)),
    (-np.inf, np.inf, (-75.0, 15.0)),
    (-3.0, 3.0, (-63.0, 3.0)),
])  # fmt: skip
def test_an_axis_holds_its_curves_and_follows_bands_only_a_little(
    lower: float, upper: float, expected: tuple[float, float]
) -> None:
    curve = np.linspace(0, -60, 5)
    assert ordinate_limits([curve], [(curve, curve + np.array([[lower], [upper]]))]) == expected


def test_a_flat_curve_leaves_its_band_the_axis() -> None:
    flat = np.zeros(3)
    assert ordinate_limits([flat], [(flat, np.array([[-1.0, -1, -np.inf], [1, 1, np.inf]]))]) == (-1, 1)
    assert ordinate_limits([np.full(3, np.nan)], []) is None
