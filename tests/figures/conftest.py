from collections.abc import Callable

import numpy as np
import pytest

from fraexp.data.results import Curve, FrequencyResponse

ResponseMaker = Callable[..., FrequencyResponse]
LoopMaker = Callable[[float], Curve]


@pytest.fixture
def make_response() -> ResponseMaker:
    def make(frequency, response, *, settled=None, deviation=None, unit="m/N", entry="u"):
        count = len(frequency)
        covariance = np.full((count, 2, 2), np.nan)
        if deviation is not None:
            covariance = np.eye(2) * np.asarray(deviation, dtype=float)[:, None, None] ** 2
        return FrequencyResponse(
            frequency=np.asarray(frequency, dtype=float),
            response=np.asarray(response, dtype=complex),
            covariance=covariance,
            unit=unit,
            input=entry,
            output="y",
            input_amplitude=np.ones(count),
            output_amplitude=np.abs(response),
            settled=np.ones(count, dtype=bool) if settled is None else np.asarray(settled),
            settling_time=np.ones(count),
            residual=np.zeros(count),
            harmonics=np.zeros((count, 6), dtype=complex),
        )

    return make


@pytest.fixture
def make_loop() -> LoopMaker:
    def make(amplitude: float) -> Curve:
        angle = np.linspace(0, 2 * np.pi, 41)
        columns = {"displacement": amplitude * np.cos(angle), "force": np.sin(angle)}
        return Curve("loop", columns, {"displacement": "m", "force": "N"})

    return make
