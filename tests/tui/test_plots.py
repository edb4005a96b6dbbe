"""How curves are drawn in a terminal: dots, ticks, gaps, bands, and the Bode view."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.cells import cell_len
from textual.app import App, ComposeResult
from textual.events import MouseScrollUp
from textual.pilot import Pilot

from fraexp.data.results import FrequencyResponse, Outcome, Result
from fraexp.figures.elements.grouping import ShownResult
from fraexp.tui.plotting.braille import BLANK_CODE, DOTS_ACROSS, DOTS_DOWN, line_dots
from fraexp.tui.plotting.cell_canvas import CellCanvas
from fraexp.tui.plotting.curve_styles import CurveStyles
from fraexp.tui.plotting.panel_drawing import ISOLATED_SIGN, RESONANCE_SIGN, UNSETTLED_SIGN, prominences, settled_line
from fraexp.tui.plotting.plot_stack import PlotStack
from fraexp.tui.plotting.plot_widget import LEFT_CELLS, TOP_CELLS, Plot
from fraexp.tui.plotting.plotted_curves import PlotTrace, bode_picture
from fraexp.tui.widgets.readout import readout, shorten_name
from tests.examples import portion
from tests.tui.pilots import screen_text, settle, until
from tests.tui.responses import RESONANCE, gap, resonant

GRID = np.geomspace(1.0, 400.0, 3000)
WINDOW = (0.0, 10.0, 0.0, 10.0)
Labelled = list[tuple[str, FrequencyResponse]]


class OneView(App[None]):
    """A Bode plot and nothing else."""

    def __init__(self, responses: Labelled) -> None:
        super().__init__()
        self.responses = responses

    def compose(self) -> ComposeResult:
        yield PlotStack()

    def on_mount(self) -> None:
        results = [ShownResult(label, Result(Outcome.OK, response=response)) for label, response in self.responses]
        self.query_one(PlotStack).display_picture(bode_picture(results, None))


def shown(responses: Labelled, steps: Callable[[PlotStack, Pilot[None]], Awaitable[None]], size=(100, 30)) -> None:
    async def drive() -> None:
        app = OneView(responses)
        async with app.run_test(size=size) as pilot:
            view = app.query_one(PlotStack)
            await until(pilot, lambda: view.picture is not None)
            await settle(pilot)
            await steps(view, pilot)

    asyncio.run(drive())


def plots_of(view: PlotStack) -> list[Plot]:
    return [plot for plot in view.query(Plot) if plot.display]


def drawn_rows(plot: Plot) -> list[str]:
    """Return what is within the axes, row by row."""
    columns, rows = plot.cells
    lines = screen_text(plot.app).splitlines()
    left, top = plot.region.x + LEFT_CELLS, plot.region.y + TOP_CELLS
    return [text[left : left + columns] for text in lines[top : top + rows]]


def coloured(plot: Plot, row: int) -> list[tuple[str, str]]:
    """Return the characters of a row within the axes, each with its colour."""
    strip = plot.render_line(TOP_CELLS + row)
    cells = [
        (character, segment.style.color.name if segment.style and segment.style.color else "")
        for segment in strip
        for character in segment.text
    ]
    return cells[LEFT_CELLS : LEFT_CELLS + plot.cells[0]]


def curve_dots(plot: Plot, grid: str = CurveStyles().grid) -> list[list[int]]:
    """Return the columns that have dots of curves, row by row."""
    return [
        [column for column, (text, colour) in enumerate(coloured(plot, row)) if is_dots(text) and colour != grid]
        for row in range(plot.cells[1])
    ]


def is_dots(character: str) -> bool:
    return BLANK_CODE < ord(character) < BLANK_CODE + 256


@given(
    st.lists(st.tuples(st.floats(-5, 15), st.floats(-5, 15)), min_size=2, max_size=12),
    st.tuples(st.integers(3, 30), st.integers(2, 12)),
)
@settings(max_examples=portion(60))
def test_a_line_has_the_dots_that_walking_along_it_meets(
    points: list[tuple[float, float]], cells: tuple[int, int]
) -> None:
    x, y = np.array(points).T
    width, height = DOTS_ACROSS * cells[0], DOTS_DOWN * cells[1]
    expected, sure = np.zeros((2, height, width), dtype=bool)
    for (x0, y0), (x1, y1) in pairwise(points):
        along = np.linspace(0, 1, 20_000)
        column, row = (x0 + along * (x1 - x0)) / 10 * width, (10 - y0 - along * (y1 - y0)) / 10 * height
        for seen, room in ((expected, 1e-3), (sure, -1e-3)):  # with what lies on the edge, and without it
            inside = (column > -room) & (column < width + room) & (row > -room) & (row < height + room)
            places = np.floor(row[inside]).astype(int), np.floor(column[inside]).astype(int)
            seen[np.clip(places[0], 0, height - 1), np.clip(places[1], 0, width - 1)] = True
    drawn = line_dots(x, y, WINDOW, cells)
    grown = np.pad(expected, 1)
    near = np.any([np.roll(grown, (i, j), (0, 1)) for i in (-1, 0, 1) for j in (-1, 0, 1)], axis=0)[1:-1, 1:-1]
    assert not (drawn & ~near).any()  # no dot where the line does not pass
    if sure.any(axis=0).sum() > 2:
        assert (drawn.any(axis=0) | ~sure.any(axis=0))[1:-1].all()  # and none of its columns is empty


def test_gaps_are_not_bridged_and_nothing_is_drawn_of_nothing() -> None:
    x = np.array([0.0, 2, np.nan, 8, 10])
    drawn = line_dots(x, np.full(5, 5.0), WINDOW, (10, 2))
    assert drawn.any(axis=0).tolist() == [True] * 5 + [False] * 11 + [True] * 4
    assert not line_dots(np.zeros(0), np.zeros(0), WINDOW, (10, 2)).any()
    assert not line_dots(np.array([20.0, 30]), np.array([5.0, 5]), WINDOW, (10, 2)).any()
    assert not line_dots(np.array([np.nan, 5]), np.array([5.0, np.inf]), WINDOW, (10, 2)).any()


def test_of_many_points_the_extremes_survive() -> None:
    x = np.linspace(0, 10, 200_000)
    y = np.full(x.size, 1.0)
    y[123_456] = 9.5  # one sample alone
    drawn = line_dots(x, y, WINDOW, (40, 10))
    assert drawn[2, int(123_456 / 200_000 * 80)]
    y[50_000:60_000] = np.nan
    assert not line_dots(x, y, WINDOW, (40, 10))[:, 21:24].any()


@pytest.mark.parametrize("size", [(80, 20), (200, 46)])
def test_the_resonance_is_drawn_where_the_data_have_it(size: tuple[int, int]) -> None:
    async def steps(view: PlotStack, pilot: Pilot[None]) -> None:
        magnitude, phase = plots_of(view)
        highest = next(found for found in curve_dots(magnitude) if found)
        low, high = np.log10([GRID[0], GRID[-1]])
        margin = 0.01 * (high - low)
        expected = (np.log10(RESONANCE) - low + margin) / (high - low + 2 * margin) * magnitude.cells[0]
        assert abs(np.mean(highest) - expected) <= 1
        assert magnitude.column(np.log10(RESONANCE)) == pytest.approx(expected, abs=1)
        assert f"{RESONANCE_SIGN}{RESONANCE:.3g}" in "".join(drawn_rows(magnitude))
        text = screen_text(pilot.app)
        assert "Magnitude [dB re 1 mm/N]" in text
        assert "Phase [deg]" in text
        lines = text.splitlines()
        assert min(column for row in curve_dots(phase) for column in row) < 4  # the phase begins at the left edge
        names = next(row for row in lines if row.strip().startswith("Hz"))
        place = names.index("100") + 1 - magnitude.region.x - LEFT_CELLS
        assert abs(place - (np.log10(100) - low + margin) / (high - low + 2 * margin) * magnitude.cells[0]) <= 1

    shown([("a", resonant(GRID))], steps, size)


def test_points_that_had_not_settled_are_hollow_and_not_joined() -> None:
    few = np.geomspace(1.0, 400.0, 30)

    async def steps(view: PlotStack, pilot: Pilot[None]) -> None:
        view.view_range.bands = False
        view.view_range.cursor = None
        view.draw()
        await settle(pilot)
        plot = plots_of(view)[0]
        left, right = plot.column(np.log10(4.0)), plot.column(np.log10(15.0))
        text = "".join(row[left + 2 : right - 1] for row in drawn_rows(plot))
        assert UNSETTLED_SIGN in text
        assert not [column for row in curve_dots(plot) for column in row if left + 2 <= column < right - 1]
        assert ISOLATED_SIGN in "".join(drawn_rows(plot))  # 200 Hz stands between gaps

    response = gap(resonant(few), 3.9, 15.1)
    settled = response.settled.copy()
    settled[[-4, -2]] = False
    shown([("a", replace(response, settled=settled))], steps)


def test_limits_are_hatched_to_the_dot_until_they_are_taken_away() -> None:
    async def steps(view: PlotStack, pilot: Pilot[None]) -> None:
        hatched = [sum(len(row) for row in curve_dots(plot)) for plot in plots_of(view)]
        view.view_range.bands = False
        view.draw()
        await settle(pilot)
        assert all(
            sum(len(row) for row in curve_dots(of)) < most for of, most in zip(plots_of(view), hatched, strict=True)
        )

    response = resonant(np.geomspace(1, 30, 50))
    shown([("a", replace(response, covariance=1e3 * response.covariance))], steps)
    limits = np.array([[4.0, 4.0], [6.0, 6.0]])
    dots = CellCanvas((20, 5), (0, 0, 20, 5), WINDOW, "#000000")._hatched(np.array([0.0, 10]), limits)
    assert [row.any() for row in dots] == [False, False, True, False, False], "of 20 rows of dots, the middle four"


def test_curves_that_coincide_are_both_visible() -> None:
    pair = [("first", resonant(GRID)), ("second", resonant(GRID))]

    async def steps(view: PlotStack, pilot: Pilot[None]) -> None:
        plot = plots_of(view)[0]
        colours = [colour for row in range(plot.cells[1]) for text, colour in coloured(plot, row) if is_dots(text)]
        for of in (0, 1):
            assert colours.count(view.curve_styles.style(of).lower()) > plot.cells[0] // 4

    shown(pair, steps)


def test_without_colours_curves_carry_their_digits(monkeypatch: pytest.MonkeyPatch) -> None:
    async def steps(view: PlotStack, pilot: Pilot[None]) -> None:
        for plot in plots_of(view):
            text = "".join(drawn_rows(plot))
            assert "1" in text
            assert "2" in text

    pair = [("first", resonant(GRID)), ("second", resonant(GRID, at=70.0))]
    monkeypatch.setenv("NO_COLOR", "1")
    shown(pair, steps)


def test_zoom_keeps_both_panels_together_and_home_shows_all() -> None:
    async def steps(view: PlotStack, pilot: Pilot[None]) -> None:
        home = [view.window(0), view.window(1)]
        view.zoom(x=2)
        view.pan(x=0.3)
        upper, lower = (plot.window for plot in plots_of(view))
        assert upper[:2] == lower[:2] == view.window(0)[:2]
        assert upper[1] - upper[0] == pytest.approx((home[0][1] - home[0][0]) / 2)
        assert upper[2:] == home[0][2:]
        await pilot._post_mouse_events([MouseScrollUp], plots_of(view)[0], (40, 5))
        await settle(pilot)
        upper, lower = (plot.window for plot in plots_of(view))
        assert upper[:2] == lower[:2]
        view.home()
        assert [view.window(0), view.window(1)] == home

    shown([("a", resonant(GRID))], steps)


def test_the_cursor_steps_over_points_and_tells_all_curves() -> None:
    pair = [("first [bold]", resonant(GRID)), ("second", gap(resonant(GRID[::10]), 0, 1000))]

    async def steps(view: PlotStack, pilot: Pilot[None]) -> None:
        assert view.picture is not None
        view.place(RESONANCE)
        assert view.view_range.cursor == pytest.approx(RESONANCE, rel=1e-3)
        before = view.view_range.cursor
        view.step(1)
        assert view.view_range.cursor > before
        view.step(-1)
        assert view.view_range.cursor == pytest.approx(before, rel=1e-2)
        for _ in range(200):
            view.step(-1)
        assert view.view_range.cursor == GRID[0]
        view.place(RESONANCE)
        text = readout(view.picture, {0: "first [bold]", 1: "second"}, view.view_range, CurveStyles(), (100, 5)).plain
        first, second = text.splitlines()
        level = 20 * np.log10(abs(resonant(np.array([view.view_range.cursor])).response[0]) * 1e3)
        assert f"{level:.2f} dB" in first
        assert "first [bold]" in first
        assert "±" in first
        assert "not settled" in second
        view.view_range.hidden.add(1)
        text = readout(view.picture, {0: "first", 1: "second"}, view.view_range, CurveStyles(), (100, 1)).plain
        assert text.startswith(">1 ")  # the focused one is always shown

    shown(pair, steps)


@pytest.mark.parametrize(
    ("name", "cells", "expected"),
    [
        ("short", 8, "short   "),
        ("estimator.window 12", 9, "esti…w 12"),
        ("力力力力 12", 9, "力力 … 12"),
        ("estimator", 1, "…"),
        ("estimator", 0, ""),
    ],
)
def test_of_long_names_both_ends_are_left(name: str, cells: int, expected: str) -> None:
    assert shorten_name(name, cells) == expected
    assert cell_len(expected) == cells


def test_a_wrapped_phase_has_gaps_where_it_jumps() -> None:
    y = np.linspace(0, -400, 401)
    everywhere = np.ones(401, dtype=bool)
    trace = PlotTrace(0, np.arange(401.0), y, everywhere, np.arange(401.0), np.stack([y - 1, y + 1]))
    x, wrapped, band = settled_line(trace, wrapped=True)
    assert band is not None
    assert np.nanmin(wrapped) >= -180
    assert np.isnan(wrapped).sum() == 1
    assert np.nanmax(np.abs(np.diff(wrapped[np.isfinite(wrapped)][:180]))) < 2
    np.testing.assert_allclose((band[1] - wrapped)[np.isfinite(wrapped)], 1)
    assert len(x) == len(wrapped) == band.shape[1]


def test_the_numbers_are_those_of_the_figure() -> None:
    from fraexp.figures.kinds.bode import bode_info
    from tests.tui.responses import found

    response = resonant(GRID)
    picture = bode_picture([ShownResult("a", found(response))], None)
    (curve,) = bode_info([("a", response)]).curves
    for panel, part in zip(picture.panels, ("magnitude", "phase"), strict=True):
        (trace,) = panel.traces
        np.testing.assert_array_equal(trace.y, getattr(curve, part))
        np.testing.assert_array_equal(trace.band, getattr(curve, f"{part}_band"))
        np.testing.assert_allclose(10**trace.x, curve.frequency)


def test_heights_of_maxima_are_those_of_an_independent_method() -> None:
    from scipy.signal import find_peaks

    generator = np.random.default_rng(1)
    for values in (generator.normal(size=60), np.cumsum(generator.normal(size=400)), np.arange(5.0)):
        places, found = find_peaks(values, prominence=0)
        heights = prominences(values)
        assert list(heights) == places.tolist()
        np.testing.assert_allclose(list(heights.values()), found["prominences"])
