"""Rolling friction of a linear guide: parallel elasto-slide elements (paper, section V-A)."""

from collections.abc import Callable

from fraexp_plugins.friction.elements import ElementModel


class Rolling(ElementModel, name="rolling", version=1):
    """Rolling friction by N parallel viscoelastic elements that slip, eqs (6)-(11), with viscous friction, eq (12).

    Each element is a stop operator: its deflection follows the displacement up to ±F_mi/K_i (eq 9) and its force
    is K_i y_i + D_i dy_i/dt (eq 7), limited to ±F_mi (eq 10). Also known as Maxwell slip, Jenkins or Iwan model.

    With D_i > 0 eqs (9) and (10) bind at different instants. Here (9) is the slider: the deflection stops at Y_mi,
    then the force is limited. `rolling_force_slider` takes (10) for the slider; without D_i both are the same.
    """

    @property
    def law(self) -> Callable[..., float]:
        """Without damped elements a law of half the cost, which gives the same."""
        return _undamped if not self.damping else super().law

    @staticmethod
    def advance(z, dy, dt, z_next, element_stiffness, damping, limit_deflection):  # type: ignore[no-untyped-def]
        """Friction force [N] after the displacement moved by dy [m] in dt [s]; z holds the deflections [m]."""
        force, n = 0.0, element_stiffness.size
        for i in range(n):
            limit = limit_deflection[i]
            z_next[i] = min(max(z[i] + dy, -limit), limit)
            change = z_next[i] - z[i]
            z_next[n + i] = change
            rate = (1.5 * change - 0.5 * z[n + i]) / dt  # at the step's end, to second order
            most = element_stiffness[i] * limit
            force += min(max(element_stiffness[i] * z_next[i] + damping[i] * rate, -most), most)
        return force


def _undamped(  # type: ignore[no-untyped-def]
    z, dy, dt, z_next, element_stiffness, damping, limit_deflection
):
    force = 0.0
    for i in range(element_stiffness.size):
        z_next[i] = min(max(z[i] + dy, -limit_deflection[i]), limit_deflection[i])
        force += element_stiffness[i] * z_next[i]
    return force
