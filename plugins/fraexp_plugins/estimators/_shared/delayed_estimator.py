"""Estimators of a plant behind delays: G_di and G_do of the paper's Fig 10."""

from abc import ABC
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Estimator, Signals, hold_response, image_factor, param, path_response


class LoopDelays(NamedTuple):
    """The delays between control input and thrust, and between displacement and its sample."""

    input_dead_time: float
    input_time_constants: tuple[float, ...]
    output_dead_time: float
    output_time_constants: tuple[float, ...]
    zero_order_hold: bool
    relative_degree: int

    def input_path(
        self, omega: NDArray[np.float64], sample_time: float | NDArray[np.float64]
    ) -> NDArray[np.complex128]:
        """Return G_di(jω) with the hold and its aliasing images, shape (n,), at ω [rad/s], shape (n,)."""
        path = path_response(omega, self.input_dead_time, self.input_time_constants)
        if not self.zero_order_hold:
            return path
        path = path * hold_response(omega, sample_time)
        if not self.relative_degree:
            return path
        dead_time = self.input_dead_time + self.output_dead_time
        time_constants = self.input_time_constants + self.output_time_constants
        return path * image_factor(omega, sample_time, dead_time, time_constants, self.relative_degree)

    def output_path(self, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return G_do(jω), shape (n,), at ω [rad/s], shape (n,)."""
        return path_response(omega, self.output_dead_time, self.output_time_constants)


class DelayedEstimator(Estimator, ABC):
    """An estimator that knows the delays between control input and thrust, and between displacement and its sample."""

    input: str = param("", "channel of the control input", "u")
    output: str = param("", "channel of the measured position", "y")
    input_dead_time: float = param("s", "dead time in G_di", 0.0, at_least=0, inherit="loop.input_dead_time")
    input_time_constants: tuple[float, ...] = param(
        "s", "time constants of the first-order lags in G_di", (), inherit="loop.input_time_constants"
    )
    output_dead_time: float = param("s", "dead time in G_do", 0.0, at_least=0, inherit="loop.output_dead_time")
    output_time_constants: tuple[float, ...] = param(
        "s", "time constants of the first-order lags in G_do", (), inherit="loop.output_time_constants"
    )
    zero_order_hold: bool = param("", "whether the control input is held between samples", True)
    relative_degree: int = param(
        "1", "relative degree of the plant, for the aliasing images of the hold; 0 to ignore them", 2, at_least=0
    )

    def fitted_to(self, signals: Signals) -> Self:
        """Return the estimator without a hold for a response that was measured elsewhere: it was never sampled here.

        Half a sample of its own hold counts as dead time.
        """
        return self.model_copy(update={"zero_order_hold": False}) if signals.are_stated else self

    @property
    def delays(self) -> LoopDelays:
        """The delays as a value of their own."""
        return LoopDelays(*(getattr(self, name) for name in LoopDelays._fields))

    def input_path(
        self, omega: NDArray[np.float64], sample_time: float | NDArray[np.float64]
    ) -> NDArray[np.complex128]:
        """Return G_di(jω) with the hold and its aliasing images, shape (n,), at ω [rad/s], shape (n,)."""
        return self.delays.input_path(omega, sample_time)

    def output_path(self, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return G_do(jω), shape (n,), at ω [rad/s], shape (n,)."""
        return self.delays.output_path(omega)


class PlantReferredEstimator(DelayedEstimator, ABC):
    """An estimator whose response can be referred to the plant: divided by the delays and the hold."""

    refer_to_plant: bool = param(
        "", "whether the response is divided by G_di, G_do and the hold, to compare it with P(jω)", False
    )

    def path(self, frequency: NDArray[np.float64], sample_time: float) -> NDArray[np.complex128]:
        """Return all between input and output except the plant, shape (n,), at f [Hz]; ones if it is to stay."""
        if not self.refer_to_plant:
            return np.ones(frequency.size, dtype=complex)
        omega = 2 * np.pi * frequency
        return self.input_path(omega, sample_time) * self.output_path(omega)
