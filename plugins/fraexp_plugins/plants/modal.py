"""The modal plant: a rigid body and any number of vibration modes (paper, eq 1)."""

import numpy as np
from numpy.typing import NDArray

from fraexp.api import ParameterError, Plant, StateSpace, param


class Modal(Plant, name="modal", version=2):
    """P(s) = k0 (1/s² + Σ r_i / (s² + 2 ζ_i ω_i s + ω_i²)): eq (1) with k0 = Kt·Kt0 and r_i = k_ti/Kt0.

    A viscous coefficient D and a spring K between mass and ground act on the position: 1/(1/P + D s + K). They are for
    what is identified together with the guide. In a simulation its friction belongs to the friction model.
    """

    rigid_body_gain: float = param("m/(N s**2)", "rigid-body gain k0, the reciprocal of the moving mass", above=0)
    frequencies: tuple[float, ...] = param("Hz", "natural frequencies f_i of the modes", ())
    damping_ratios: tuple[float, ...] = param("1", "damping ratios ζ_i of the modes", ())
    modal_gain_ratios: tuple[float, ...] = param("1", "gains r_i of the modes relative to the rigid body", ())
    viscous_coefficient: float = param("N s/m", "viscous coefficient D between mass and ground", 0.0, at_least=0)
    ground_stiffness: float = param("N/m", "stiffness K of a spring between mass and ground", 0.0, at_least=0)

    def model_post_init(self, context: object) -> None:
        """Check that the modes belong together."""
        counts = {len(self.frequencies), len(self.damping_ratios), len(self.modal_gain_ratios)}
        if len(counts) > 1:
            raise ParameterError(
                "modal needs as many frequencies as damping_ratios and modal_gain_ratios, one of each per mode"
            )
        if min(self.frequencies, default=1.0) <= 0 or min(self.damping_ratios, default=0.0) < 0:
            raise ParameterError("modal needs frequencies above 0 Hz and damping_ratios of at least 0")

    def state_space(self) -> StateSpace:
        """Return P(s) with two states, position and velocity, for the rigid body and for each mode."""
        omega = 2 * np.pi * np.array([0.0, *self.frequencies])
        damping = np.array([0.0, *self.damping_ratios])
        ratio = np.array([1.0, *self.modal_gain_ratios])
        n = 2 * omega.size
        a, b, c = np.zeros((n, n)), np.zeros(n), np.zeros(n)
        a[0::2, 1::2] = np.eye(omega.size)
        a[1::2, 0::2] = np.diag(-(omega**2))
        a[1::2, 1::2] = np.diag(-2 * damping * omega)
        b[1::2] = 1.0
        c[0::2] = self.rigid_body_gain * ratio
        a -= np.outer(b, self.ground_stiffness * c + self.viscous_coefficient * np.roll(c, 1))
        return StateSpace(a, b, c)

    def response(self, omega: NDArray[np.floating]) -> NDArray[np.complex128]:
        """Return P(jω) [m/N] by eq (1)."""
        s = 1j * np.asarray(omega, dtype=float)
        total = 1 / s**2
        modes = zip(self.frequencies, self.damping_ratios, self.modal_gain_ratios, strict=True)
        for frequency, damping, ratio in modes:
            natural = 2 * np.pi * frequency
            total = total + ratio / (s**2 + 2 * damping * natural * s + natural**2)
        ground = self.viscous_coefficient * s + self.ground_stiffness
        free = self.rigid_body_gain * total
        return free / (1 + ground * free)
