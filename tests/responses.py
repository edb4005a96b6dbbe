"""Frequency responses that several tests use."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fraexp.components.kinds import Estimator
from fraexp.data.results import FrequencyResponse, Result
from fraexp.data.signals import Signals
from fraexp.execution.verdict import judge
from fraexp.study.accuracy import Accuracy


def frequency_response(frequency: ArrayLike, response: ArrayLike, **known: Any) -> FrequencyResponse:
    """Return a settled response [m/N] of y to u without a band or distortion, but for what is known."""
    values = np.asarray(response, dtype=complex)
    count = values.size
    plain = {
        "covariance": np.full((count, 2, 2), np.nan),
        "unit": "m/N",
        "input": "u",
        "output": "y",
        "input_amplitude": np.ones(count),
        "output_amplitude": np.abs(values),
        "settled": np.ones(count, dtype=bool),
        "settling_time": np.ones(count),
        "residual": np.zeros(count),
        "harmonics": np.zeros((count, 6), dtype=complex),
    }
    return FrequencyResponse(frequency=np.asarray(frequency, dtype=float), response=values, **(plain | known))


def judged(estimator: Estimator, signals: Signals) -> Result:
    """Return what a sweep has of an estimator, if its study asks for no accuracy of its own."""
    return judge(estimator.estimate(signals), Accuracy(), estimator)
