from dataclasses import replace

import numpy as np

from fraexp.data.results import Outcome, Result
from fraexp.errors import FraexpError
from fraexp.figures.elements.grouping import ShownResult
from fraexp.figures.elements.panel_figure import draw_panels
from fraexp.figures.kinds.response_quality import coherence_info
from tests.figures.curves import make_response
from tests.refusals import refused

GRID = np.array([1.0, 3.0, 2.0])


def shown(label: str, distortion: float = np.nan, **known) -> ShownResult:
    harmonics = np.full((3, 6), np.nan, dtype=complex)
    harmonics[:, 0] = distortion
    response = replace(make_response(GRID, np.ones(3)), harmonics=harmonics, **known)
    return ShownResult(label, Result(Outcome.OK, response=response))


def test_coherence_and_distortion_are_shown_where_they_are_known() -> None:
    info = coherence_info([
        shown("stepped", distortion=0.02),
        shown("spectral", coherence=np.array([0.9, 0.7, 0.8])),
        shown("nothing"),
    ])  # fmt: skip
    assert [[line.name for line in panel.lines] for panel in info.panels] == [["spectral"], ["stepped"]]
    np.testing.assert_allclose(info.panels[1].lines[0].y, 2)  # per cent
    np.testing.assert_allclose(info.panels[0].lines[0].y, [0.9, 0.8, 0.7])
    assert not info.panels[1].is_log
    figure = draw_panels(info)
    assert [axes.get_ylabel() for axes in figure.axes] == ["Squared coherence [1]", "Harmonic distortion [%]"]


def test_one_panel_is_drawn_if_one_is_known_and_decades_have_their_axis() -> None:
    few = [shown("a", distortion=0.001), shown("b", distortion=0.5)]
    info = coherence_info(few)
    assert [(panel.ordinate, panel.is_log) for panel in info.panels] == [("Harmonic distortion [%]", True)]
    (axes,) = draw_panels(info).axes
    assert axes.get_yscale() == "log"


def test_without_either_it_says_what_would_tell_them() -> None:
    with refused(FraexpError, "coherence", "distortion"):
        coherence_info([shown("nothing")])
