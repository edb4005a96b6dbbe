import numpy as np
import pytest

from fraexp.errors import FraexpError
from fraexp.figures.hysteresis import draw_hysteresis, hysteresis_info
from fraexp.results import Curve
from tests.figures.conftest import LoopMaker


def test_similar_strokes_share_a_panel_in_micrometres(make_loop: LoopMaker) -> None:
    info = hysteresis_info([("10", make_loop(10e-6)), ("50", make_loop(50e-6))])
    assert [panel.unit for panel in info.panels] == ["µm"]
    assert info.panels[0].loops[0].displacement.max() == pytest.approx(10)
    assert info.panels[0].loops[0].force.max() == pytest.approx(1)


def test_small_and_large_strokes_have_panels_of_their_own(make_loop: LoopMaker) -> None:
    strokes = [2.5e-3, 10e-6, 1e-3, 50e-6]
    info = hysteresis_info([(f"{stroke}", make_loop(stroke)) for stroke in strokes])
    assert [panel.unit for panel in info.panels] == ["µm", "mm"]
    assert [[loop.label for loop in panel.loops] for panel in info.panels] == [["1e-05", "5e-05"], ["0.0025", "0.001"]]
    figure = draw_hysteresis(info)
    assert [axes.get_xlabel() for axes in figure.axes] == ["Displacement [µm]", "Displacement [mm]"]
    assert len(figure.legends[0].get_texts()) == 4


def test_other_curves_are_refused_in_one_line() -> None:
    curve = Curve("step", {"time": np.zeros(2), "position": np.zeros(2)}, {"time": "s", "position": "m"})
    with pytest.raises(
        FraexpError, match=r"found time \[s\], position \[m\]; expected displacement \[m\], force \[N\]"
    ):
        hysteresis_info([("step", curve)])


def test_no_curves_are_refused() -> None:
    with pytest.raises(FraexpError, match="there is no curve to draw"):
        hysteresis_info([])
