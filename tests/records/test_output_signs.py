"""Whether outputs are said to move against each other: only where they do at the lowest frequencies."""

import numpy as np
import pytest

from fraexp.records.proposals import opposite_pairs

PERIOD = 200
TIME = np.arange(3 * PERIOD) / PERIOD
LINES = (2, 5, 9, 40)


def signal(*gains: complex) -> np.ndarray:
    """Return three periods of a multisine with these complex amplitudes."""
    return sum((gain * np.exp(2j * np.pi * line * TIME)).real for line, gain in zip(LINES, gains, strict=True))


@pytest.mark.parametrize(
    ("other", "expected"),
    [
        ((-1.0, -1.1, -1.3, 0.2), [("x", "y")]),
        ((-1.0, -1.1 * np.exp(0.2j), -1.3, 0.2), [("x", "y")]),
        ((1.0, 1.1, 1.3, -0.2), []),
        ((-1.0, -1.1, 1.3, -1.0), []),
        ((-1.0, 1j, -1.0, -1.0), []),
        ((-5.0, -5.0, -5.0, -5.0), []),
        ((0.0, 0.0, 0.0, 0.0), []),
    ],
)
def test_outputs_are_opposite_only_at_all_of_the_lowest_lines(
    other: tuple[complex, ...], expected: list[tuple[str, str]]
) -> None:
    columns = {"u": signal(1, 1, 1, 1), "x": signal(1, 1, 1, 1), "y": signal(*other)}
    assert list(opposite_pairs(columns, "u", PERIOD)) == expected
