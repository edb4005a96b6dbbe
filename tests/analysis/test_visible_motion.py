"""Noise passes for motion as seldom as is stated, and motion far below the noise of a sample is seen."""

import numpy as np
import pytest

from fraexp.analysis.quantisation import moves_visibly
from fraexp.analysis.tolerances import SIGNIFICANCE
from fraexp.data.signals import Segment

TIME = np.arange(200)


@pytest.mark.parametrize(("lines", "periods"), [((1,), 2), ((3,), 6), ((2, 5, 9), 3)])
def test_noise_seldom_passes_for_motion_and_motion_does(lines: tuple[int, ...], periods: int) -> None:
    random, seen = np.random.default_rng(71), {0.0: 0, 10.0: 0}
    wave = np.sum([np.cos(2 * np.pi * line * TIME / TIME.size + line) for line in lines], axis=0)
    for amplitude in seen:
        for _ in range(2000):
            position = amplitude * wave + random.standard_normal((periods, TIME.size))
            seen[amplitude] += moves_visibly([Segment(1e-3, {"y": position}, np.array(lines))], "y")
    assert seen[0.0] <= 2000 * SIGNIFICANCE + 4 * np.sqrt(2000 * SIGNIFICANCE)
    assert seen[10.0] == 2000


def test_motion_below_the_noise_of_a_sample_is_seen() -> None:
    noise = np.random.default_rng(5).standard_normal((8, TIME.size))
    position = 0.5 * np.sin(2 * np.pi * 7 * TIME / TIME.size) + noise
    assert moves_visibly([Segment(1e-3, {"y": position}, np.array([7]))], "y")
    assert moves_visibly([Segment(1e-3, {"y": noise[:1]}, np.array([7]))], "y")  # a single period shows no scatter
    assert not moves_visibly([Segment(1e-3, {"y": np.zeros((3, TIME.size))}, np.array([7]))], "y")


def test_an_axis_that_wanders_is_not_said_to_stand() -> None:
    moved = np.cumsum(np.random.default_rng(6).standard_normal((6, TIME.size)), axis=1)
    assert moves_visibly([Segment(1e-3, {"y": moved}, np.array([7]))], "y")
