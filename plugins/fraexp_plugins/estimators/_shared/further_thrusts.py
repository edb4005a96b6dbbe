"""Control inputs of thrusts other than the excited one, which hold their positions while that one is excited."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Ports, Segment, Signals, record_spectrum


def further_thrusts(channels: Iterable[str], ports: Ports) -> dict[str, NDArray[np.float64]]:
    """Return the columns of thrusts whose control inputs, such as `u.right`, are among the channels, by channel."""
    return {f"u.{name}": column for name, column in ports.thrusts.items() if f"u.{name}" in channels}


def refer_thrusts(signals: Signals, control_input: str, ports: Ports, position: str) -> Signals:
    """Return signals whose control input counts further thrusts too, each as the first thrust that moves `position` so.

    Dead time, lags and hold are the same for all thrusts.
    """
    further = further_thrusts(signals.units, ports)
    if not further:
        return signals

    def refer(segment: Segment) -> Segment:
        samples, bins = segment.channels[control_input], record_spectrum(segment, control_input).copy()
        omega = record_omega(segment, samples.size)
        for channel, column in further.items():
            bins[1:] += ports.share(column, omega, position) * record_spectrum(segment, channel)[1:]
        referred = np.fft.irfft(bins, samples.size).reshape(samples.shape)
        return replace(segment, channels={**segment.channels, control_input: referred})

    return replace(signals, segments=tuple(map(refer, signals.segments)))


def record_omega(segment: Segment, samples: int) -> NDArray[np.float64]:
    """Return the angular frequencies of the spectrum of a record [rad/s], without 0."""
    return np.asarray(2 * np.pi * np.fft.rfftfreq(samples, segment.sample_time)[1:], dtype=float)
