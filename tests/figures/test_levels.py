from dataclasses import replace

import numpy as np
import pytest

from fraexp.data.results import Curve, Outcome, Result
from fraexp.errors import FraexpError
from fraexp.figures.elements.grouping import ShownResult
from fraexp.figures.elements.panel_figure import draw_panels
from fraexp.figures.kinds.response_quality import QUANTITIES, levels_info
from fraexp.views.text_tables import response_table
from tests.figures.curves import make_response
from tests.refusals import refused

FREQUENCY = np.array([1.0, 3.0, 2.0])
RESPONSE, TOTAL, NOISE, NONLINEAR, ODD, EVEN = QUANTITIES


def shown(name: str = "a", **known) -> ShownResult:
    response = make_response(FREQUENCY, [1e-3, 1e-4, 1e-3], deviation=known.pop("deviation", None))
    return ShownResult(name, Result(Outcome.OK, response=replace(response, **known)))


def test_levels_are_standard_deviations_on_the_scale_of_the_response() -> None:
    of = shown(
        make_response,
        deviation=np.full(3, 1e-5),
        noise_variance=np.array([1e-12, 1e-14, 0.0]),
        nonlinear_variance=np.full(3, 1e-8),
    )
    info = levels_info([of])
    levels = {line.name: line.y for line in info.panels[0].lines}
    assert info.panels[0].ordinate == "Level [dB re 1 mm/N]"
    np.testing.assert_allclose(info.panels[0].lines[0].x, [1, 2, 3])
    np.testing.assert_allclose(levels[RESPONSE], [0, 0, -20])
    np.testing.assert_allclose(levels[TOTAL], -40 + 10 * np.log10(2))  # real and imaginary part
    np.testing.assert_allclose(levels[NOISE], [-60, np.nan, -80])
    np.testing.assert_allclose(levels[NONLINEAR], -20)


def test_odd_and_even_distortions_are_drawn_and_listed_where_detection_lines_tell_them_apart() -> None:
    plain = shown(deviation=np.full(3, 1e-5))
    columns = {
        "frequency": FREQUENCY,
        "output": np.full(3, 2e-6),
        "odd": np.array([2e-7, 2e-6, 2e-7]),
        "even": np.full(3, 2e-9),
    }
    curve = Curve("distortion levels", columns, {"frequency": "Hz", "output": "m", "odd": "m", "even": "m"})
    result = replace(plain.result, curves=(curve,))
    levels = {line.name: line.y for line in levels_info([replace(plain, result=result)]).panels[0].lines}
    np.testing.assert_allclose(levels[ODD], [-20, -20, -20], atol=1e-9)  # |Ĝ| of 0, 0 and -20 dB
    np.testing.assert_allclose(levels[EVEN], [-60, -60, -80], atol=1e-9)
    assert result.response is not None
    titles, rows, _ = response_table(result.response, None, result.parity_levels)
    assert [[row[titles.index(f"{name} [dB]")] for name in ("odd", "even")] for row in rows] == [
        ["-20.0", "-60.0"], ["0.0", "-60.0"], ["-20.0", "-60.0"],
    ]  # fmt: skip
    elsewhere = replace(curve, columns={**columns, "frequency": FREQUENCY + 1})
    assert replace(result, curves=(elsewhere,)).parity_levels == {}, "levels of other frequencies"


def test_only_what_is_known_is_drawn() -> None:
    known = shown("known", deviation=np.full(3, 1e-5))
    info = levels_info([known, shown("nothing known")])
    assert [(line.place.facet, line.name) for line in info.panels[0].lines] == [("known", RESPONSE), ("known", TOTAL)]
    figure = draw_panels(info)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [RESPONSE, TOTAL]
    with refused(FraexpError, "levels", "noise"):
        levels_info([shown()])


@pytest.mark.parametrize("count", [1, 12])
def test_each_response_has_a_panel_on_shared_axes(count: int) -> None:
    curves = [shown(f"case {index}", deviation=np.full(3, 1e-5)) for index in range(count)]
    figure = draw_panels(levels_info(curves, "Title"))
    drawn = [axes for axes in figure.axes if axes.get_visible()]
    assert len(drawn) == count
    assert len({axes.get_ylim() for axes in drawn}) == 1
    assert (drawn[0].get_title() if count == 1 else figure.get_suptitle()) == "Title"
    with refused(FraexpError, "13 responses", "12 panels"):
        levels_info(curves[:1] * 13)
