"""A PID controller with filtered derivative; without integral action it is a lead."""

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Controller, ParameterError, param


class Pid(Controller, name="pid", version=1):
    """C(s) = Kp (1 + 1/(Ti s) + Td s/(Tf s + 1)), bilinear (Tustin) at the sample time.

    Without integral time it is the lead Kp ((Td + Tf) s + 1)/(Tf s + 1)
    (Åström and Hägglund, Advanced PID Control, 2006, section 3.4).
    """

    proportional: float = param("N/m", "proportional gain Kp", at_least=0)
    integral_time: float = param("s", "integral time Ti; 0 for no integral action", 0.0, at_least=0)
    derivative_time: float = param("s", "derivative time Td", 0.0, at_least=0)
    filter_time: float = param("s", "time constant Tf of the derivative's filter", 0.0, at_least=0)

    def model_post_init(self, context: object) -> None:
        """Check that the derivative is filtered: unfiltered, its bilinear form never stops ringing."""
        if self.derivative_time > 0 and self.filter_time == 0:
            raise ParameterError(
                "pid has a derivative_time but no filter_time; give it one, such as derivative_time/10"
            )

    def transfer_function(self, sample_time: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the sum of the three terms over their common denominator."""
        return self._fraction(sample_time, self.derivative_time)

    def reference_numerator(self, sample_time: float) -> NDArray[np.float64]:
        """Return the numerator without the derivative (Åström and Hägglund, section 3.4: setpoint weight c = 0)."""
        return self._fraction(sample_time, 0.0)[0]

    def _fraction(self, sample_time: float, derivative_time: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the sum of the terms, with another derivative time in its numerator, over their denominator."""
        forward, backward = np.array([1.0, -1.0]), np.array([1.0, 1.0])  # s = 2/Ts · (1 − z⁻¹)/(1 + z⁻¹)
        numerator, denominator = np.array([self.proportional]), np.array([1.0])
        if self.integral_time > 0:
            gain = self.proportional * sample_time / (2 * self.integral_time)
            numerator, denominator = _add_fractions(numerator, denominator, gain * backward, forward)
        if self.derivative_time > 0:
            filtered = 2 * self.filter_time * forward + sample_time * backward
            gain = 2 * self.proportional * derivative_time
            numerator, denominator = _add_fractions(numerator, denominator, gain * forward, filtered)
        lead = denominator[0]
        return numerator / lead, denominator / lead


def _add_fractions(
    n1: NDArray[np.float64], d1: NDArray[np.float64], n2: NDArray[np.float64], d2: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return numerator and denominator of n1/d1 + n2/d2, polynomials in ascending powers of z⁻¹."""
    first, second = np.convolve(n1, d2), np.convolve(n2, d1)
    total = np.zeros(max(first.size, second.size))
    total[: first.size] += first
    total[: second.size] += second
    return total, np.convolve(d1, d2)
