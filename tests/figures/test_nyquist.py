import numpy as np
import pytest

from fraexp.data.results import Outcome, Result
from fraexp.errors import FraexpError
from fraexp.figures.elements.grouping import ShownResult
from fraexp.figures.kinds.nyquist import draw_nyquist, nyquist_info
from tests.figures.curves import make_response
from tests.refusals import refused

FREQUENCY = np.array([1.0, 10.0, 3.0])
RESPONSE = np.array([1e-3, 1e-3j, -2e-3])


def shown(label: str, **known) -> ShownResult:
    return ShownResult(label, Result(Outcome.OK, response=make_response(FREQUENCY, RESPONSE, **known)))


def test_responses_lie_in_the_complex_plane_in_the_unit_people_read() -> None:
    info = nyquist_info([shown("a", settled=[True, True, False])])
    (curve,) = info.curves
    assert info.unit == "mm/N"
    np.testing.assert_allclose(curve.frequency, [1, 3, 10])
    np.testing.assert_allclose(curve.x, [1, -2, 0], atol=1e-12)
    np.testing.assert_allclose(curve.y, [0, 0, 1], atol=1e-12)
    assert curve.usable.tolist() == [True, False, True]
    assert curve.size == pytest.approx(1)  # the point of 2 had not settled
    assert curve.marked_points()[10.0] == 2
    assert 3.0 not in curve.marked_points()


def test_the_plant_is_drawn_with_them_and_frequencies_are_named() -> None:
    reference = ("P", np.array([1.0, 10.0]), np.array([1e-3, 2e-3j]))
    figure = draw_nyquist(nyquist_info([shown("a"), shown("b")], reference))
    (axes,) = figure.axes
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["a", "b", "P"]
    assert axes.get_aspect() == 1
    assert {text.get_text() for text in axes.texts} == {"1 Hz", "2 Hz", "10 Hz"}


def test_what_cannot_share_a_plane_is_refused() -> None:
    with refused(FraexpError, "m/N", "rad/N"):
        nyquist_info([shown("a"), shown("b", unit="rad/N")])
    with refused(FraexpError, "nothing"):
        nyquist_info([ShownResult("a", Result(Outcome.OK))])
