"""Resonances and antiresonances of a fitted plant in the plots of the terminal UI: with intervals, and only there."""

import numpy as np
import pytest

from fraexp.data.results import Curve, Outcome, Result
from fraexp.errors import FraexpError
from fraexp.figures.elements.grouping import ShownResult
from fraexp.tui.plotting.curve_styles import CurveStyles
from fraexp.tui.plotting.panel_drawing import PanelDrawing, ViewRange
from fraexp.tui.plotting.plotted_curves import bode_picture, curves_picture
from tests.refusals import refused
from tests.tui.responses import resonant

GRID = np.geomspace(1, 400, 300)


def extremum_curve(name: str, at: float) -> Curve:
    columns = {"frequency": np.array([at]), "frequency, ± 95 %": np.array([0.25])}
    return Curve(name, columns, {"frequency": "Hz", "frequency, ± 95 %": "Hz"})


def fitted() -> ShownResult:
    response = resonant(GRID)
    fit = Curve(
        "plant fit",
        {"frequency": GRID, "magnitude": np.abs(response.response)},
        {"frequency": "Hz", "magnitude": "m/N"},
    )
    curves = (fit, extremum_curve("resonances", 40.0), extremum_curve("antiresonances", 90.0))
    return ShownResult("a", Result(Outcome.OK, response=response, curves=curves))


class Notes:
    """A canvas that keeps the texts."""

    window = (0.0, 3.0, -100.0, 100.0)

    def __init__(self) -> None:
        self.texts: dict[str, float] = {}

    def note(self, x: float, y: float, text: str, colour: str) -> None:
        self.texts[text] = 10**x

    def __getattr__(self, name: str) -> object:
        return lambda *_: None


def notes(shown: ShownResult, **view: object) -> dict[str, float]:
    panel, canvas = bode_picture([shown], None).panels[0], Notes()
    PanelDrawing(panel, ViewRange(**view), CurveStyles(), upright=True).draw(canvas, ((), ()))  # type: ignore[arg-type]
    return canvas.texts


def test_the_fit_replaces_maxima_of_the_points() -> None:
    assert notes(fitted()) == pytest.approx({"▼40±0.25": 40.0, "▲90±0.25": 90.0})
    assert notes(fitted(), hidden={0}) == {}
    plain = ShownResult("a", Result(Outcome.OK, response=resonant(GRID)))
    assert list(notes(plain)) == [f"▼{GRID[np.abs(np.log(GRID / 40)).argmin()]:.3g}"]


def test_they_are_marks_and_no_curves_of_their_own() -> None:
    assert len(curves_picture([fitted()], "curves").panels) == 1
    alone = ShownResult("a", Result(Outcome.OK, curves=(extremum_curve("resonances", 40.0),)))
    with refused(FraexpError, "curves"):
        curves_picture([alone], "curves")
