"""Samples that no estimator can square are refused, with their channel."""

import numpy as np
import pytest

from fraexp.data.signals import Segment, Signals
from fraexp.errors import RecordError
from tests.refusals import refused


def signals(*positions: list[float]) -> Signals:
    segments = [Segment(1e-3, {"u": np.ones((1, 2)), "y": np.array([each])}, np.array([1])) for each in positions]
    return Signals(tuple(segments), {"u": "N", "y": "m"})


@pytest.mark.parametrize(
    ("value", "text"), [(np.nan, "nan m"), (-np.inf, "without bound"), (-1e101, "1e+101 m"), (1e-101, "1e-101 m")]
)
def test_a_channel_of_any_segment_is_named(value: float, text: str) -> None:
    wrong = signals([1.0, -2.0], [0.0, value], [3.0, 0.0])
    for _ in range(2):  # a second estimator asks again
        with refused(RecordError, "channel 'y'", text, "1e-100", "1e+100"):
            wrong.check_values()


def test_rest_numbers_in_between_and_no_samples_are_right() -> None:
    signals([0.0, 0.0], [1e99, -1e-99], [-2.0, 0.0]).check_values()
    Signals((), {}).check_values()
