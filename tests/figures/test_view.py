"""A band of a figure, and a phase within ±180°."""

import numpy as np
import pytest

from fraexp.data.results import Outcome, Result
from fraexp.errors import FraexpError
from fraexp.figures.drawing import draw_figure
from fraexp.figures.elements.grouping import ShownResult
from fraexp.figures.elements.view import View, wrap_phase
from tests.figures.curves import make_response
from tests.refusals import refused


@pytest.fixture
def shown() -> list[ShownResult]:
    """A response whose phase falls from -90° to -630° over two decades, and its magnitude by 40 dB."""
    frequency = np.geomspace(1.0, 100.0, 55)
    turn = np.linspace(-90.0, -630.0, 55)
    values = 1e-3 * frequency**-1.0 * np.exp(1j * np.radians(turn))
    return [ShownResult("falls", Result(Outcome.OK, response=make_response(frequency, values)))]


def test_only_a_band_is_seen_as_high_as_its_lines(shown: list[ShownResult]) -> None:
    upper, lower = draw_figure(shown, view=View.parse("2:20")).axes
    assert upper.get_xlim() == pytest.approx((2 / 1.01, 20 * 1.01))
    low, high = upper.get_ylim()
    assert -28.0 < low < -26.0
    assert -6.1 < high < -4.5
    assert all(step % 45 == 0 for step in np.diff(lower.get_yticks()))


def test_a_wrapped_phase_is_interrupted_where_it_jumps(shown: list[ShownResult]) -> None:
    lower = draw_figure(shown, view=View(wrapped=True)).axes[1]
    phase = np.concatenate([np.asarray(line.get_ydata(), float) for line in lower.lines])
    assert np.nanmin(phase) >= -180.0
    assert np.nanmax(phase) < 180.0
    assert np.nanmax(np.abs(np.diff(phase))) < 180.0
    assert np.isnan(phase).sum() >= 2


def test_a_phase_is_wrapped_to_the_nearest_turn() -> None:
    assert wrap_phase(np.array([-540.0, -190.0, -180.0, 0.0, 179.0, 181.0])) == pytest.approx(
        [-180, 170, -180, 0, 179, -179]
    )


@pytest.mark.parametrize("text", ["20:6", "0:3", "3", "a:b", "1:2:3", "1:inf", "-1:3", "nan:3"])
def test_what_is_no_band_is_refused(text: str) -> None:
    with refused(FraexpError, "--frequency-range", "4.5:45"):
        View.parse(text)


def test_a_view_tells_its_options_and_reads_them_again() -> None:
    view = View((4.5, 45.25), wrapped=True)
    assert view.options() == ["--frequency-range=4.5:45.25", "--wrap-phase"]
    assert View.parse("4.5:45.25", wrapped=True) == view
    assert View().options() == []


def test_kinds_without_frequencies_or_phase_refuse(shown: list[ShownResult]) -> None:
    with refused(FraexpError, "frequency range", "nyquist", "bode"):
        draw_figure(shown, kind="nyquist", view=View((1.0, 2.0)))
    with refused(FraexpError, "--wrap-phase", "coherence", "bode"):
        draw_figure(shown, kind="coherence", view=View(wrapped=True))
