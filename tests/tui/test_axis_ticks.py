"""Ticks of an axis in a terminal, and their labels."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fraexp.tui.plotting.plot_widget import TickFormatter, tick_text
from tests.examples import portion


def labelled(formatter: TickFormatter, low: float, high: float) -> tuple[list[float], list[str]]:
    """Return the ticks of an axis and their labels."""
    ticks = formatter.ticks(low, high)
    return [at for at, _ in ticks], [label for _, label in ticks]


@pytest.mark.parametrize(
    ("span", "room", "labels"),
    [
        ((0.0, 2.0), 20, ["1", "10", "100"]),
        ((0.0, 2.30103), 60, ["1", "2", "5", "10", "20", "50", "100", "200"]),
        ((2.0, 5.0), 30, ["100", "1k", "10k", "100k"]),
        ((-3.0, 0.0), 30, ["0.001", "0.01", "0.1", "1"]),
        ((np.log10(38), np.log10(42)), 40, ["38", "39", "40", "41", "42"]),
        ((0.0, 12.0), 30, ["1", "1k", "1M", "1G", "1T"]),
    ],
)  # fmt: skip
def test_frequencies_are_named_as_far_as_there_is_room(span: tuple[float, float], room: int, labels: list[str]) -> None:
    ticks, found = labelled(TickFormatter(room, logarithmic=True), *span)
    assert found == labels
    assert ticks == sorted(ticks)


@given(st.floats(-9, 9), st.floats(1e-4, 15), st.integers(8, 200), st.booleans())
@settings(max_examples=portion(200))
def test_labels_never_touch(low: float, width: float, room: int, logarithmic: bool) -> None:
    ticks, labels = labelled(TickFormatter(room, logarithmic=logarithmic), low, low + width)
    assert all(low - 1e-9 <= tick <= low + width + 1e-9 for tick in ticks)
    places = [(tick - low) / width * room for tick in ticks]
    for (before, after), label in zip(pairwise(places), labels[1:], strict=True):
        assert after - before > len(label)


def test_phases_are_named_in_fractions_of_a_turn() -> None:
    assert labelled(TickFormatter(5, upright=True, angle=True), -185, 5)[1] == ["-180", "-90", "0"]
    _, labels = labelled(TickFormatter(9, upright=True, angle=True), -185, 5)
    assert labels == ["-180", "-135", "-90", "-45", "0"]
    assert tick_text(2500) == "2.5k"


def test_labels_of_a_wide_span_are_found_soon() -> None:
    ticks, labels = labelled(TickFormatter(13, upright=True), -6.3, 6.3)
    assert labels == ["-6", "-4", "-2", "0", "2", "4", "6"]
    assert labelled(TickFormatter(3, upright=True), 0.0, 1000.0)[1] == ["0", "500", "1k"]
    assert ticks == [-6.0, -4.0, -2.0, 0.0, 2.0, 4.0, 6.0]
