import numpy as np
import pytest

from fraexp.figures.kinds.difference import response_difference
from tests.figures.conftest import ResponseMaker


def test_a_known_factor_is_found(make_response: ResponseMaker) -> None:
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


def test_different_grids_are_interpolated_where_they_overlap(make_response: ResponseMaker) -> None:
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


def test_unsettled_points_are_not_compared(make_response: ResponseMaker) -> None:
    one = make_response([1.0, 2.0, 3.0], [1, 1, 1])
    other = make_response([1.0, 2.0, 3.0], [1, 99, 1], settled=[True, False, True])
    found = response_difference(other, one)
    assert found is not None
    assert (found.points, found.magnitude_max) == (2, 0)


def test_nothing_in_common_is_no_difference(make_response: ResponseMaker) -> None:
    one = make_response([1.0, 2.0], [1, 1])
    assert response_difference(one, make_response([3.0, 4.0], [1, 1])) is None
    assert response_difference(one, make_response([1.0, 2.0], [1, 1], unit="rad/A")) is None
