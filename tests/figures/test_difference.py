"""Differences of responses: as compare prints them, and as a figure against the first."""

import numpy as np
import pytest

from fraexp.data.results import FrequencyResponse, Outcome, Result
from fraexp.errors import FraexpError
from fraexp.figures.elements.grouping import ShownResult
from fraexp.figures.elements.panel_figure import draw_panels
from fraexp.figures.kinds.response_errors import (
    difference_curve,
    difference_figure,
    difference_info,
    response_difference,
)
from tests.figures.curves import make_response
from tests.refusals import refused

GRID = np.array([1.0, 2.0, 4.0, 8.0])


def shown(label: str, response: FrequencyResponse) -> ShownResult:
    return ShownResult(label, Result(Outcome.OK, response=response))


def test_it_agrees_with_the_difference_that_compare_prints() -> None:
    rng = np.random.default_rng(1)
    first = make_response(GRID, rng.normal(size=4) + 3)
    other = make_response(GRID * 1.1, rng.normal(size=4) + 3, settled=[True, True, True, True])
    curve, summary = difference_curve("other", first, other), response_difference(first, other)
    assert curve is not None
    assert summary is not None
    assert len(curve.frequency) == summary.points
    assert np.sqrt(np.mean(curve.magnitude**2)) == pytest.approx(summary.magnitude_rms)
    assert np.sqrt(np.mean(curve.phase**2)) == pytest.approx(summary.phase_rms)


def test_a_gap_of_either_is_a_gap_of_the_difference() -> None:
    first = make_response(GRID, np.ones(4), settled=[True, True, False, True])
    other = make_response([1.0, 3.0, 5.0, 9.0], np.ones(4), settled=[True, False, True, True])
    curve = difference_curve("other", first, other)
    assert curve is not None
    assert curve.frequency.tolist() == [1, 2, 8]  # 4 Hz has not settled in the first
    assert curve.settled.tolist() == [True, False, True]  # 2 Hz lies beside 3 Hz, which has not


def test_bands_are_those_of_both() -> None:
    first = make_response(GRID, np.ones(4), deviation=np.full(4, 3e-3))
    other = make_response(GRID, np.ones(4), deviation=np.full(4, 4e-3))
    curve = difference_curve("other", first, other)
    assert curve is not None
    half = np.diff(curve.phase_band, axis=0) / 2
    np.testing.assert_allclose(half, np.degrees(1.96 * 5e-3), rtol=1e-2)
    unknown = difference_curve("other", first, make_response(GRID, np.ones(4)))
    assert unknown is not None
    assert np.isnan(unknown.magnitude_band).all()


def test_what_shares_nothing_with_the_first_is_left_out_and_told() -> None:
    first = shown("first", make_response(GRID, np.ones(4)))
    far = shown("far", make_response(100 * GRID, np.ones(4)))
    info = difference_info([first, shown("near", make_response(GRID, np.ones(4))), far])
    assert info.reference == "first"
    assert [curve.label for curve in info.curves] == ["near"]
    assert info.left_out == ("far",)
    assert [text.get_text() for text in draw_panels(difference_figure(info)).legends[0].get_texts()] == ["near"]
    with refused(FraexpError, "difference", "first"):
        difference_info([first, far])
    with refused(FraexpError, "1 responses"):
        difference_info([first])
    with refused(FraexpError, "units"):
        difference_info([first, shown("other", make_response(GRID, np.ones(4), unit="rad/N"))])


def test_a_known_factor_is_found() -> None:
    frequency = np.geomspace(1, 100, 30)
    response = 1 / (1j * frequency)
    factor = np.ones(30, dtype=complex)
    factor[7] = 2 * np.exp(-1j * np.radians(10))
    found = response_difference(make_response(frequency, response), make_response(frequency, response * factor))
    assert found is not None
    assert not found.interpolated
    assert found.points == 30
    assert found.magnitude_max == pytest.approx(20 * np.log10(2))
    assert found.magnitude_max_at == found.phase_max_at == pytest.approx(frequency[7])
    assert found.phase_max == pytest.approx(-10)
    assert found.magnitude_rms == pytest.approx(20 * np.log10(2) / np.sqrt(30))


def test_different_grids_are_interpolated_where_they_overlap() -> None:
    def integrators(frequency: np.ndarray) -> np.ndarray:
        return (1 / (2j * np.pi * frequency)) ** 2  # a straight line in the Bode plot: interpolated exactly

    low, high = np.geomspace(1, 50, 31), np.geomspace(5, 200, 47)
    found = response_difference(make_response(low, integrators(low)), make_response(high, integrators(high)))
    assert found is not None
    assert found.interpolated
    assert found.low >= 5
    assert found.high == pytest.approx(50)
    assert abs(found.magnitude_max) < 1e-9
    assert abs(found.phase_max) < 1e-9
