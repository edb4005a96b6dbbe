"""Responses and loops that figures show."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fraexp.data.results import Curve, FrequencyResponse
from tests.responses import frequency_response


def make_response(
    frequency: ArrayLike, response: ArrayLike, *, deviation: Any = None, settled: Any = None, **known: Any
) -> FrequencyResponse:
    """Return a response with a standard deviation of its real and of its imaginary part, if given."""
    if deviation is not None:
        known["covariance"] = np.eye(2) * np.asarray(deviation, dtype=float)[:, None, None] ** 2
    if settled is not None:
        known["settled"] = np.asarray(settled)
    return frequency_response(frequency, response, **known)


def make_loop(amplitude: float) -> Curve:
    angle = np.linspace(0, 2 * np.pi, 41)
    columns = {"displacement": amplitude * np.cos(angle), "force": np.sin(angle)}
    return Curve("loop", columns, {"displacement": "m", "force": "N"})
