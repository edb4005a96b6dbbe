import numpy as np
import pytest
from fraexp_plugins.identification._law_forces import virgin_curve

from fraexp.data.results import Curve
from fraexp.errors import FraexpError
from fraexp.figures.kinds.curves import draw_hysteresis, hysteresis_info
from tests.figures.curves import make_loop
from tests.refusals import refused


def test_similar_strokes_share_a_panel_in_micrometres() -> None:
    info = hysteresis_info([("10", make_loop(10e-6)), ("50", make_loop(50e-6))])
    assert [family.unit for family in info.families] == ["µm"]
    assert info.panels[0].lines[0].x.max() == pytest.approx(10)
    assert info.panels[0].lines[0].y.max() == pytest.approx(1)


def test_small_and_large_strokes_have_panels_of_their_own() -> None:
    strokes = [2.5e-3, 10e-6, 1e-3, 50e-6]
    info = hysteresis_info([(f"{stroke}", make_loop(stroke)) for stroke in strokes])
    assert [family.unit for family in info.families] == ["µm", "mm"]
    assert [[loop.name for loop in panel.lines] for panel in info.panels] == [["1e-05", "5e-05"], ["0.0025", "0.001"]]
    figure = draw_hysteresis(info)
    assert [axes.get_xlabel() for axes in figure.axes] == ["Displacement [µm]", "Displacement [mm]"]
    assert len(figure.legends[0].get_texts()) == 4


@pytest.mark.parametrize("strokes", [[10e-6], [10e-6, 1e-3]])
def test_a_long_title_is_not_cut_off(strokes: list[float]) -> None:
    title = "Rolling friction of the paper's machine from thrust and scale, on a slow triangle, " * 2
    figure = draw_hysteresis(hysteresis_info([(f"{stroke}", make_loop(stroke)) for stroke in strokes], title))
    figure.draw_without_rendering()
    text = figure._suptitle if len(strokes) > 1 else figure.axes[0].title
    box = text.get_window_extent()
    assert 0 <= box.x0 <= box.x1 <= figure.bbox.width
    assert 0 <= box.y0 <= box.y1 <= figure.bbox.height
    assert " ".join(text.get_text().split()) == title.strip()


def test_other_curves_are_refused_in_one_line() -> None:
    curve = Curve("step", {"time": np.zeros(2), "position": np.zeros(2)}, {"time": "s", "position": "m"})
    with refused(FraexpError, "time [s]", "position [m]", "displacement [m]", "force [N]"):
        hysteresis_info([("step", curve)])


def test_no_curves_are_refused() -> None:
    with refused(FraexpError, "hysteresis figure"):
        hysteresis_info([])


def test_the_limits_of_a_virgin_curve_are_a_band() -> None:
    x = np.linspace(0, 1e-4, 11)
    curve = virgin_curve(x, 17.9 * (1 - np.exp(-x / 2e-5)), np.linspace(0.1, 0.5, 11))
    figure = draw_hysteresis(hysteresis_info([("loop", make_loop(1e-4)), ("virgin", curve)]))
    (axes,) = figure.axes
    edges = axes.collections[0].get_paths()[0].vertices
    assert (edges[:, 0].min(), edges[:, 0].max()) == pytest.approx((0, 100))
    assert edges[:, 1].max() == pytest.approx(curve.columns["upper 95 %"].max())
    assert edges[:, 1].min() == pytest.approx(curve.columns["lower 95 %"].min())
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["loop", "virgin", "95 %"]
