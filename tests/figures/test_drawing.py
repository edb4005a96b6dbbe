"""Which function draws which kind of figure."""

from fraexp.data.figure_kinds import FIGURES
from fraexp.figures.drawing import CURVE_KINDS, DRAWING_FUNCTIONS


def test_every_kind_of_figure_can_be_drawn() -> None:
    drawn = [*CURVE_KINDS, *DRAWING_FUNCTIONS, "bode", "nyquist"]
    assert sorted(drawn) == sorted(FIGURES)
