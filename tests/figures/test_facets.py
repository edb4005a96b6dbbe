"""Facets: the same rule for each kind of figure that has no map."""

from collections.abc import Callable
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from matplotlib.colors import to_hex

from fraexp.data.figure_kinds import FIGURES
from fraexp.data.results import Curve, Outcome, Result
from fraexp.errors import FraexpError
from fraexp.figures.drawing import DRAWING_FUNCTIONS, FACET_KINDS, draw_figure
from fraexp.figures.elements.grouping import ShownResult, group_sweeps
from tests.examples import some
from tests.figures.curves import make_response
from tests.refusals import refused

Labels = dict[str, object]
GRID = np.geomspace(1, 200, 9)


def result_of(factor: float) -> Result:
    """Return a result with a response and a curve of each kind, all of which grow with a factor."""
    response = make_response(GRID, -factor / GRID**2)
    response = replace(response, coherence=np.full(GRID.size, 1 / (1 + factor)))
    angle, time = np.linspace(0, 2 * np.pi, 31), np.linspace(0, 0.1, 31)
    loop = {"displacement": 1e-4 * np.cos(angle), "force": factor * np.sin(angle)}
    ramp = np.clip(time / 0.05, 0, 1) * 1e-3
    move = {"time": time, "position": ramp + 1e-6 * factor, "reference": ramp}
    move |= {"target": np.full(31, 1e-3), "band": np.full(31, 4e-6)}
    curves = (
        Curve("loop", loop, {"displacement": "m", "force": "N"}),
        Curve("positioning", move, {"time": "s", **dict.fromkeys(("position", "reference", "target", "band"), "m")}),
    )
    return Result(Outcome.OK, response=response, curves=curves)


def shown_grid(grid: list[Labels]) -> list[ShownResult]:
    places = group_sweeps(grid, {"excitation.amplitude": "N"})
    return [
        ShownResult(f"sweep {n}", result_of(1.0 + n), place, -1 / GRID**2, key=str(n)) for n, place in enumerate(places)
    ]


def combinations(**values: list[object]) -> list[Labels]:
    return [
        dict(zip((name.replace("__", ".") for name in values), of, strict=True)) for of in product(*values.values())
    ]


def titles(figure: object) -> list[str]:
    return [text for axes in figure.axes if (text := axes.get_title(loc="left"))]


Drawn = Callable[[list[Labels], str], object]


@pytest.fixture
def draw() -> Drawn:
    return lambda grid, kind: draw_figure(shown_grid(grid), title="Grid", kind=kind)


def test_every_kind_of_figure_can_be_drawn() -> None:
    assert sorted(DRAWING_FUNCTIONS) == sorted(FIGURES)


@pytest.mark.parametrize("kind", FACET_KINDS)
def test_more_than_six_groups_are_facets_that_share_colours_and_one_legend(kind: str, draw: Drawn) -> None:
    figure = draw(combinations(gain=[0.0, 0.5, 0.9], case=["a", "b", "c"]), kind)
    names = titles(figure)
    assert set(names) >= {"gain α = 0", "gain α = 0.5", "gain α = 0.9"}
    groups = [text.get_text() for text in figure.legends[0].get_texts()]
    assert groups[:3] == (["b", "c", "a"] if kind == "difference" else ["a", "b", "c"]) or "a, loop" in groups
    assert figure.get_suptitle() == "Grid"


@pytest.mark.parametrize("kind", some(FACET_KINDS, "nyquist"))
def test_many_names_have_a_panel_each_and_many_amounts_a_scale_of_colours(kind: str, draw: Drawn) -> None:
    named = draw(combinations(case=[f"case {n}" for n in range(8)]), kind)
    assert set(titles(named)) >= {f"case {n}" for n in range(1, 8)}
    amounts = draw(combinations(excitation__amplitude=[float(2**n) for n in range(8)]), kind)
    assert amounts.axes[-1].get_ylabel() == "Amplitude [N]"
    lines = [line for line in amounts.axes[0].lines if len(line.get_xdata()) > 2]
    assert len({to_hex(line.get_color()) for line in lines}) >= 7


@pytest.mark.parametrize("kind", FACET_KINDS)
def test_random_draws_are_one_band(kind: str, draw: Drawn) -> None:
    grid = [{"case": case, "draw": n + 1, "plant.gain": 0.1 * n} for case in "ab" for n in range(12)]
    figure = draw(grid, kind)
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert any(text.startswith("b") and text.endswith("12 draws") for text in texts)
    if kind not in ("nyquist", "hysteresis"):  # whose abscissae differ
        assert {"median", "5…95 %"} <= set(texts)


def test_too_many_panels_are_refused_with_a_remedy(draw: Drawn) -> None:
    with refused(FraexpError, "coherence", "30 panels", 9, "--group-by"):
        draw(combinations(case=[f"case {n}" for n in range(30)]), "coherence")


def test_lines_of_all_facets_lie_inside_the_axes_they_share() -> None:
    shown = shown_grid(combinations(gain=[0.0, 0.5, 0.9], case=["a", "b", "c"]))
    banded = [
        replace(
            of,
            result=replace(
                of.result, response=make_response(GRID, 10.0**n / GRID**2, deviation=10.0**n * 0.1 / GRID**2)
            ),
        )
        for n, of in enumerate(shown)
    ]
    for axes in draw_figure(banded, kind="difference").axes:
        low, high = axes.get_ylim()
        for line in axes.lines:
            values = np.asarray(line.get_ydata(), float)
            assert not values.size or (low <= np.nanmin(values) and np.nanmax(values) <= high)
