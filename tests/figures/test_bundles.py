"""Many curves in one figure: what is drawn of them, in what groups, and how long that takes."""

import time

import numpy as np
import pytest

from fraexp.data.results import FrequencyResponse
from fraexp.figures.elements.bands import MIN_QUANTILE_CURVES, Bundle
from fraexp.figures.elements.grouping import CurvePlace
from fraexp.figures.elements.labels import label_texts
from fraexp.figures.kinds.bode import BodeInfo, bode_info, draw_bode
from tests.figures.curves import make_response

FREQUENCY = np.geomspace(1, 200, 30)


def many(count: int) -> list[tuple[str, FrequencyResponse]]:
    gains = np.linspace(1, 2, count)
    return [(f"gain {gain}", make_response(FREQUENCY, -1e-3 * gain / FREQUENCY)) for gain in gains]


def draws(*groups: str) -> list[CurvePlace]:
    return [CurvePlace(group=name, point=name, sample="draw") for name in groups]


def legend(info: BodeInfo) -> list[str]:
    return [text.get_text() for text in draw_bode({"": info}).legends[0].get_texts()]


def test_many_curves_are_one_bundle_with_median_and_band() -> None:
    plant = ("P(s)", FREQUENCY, -1e-3 / FREQUENCY)
    info = bode_info(many(101), plant, places=draws(*[""] * 101))
    assert legend(info) == ["101 draws", "median", "5…95 %", "P(s)"]
    (group,) = info.samples
    np.testing.assert_allclose(group.phase, -180)
    quantiles = group.bundle(group.magnitude).quantiles
    assert quantiles is not None
    np.testing.assert_allclose(quantiles[:, 0], 20 * np.log10([1.05, 1.5, 1.95]))
    upper = draw_bode({"": info}).axes[0]
    assert len(upper.lines) + len(upper.collections) < 10, "one artist for all the lines"
    low, high = upper.get_ylim()
    assert low < 20 * np.log10(1 / 200) < 20 * np.log10(2) < high


def test_groups_keep_apart_and_a_small_one_has_no_quantiles() -> None:
    curves = many(30)
    assert legend(bode_info(curves, places=draws(*["H1"] * 25, *["H2"] * 5))) == [
        "H1, 25 draws", "H2, 5 draws", "median", "5…95 %",
    ]  # fmt: skip
    names = [str(index // MIN_QUANTILE_CURVES) for index in range(30)]
    assert legend(bode_info(curves, places=draws(*names)))[:3] == ["0, 10 draws", "1, 10 draws", "2, 10 draws"]


def test_a_grid_is_no_sample_however_many_points_it_has() -> None:
    assert len(legend(bode_info(many(30)))) == 30
    places = [CurvePlace(group="all", point=str(index)) for index in range(30)]
    info = bode_info([("all", of) for _, of in many(30)], places=places)
    assert (legend(info), info.samples) == (["all"], ())


def test_unsettled_points_are_hollow_and_in_no_quantile() -> None:
    settled = np.ones(30, dtype=bool)
    settled[[3, 7]] = False
    wild = np.where(settled, -1e-3 / FREQUENCY, 1e3)
    curves = [("bad", make_response(FREQUENCY, wild, settled=settled)), *many(30)]
    info = bode_info(curves, places=draws(*[""] * 31))
    group = info.samples[0]
    bundle = group.bundle(group.magnitude)
    assert np.isnan(bundle.y[0, [3, 7]]).all()
    assert bundle.quantiles is not None
    assert bundle.quantiles.max() < 10
    assert "not settled" in legend(info)
    lines = draw_bode({"": info}).axes[0].lines
    drawn = [line for line in lines if line.get_fillstyle() == "none" and len(line.get_xdata())]
    np.testing.assert_allclose(drawn[0].get_xdata(), FREQUENCY[[3, 7]])


def test_there_is_no_median_where_most_have_no_value() -> None:
    values = np.ones((20, 2))
    values[:10, 1] = np.nan
    found = Bundle("", np.tile([1.0, 2.0], (20, 1)), values).quantiles
    assert found is not None
    np.testing.assert_array_equal(found, [[1, np.nan]] * 3)


def test_other_frequencies_are_lines_without_a_band() -> None:
    curves = many(30)
    curves[4] = ("shorter", make_response(FREQUENCY[:9], -1e-3 / FREQUENCY[:9]))
    curves[5] = ("empty", make_response([], []))
    assert legend(bode_info(curves, places=draws(*[""] * 30))) == ["29 draws"]


def test_nothing_settled_can_be_drawn() -> None:
    never = make_response([1.0, 2.0], [1e-3, 1e-3], settled=[False, False])
    assert legend(bode_info([("a", never)] * 30, places=draws(*[""] * 30))) == [
        "30 draws",
        "median",
        "5…95 %",
        "not settled",
    ]


@pytest.mark.thorough
def test_ten_thousand_sweeps_are_drawn_within_seconds() -> None:
    curves = many(10_000)
    began = time.process_time()
    draw_bode({"": bode_info(curves, ("P(s)", FREQUENCY, -1e-3 / FREQUENCY), places=draws(*[""] * 10_000))})
    components = [{"name": "dahl", "stiffness": float(index)} for index in range(10_000)]
    assert label_texts(components)[7] == "dahl (stiffness 7)"
    assert time.process_time() - began < 10, "about 1 s; minutes if a step grows with the square of the number"
