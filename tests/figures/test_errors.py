import numpy as np
import pytest

from fraexp.data.results import Metric, Outcome, Result
from fraexp.errors import FraexpError
from fraexp.figures.drawing import draw_figure
from fraexp.figures.elements.grouping import ShownResult
from fraexp.figures.kinds.response_errors import FREQUENCY_FACTOR, errors_info
from tests.figures.curves import make_response
from tests.refusals import refused

FREQUENCY = np.array([39.0, 1.0, 5.0, 12.4, 150.0])
PLANT = -0.1 / FREQUENCY**2
COST = (Metric("stroke", 2e-3, "m"), Metric("gain", 1.0, "1"), Metric("peak force", 12.0, "N"))


def shown(factor, name: str = "a", truth: bool = True, **options) -> ShownResult:
    result = Result(Outcome.OK, response=make_response(FREQUENCY, PLANT * factor, **options), metrics=COST)
    return ShownResult(name, result, truth=PLANT[np.argsort(FREQUENCY)] if truth else None, key=f"key of {name}")


def test_the_error_is_the_ratio_to_the_plant_at_each_frequency() -> None:
    factor = np.array([2.0, 1.0, 1j, 1.0, 0.1])
    (curve,) = errors_info([shown(factor)]).curves
    np.testing.assert_allclose(curve.frequency, np.sort(FREQUENCY))
    np.testing.assert_allclose(curve.magnitude, [0, 0, 0, 20 * np.log10(2), -20], atol=1e-12)
    np.testing.assert_allclose(curve.phase, [0, 90, 0, 0, 0], atol=1e-12)
    assert curve.effort == {"stroke [mm]": 2.0, "peak force [N]": 12.0}


def test_the_table_takes_the_nearest_settled_point_and_none_that_is_far() -> None:
    settled = FREQUENCY != 5.0
    info = errors_info([shown(1.0, settled=settled)])
    (curve,) = info.curves
    assert info.spots == (1, 5, 12, 20, 39, 80, 150)
    at = [curve.index_near(spot) for spot in info.spots]
    assert [None if index is None else curve.frequency[index] for index in at] == [1, None, 12.4, None, 39, None, 150]
    assert errors_info([shown(1.0)], spots=(0.5, 39, 150 * FREQUENCY_FACTOR, 200)).spots == (39, 150 * FREQUENCY_FACTOR)


def test_the_share_of_limits_that_hold_the_plant() -> None:
    deviation = np.abs(PLANT) * 0.01
    factor = np.array([1.005, 1.005, 1.005, 1.1, 1.005])
    (curve,) = errors_info([shown(factor, deviation=deviation)]).curves
    assert curve.coverage == pytest.approx(0.9)  # one magnitude of five is off, no phase is
    assert np.isnan(errors_info([shown(factor)]).curves[0].coverage)


def test_responses_without_a_known_plant_are_left_out() -> None:
    info = errors_info([shown(1.0, "known"), shown(1.0, "unknown", truth=False)])
    assert [curve.key for curve in info.curves] == ["key of known"]
    with refused(FraexpError, "errors", "m/N"):
        errors_info([shown(1.0, truth=False)])


def test_an_axis_is_logarithmic_only_far_from_its_linear_range() -> None:
    curves = [shown(factor, f"case {factor}") for factor in (2.0, 1.0, 0.01)]
    figure = draw_figure(curves, title="My methods", kind="errors")
    upper, lower = figure.axes
    assert upper.get_title() == "My methods"
    assert upper.get_yscale() == "symlog", "errors of 0.01 and of 40 dB are both to be seen"
    assert lower.get_yscale() == "linear", "no phase is off"
    assert [text.get_text() for text in figure.legends[0].texts] == ["case 2.0", "case 1.0", "case 0.01"]
