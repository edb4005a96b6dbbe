"""Responses from the phasors of whole periods: what is refused, and how."""

import numpy as np
import pytest
from fraexp_plugins.estimators.conventional import Conventional

from fraexp.data.signals import Segment, Signals
from fraexp.data.texts import frequency_text
from fraexp.errors import RecordError
from tests.refusals import refused


def segment(line: int) -> Segment:
    wave = np.sin(2 * np.pi * line * np.arange(100) / 100)[None]
    return Segment(1e-3, {"u": wave, "y": 2 * wave}, np.array([line]))


def test_segments_with_the_same_frequencies_are_named():
    signals = Signals((segment(2), segment(5), segment(2)), {"u": "N", "y": "m"})
    with refused(RecordError, "2 of 3", "20 Hz"):
        Conventional().estimate(signals)


@pytest.mark.parametrize(
    ("frequencies", "text"), [([1.0], "1 Hz"), ([1.0, 1.0], "1 Hz"), ([80.0, 2.0, 5.0], "2 to 80 Hz")]
)
def test_one_frequency_is_no_range(frequencies, text):
    assert frequency_text(frequencies) == text
