"""A PID controller with notch filters at vibration modes."""

import numpy as np
from numpy.typing import NDArray

from fraexp.api import ParameterError, param
from fraexp_plugins.controllers.pid import Pid


class NotchedPid(Pid, name="notched_pid", version=1):
    """`pid` in series with notches (s² + 2 ζ d ω s + ω²)/(s² + 2 ζ ω s + ω²), each bilinear with its ω prewarped.

    ζ is a notch's width and d < 1 its gain at ω (W. Messner and R. Oboe, Proc. American Control Conference, 2004).
    """

    notch_frequencies: tuple[float, ...] = param("Hz", "frequencies of the notches", ())
    notch_widths: tuple[float, ...] = param("1", "damping ratios ζ of the notches' poles", ())
    notch_depths: tuple[float, ...] = param("1", "gains d of the notches at their frequencies", ())

    def model_post_init(self, context: object) -> None:
        """Check that the notches' values belong together."""
        super().model_post_init(context)
        if len({len(self.notch_frequencies), len(self.notch_widths), len(self.notch_depths)}) > 1:
            raise ParameterError(
                "notched_pid needs as many notch_frequencies as notch_widths and notch_depths, one of each per notch"
            )
        if min((*self.notch_frequencies, *self.notch_widths, *self.notch_depths), default=1.0) <= 0:
            raise ParameterError("notched_pid has a notch value of 0 or less; expected all above 0")

    def _fraction(self, sample_time: float, derivative_time: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the PID's fraction times that of each notch; ParameterError above the Nyquist frequency."""
        numerator, denominator = super()._fraction(sample_time, derivative_time)
        for frequency, width, depth in zip(self.notch_frequencies, self.notch_widths, self.notch_depths, strict=True):
            if frequency >= 0.5 / sample_time:
                raise ParameterError(
                    f"notched_pid has a notch at {frequency:g} Hz; expected less than {0.5 / sample_time:g} Hz, half "
                    "the sample rate"
                )
            t = np.tan(np.pi * frequency * sample_time)
            ends, middle = np.array([1 + t * t, 1 + t * t]), 2 * (t * t - 1)
            zeros = np.array([ends[0] + 2 * width * depth * t, middle, ends[1] - 2 * width * depth * t])
            poles = np.array([ends[0] + 2 * width * t, middle, ends[1] - 2 * width * t])
            numerator, denominator = np.convolve(numerator, zeros), np.convolve(denominator, poles)
        return numerator / denominator[0], denominator / denominator[0]
