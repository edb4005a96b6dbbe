"""What estimators of a plant behind delays have in common: G_di and G_do of the paper's Fig 10."""

from abc import ABC

import numpy as np

from fraexp.api import Estimator, hold_response, image_factor, param, path_response


class DelayedEstimator(Estimator, ABC):
    """An estimator that knows the delays between control input and thrust, and between position and its sample."""

    input: str = param("", "channel of the control input", "u")
    output: str = param("", "channel of the measured position", "y")
    input_dead_time: float = param("s", "dead time in G_di", 0.0, at_least=0, inherit="loop.input_dead_time")
    input_lags: tuple[float, ...] = param("s", "first-order lags in G_di", (), inherit="loop.input_lags")
    output_dead_time: float = param("s", "dead time in G_do", 0.0, at_least=0, inherit="loop.output_dead_time")
    output_lags: tuple[float, ...] = param("s", "first-order lags in G_do", (), inherit="loop.output_lags")
    hold: bool = param("", "whether the input is held between samples", True)
    roll_off: int = param(
        "1", "relative degree of the plant, for the images of sampling; 0 to leave them", 2, at_least=0
    )

    def input_path(self, omega: np.ndarray, sample_time: float | np.ndarray) -> np.ndarray:
        """Return G_di(jω) with hold and images, shape (n,), at ω [rad/s], shape (n,)."""
        path = path_response(omega, self.input_dead_time, self.input_lags)
        if not self.hold:
            return path
        path = path * hold_response(omega, sample_time)
        if not self.roll_off:
            return path
        delay = self.input_dead_time + self.output_dead_time
        return path * image_factor(omega, sample_time, delay, self.input_lags + self.output_lags, self.roll_off)

    def output_path(self, omega: np.ndarray) -> np.ndarray:
        """Return G_do(jω), shape (n,), at ω [rad/s], shape (n,)."""
        return path_response(omega, self.output_dead_time, self.output_lags)
