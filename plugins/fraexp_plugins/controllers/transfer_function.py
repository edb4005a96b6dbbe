"""A feedback controller as a general transfer function in z."""

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Controller, ParameterError, param


class TransferFunction(Controller, name="transfer_function", version=1):
    """C(z) = (b0 + b1 z⁻¹ + …) / (a0 + a1 z⁻¹ + …), any order (C(z) of the paper's Fig 3)."""

    numerator: tuple[float, ...] = param("N/m", "coefficients b_i in ascending powers of z⁻¹")
    denominator: tuple[float, ...] = param("1", "coefficients a_i in ascending powers of z⁻¹", (1.0,))

    def model_post_init(self, context: object) -> None:
        """Check that the transfer function is causal."""
        if not self.numerator or not self.denominator or self.denominator[0] == 0:
            raise ParameterError(
                "transfer_function needs at least one coefficient in numerator and denominator, "
                "and a denominator whose first coefficient is not 0"
            )

    def transfer_function(self, sample_time: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the coefficients, scaled so that the denominator starts with 1."""
        lead = self.denominator[0]
        return np.array(self.numerator) / lead, np.array(self.denominator) / lead
