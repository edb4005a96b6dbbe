"""The figure of positioning: deviation from the target around its band, and the thrust."""

import numpy as np
import pytest

from fraexp.data.results import Curve, Outcome, Result
from fraexp.errors import FraexpError
from fraexp.figures.drawing import draw_figure
from fraexp.figures.elements.grouping import ShownResult
from fraexp.figures.kinds.curves import AXIS_MARGIN, MIN_HEIGHT_RATIO, is_positioning, positioning_info
from tests.refusals import refused

BAND = 4e-6


def motion(overshoot=0.0, thrust=True, wait=0):
    """Return a move of 1 mm in 40 samples, which then overshoots and comes back slowly."""
    moving, after = np.linspace(0, 1e-3, 41), np.arange(100)
    reference = np.concatenate([np.zeros(wait), moving, np.full(after.size, 1e-3)])
    position = np.concatenate([np.zeros(wait), moving, 1e-3 + overshoot * np.exp(-after / 30)])
    columns = {"time": 1e-3 * np.arange(reference.size), "position": position, "reference": reference}
    columns |= {"target": np.full(reference.size, 1e-3), "band": np.full(reference.size, BAND)}
    units = {"time": "s", **dict.fromkeys(("position", "reference", "target", "band"), "m")}
    if thrust:
        columns["thrust"], units["thrust"] = 10 * np.sin(np.arange(reference.size)), "N"
    return Curve("positioning", columns, units)


def shown(*curves):
    return [ShownResult(f"case {n}", Result(Outcome.OK, curves=(curve,))) for n, curve in enumerate(curves)]


def test_it_is_drawn_by_itself_where_there_are_such_curves():
    figure = draw_figure(shown(motion(), motion(20e-6)), title="Fig 8")
    upper, lower = figure.axes
    assert upper.get_title() == "Fig 8"
    assert (upper.get_ylabel(), lower.get_ylabel()) == ("Position − target [µm]", "Thrust [N]")
    assert lower.get_xlabel() == "Time since the move began [ms]"
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["case 0", "case 1", "±4 µm"]
    levels = {float(line.get_ydata()[0]) for line in upper.lines if len(set(map(float, line.get_ydata()))) == 1}
    assert levels >= {-4.0, 4.0}


def test_deviation_and_time_count_from_the_move_on():
    info = positioning_info([("a", motion(20e-6, wait=30))])
    (move,) = info.panels[0].lines
    assert move.x[30] == pytest.approx(0)
    assert move.y[30] == pytest.approx(-1000)
    assert move.y[71] == pytest.approx(20)
    assert info.panels[0].span[1] == pytest.approx(AXIS_MARGIN * 20)


def test_the_axis_shows_a_few_bands_and_is_logarithmic_where_that_is_not_enough():
    quiet, far = (draw_figure(shown(motion(overshoot))).axes[0] for overshoot in (1e-6, 200e-6))
    assert quiet.get_yscale() == "linear"
    assert quiet.get_ylim() == pytest.approx((-4 * MIN_HEIGHT_RATIO, 4 * MIN_HEIGHT_RATIO))
    assert far.get_yscale() == "symlog"
    assert far.get_ylim()[1] > 200


def test_without_thrust_there_is_one_panel():
    assert len(draw_figure(shown(motion(thrust=False))).axes) == 1


def test_other_curves_are_none():
    other = motion()
    del other.columns["band"]
    assert not is_positioning(other)
    with refused(FraexpError, "'positioning_metrics'"):
        draw_figure(shown(other), kind="positioning")
