"""A PID controller with filtered derivative; without integral action it is a lead."""

import numpy as np

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
        """Check that the derivative is filtered: unfiltered, its bilinear form rings for ever."""
        if self.derivative_time > 0 and self.filter_time == 0:
            raise ParameterError(
                "pid has a derivative_time but no filter_time; give it one, such as derivative_time/10"
            )

    def transfer_function(self, sample_time: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the sum of the three terms over their common denominator."""
        forward, backward = np.array([1.0, -1.0]), np.array([1.0, 1.0])  # s = 2/Ts · (1 − z⁻¹)/(1 + z⁻¹)
        numerator, denominator = np.array([self.proportional]), np.array([1.0])
        if self.integral_time > 0:
            gain = self.proportional * sample_time / (2 * self.integral_time)
            numerator, denominator = _add(numerator, denominator, gain * backward, forward)
        if self.derivative_time > 0:
            filtered = 2 * self.filter_time * forward + sample_time * backward
            gain = 2 * self.proportional * self.derivative_time
            numerator, denominator = _add(numerator, denominator, gain * forward, filtered)
        lead = denominator[0]
        return numerator / lead, denominator / lead


def _add(n1: np.ndarray, d1: np.ndarray, n2: np.ndarray, d2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    # Polynomials in z⁻¹ add up aligned at the constant term.
    first, second = np.convolve(n1, d2), np.convolve(n2, d1)
    total = np.zeros(max(first.size, second.size))
    total[: first.size] += first
    total[: second.size] += second
    return total, np.convolve(d1, d2)
