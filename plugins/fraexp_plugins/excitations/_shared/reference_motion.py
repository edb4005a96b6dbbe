"""Motions of the position reference at constant velocity between rounded reversals."""

from abc import ABC
from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from fraexp.api import Excitation, ParameterError, Period, Schedule, param
from fraexp_plugins.excitations._shared.sampling import MAX_SAMPLES_PER_PERIOD, MIN_SAMPLES_PER_PERIOD


def check_duration(name: str, duration: float, sample_time: float) -> None:
    """Refuse motions [s] that do not fit into memory, or are hardly sampled."""
    if duration / sample_time < MIN_SAMPLES_PER_PERIOD:
        raise ParameterError(
            f"{name} has a motion of {duration:.3g} s; at a sample time of {sample_time:g} s expected "
            f"{MIN_SAMPLES_PER_PERIOD * sample_time:g} s or more: lower the velocity, or shorten loop.sample_time"
        )
    if duration / sample_time > MAX_SAMPLES_PER_PERIOD:
        raise ParameterError(
            f"{name} has a period of {duration:.3g} s; at a sample time of {sample_time:g} s expected "
            f"{MAX_SAMPLES_PER_PERIOD * sample_time:g} s or less: raise the velocity, or shorten the travel"
        )


def check_rounding(name: str, velocity: float, acceleration: float, sample_time: float) -> None:
    """Refuse reversals that take more samples than fit into memory."""
    if 2 * velocity / acceleration > MAX_SAMPLES_PER_PERIOD * sample_time:
        raise ParameterError(
            f"{name} takes {2 * velocity / acceleration:.3g} s to reverse; at a sample time of {sample_time:g} s "
            f"expected {MAX_SAMPLES_PER_PERIOD * sample_time:g} s or less: raise the acceleration, "
            "or lower the velocity"
        )


def path_length(corners: Sequence[float]) -> float:
    """Return the length [m] of a closed path from 0 over these places [m] back to 0."""
    return float(np.sum(np.abs(np.diff([0.0, *corners, 0.0]))))


def reference_period(corners: Sequence[float], velocity: float, acceleration: float, sample_time: float) -> Period:
    """Return a period without force in which the reference goes from 0 over these places [m] back to 0.

    It moves at `velocity` [m/s]; a moving average over 2V/a rounds its reversals to the `acceleration` a [m/s²].
    """
    places = np.array([0.0, *corners, 0.0])
    times = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(places)))]) / velocity
    samples = max(round(times[-1] / sample_time), 2)
    reference = np.interp(np.arange(samples) * times[-1] / samples, times, places)
    rounding = max(round(2 * velocity / acceleration / sample_time), 1)
    if rounding > 1:
        kernel = np.zeros(samples)
        np.add.at(kernel, (np.arange(rounding) - rounding // 2) % samples, 1 / rounding)
        reference = np.fft.irfft(np.fft.rfft(reference) * np.fft.rfft(kernel), samples)
    return Period(np.zeros(samples), np.array([1]), reference)


class ReferenceMotion(Excitation, ABC):
    """The position reference moves at constant velocities, without a force; it is recorded from rest."""

    cycles: int = param("1", "number of repetitions of the motion", 3, at_least=1, at_most=10_000)

    expected_failures: ClassVar[dict[str, str]] = {
        "whole-periods": "It moves the reference alone, so the force that it adds is 0."
    }

    def check_velocities(self, velocities: Sequence[float]) -> None:
        """Refuse velocities that are none."""
        if not velocities or min(velocities) <= 0:
            raise ParameterError(f"{self.name}.velocities needs one or more velocities above 0 m/s")

    @property
    def schedule(self) -> Schedule:
        """Record from rest: the elements' state is known there, and only the loop would settle."""
        return Schedule(settling_timeout=0, recorded_periods=self.cycles)
