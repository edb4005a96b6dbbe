"""Base class of the models of parallel elasto-slide elements."""

from abc import ABC
from collections.abc import Callable
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrictionModel, ParameterError, Parameters, Quantity, param


class VirginCurve(Parameters):
    """Force over displacement from rest, from which N elements are made: exact at their knots.

    ``exponential``: Fc (1 - e^{-x/x0}); ``hyperbolic``: Fc x/(x + x0); both scaled so that they end at Fc at the
    last knot. ``table``: measured points. Between knots x_i with slopes s_i the elements are K_i = s_i - s_{i+1}
    and Y_i = x_i (W. D. Iwan, J. Applied Mechanics 33(4), 1966, doi:10.1115/1.3625199).
    """

    shape: Literal["exponential", "hyperbolic", "table"] = param(
        "", "shape: exponential, hyperbolic or table", "exponential"
    )
    coulomb_force: float | None = param("N", "force Fc at the last knot", None, above=0)
    characteristic_displacement: float | None = param("m", "characteristic displacement x0", None, above=0)
    elements: int = param("1", "number of elements", 20, at_least=1, at_most=10_000)
    min_knot: float | None = param("m", "first knot; 1 % of x0 if not given", None, above=0)
    max_knot: float | None = param("m", "last knot; 5 x0 if not given", None, above=0)
    displacements: tuple[float, ...] = param("m", "displacements of the measured points, ascending", ())
    forces: tuple[float, ...] = param("N", "forces of the measured points", ())

    def points(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return knots x_i [m] and g(x_i) [N], each of shape (N,)."""
        if self.shape == "table":
            return self._measured_points()
        force, width = self.coulomb_force, self.characteristic_displacement
        if force is None or width is None:
            raise ParameterError(
                f"a virgin curve of shape '{self.shape}' needs coulomb_force [N] and characteristic_displacement [m]"
            )
        first, last = self.min_knot or 0.01 * width, self.max_knot or 5 * width
        if self.elements > 1 and first >= last:
            knots_given = Quantity(first, "m"), Quantity(last, "m")
            raise ParameterError("min_knot is ", knots_given[0], "; it must be below max_knot, ", knots_given[1])
        knots = np.geomspace(first, last, self.elements) if self.elements > 1 else np.array([last])
        shape = 1 - np.exp(-knots / width) if self.shape == "exponential" else knots / (knots + width)
        return knots, force * shape / shape[-1]

    def _measured_points(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        x, g = np.array(self.displacements), np.array(self.forces)
        if not x.size or x.size != g.size:
            raise ParameterError(
                f"a virgin curve has {x.size} displacements and {g.size} forces; expected as many of both"
            )
        slopes = np.diff(g, prepend=0.0) / np.diff(x, prepend=0.0) if np.all(np.diff(x, prepend=0.0) > 0) else None
        if slopes is None or np.any(slopes <= 0) or np.any(np.diff(slopes) > 0):
            raise ParameterError(
                "a virgin curve must rise from the origin, ever less steeply, over ascending displacements"
            )
        return x, g

    def stiffness_and_force(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return K_i [N/m] and F_mi [N] of the elements: one for each knot at which the slope changes."""
        knots, curve = self.points()
        slopes = np.diff(curve, prepend=0.0) / np.diff(knots, prepend=0.0)
        stiffness = slopes - np.append(slopes[1:], 0.0)
        significant = stiffness > 1e-12 * slopes[0]
        return tuple(stiffness[significant].tolist()), tuple((stiffness * knots)[significant].tolist())


class ElementModel(FrictionModel, ABC):
    """Parallel elements with stiffness K_i, viscous coefficient D_i and maximum force F_mi (paper, eqs 7, 8, 12)."""

    curve: VirginCurve | None = param("", "virgin curve that the elements follow, in place of their values", None)
    stiffness: tuple[float, ...] = param("N/m", "elastic coefficients K_i of the elements", ())
    limit_force: tuple[float, ...] = param("N", "maximum forces F_mi of the elements", ())
    damping: tuple[float, ...] = param("N s/m", "viscous coefficients D_i of the elements", ())
    viscous_coefficient: float = param("N s/m", "viscous coefficient D_v of the guide", 0.0, at_least=0)

    presets: ClassVar[dict[str, dict[str, object]]] = {
        "linear_motor_table": {
            "curve": {
                "coulomb_force": 17.9,
                "characteristic_displacement": 45.36e-6,
                "min_knot": 0.5e-6,
                "max_knot": 100e-6,
            },
            "viscous_coefficient": 4.69,
        }
    }

    def model_post_init(self, context: object) -> None:
        """Check that the elements belong together."""
        if self.curve is not None and (self.stiffness or self.limit_force):
            raise ParameterError(
                f"{self.name} has a curve and also stiffness or limit_force; expected one or the other"
            )
        stiffness, force = self.elements
        if not stiffness or len(force) != len(stiffness) or len(self.damping) not in (0, len(stiffness)):
            found = f"{len(stiffness)} stiffness, {len(force)} limit_force and {len(self.damping)} damping values"
            raise ParameterError(f"{self.name} has {found}; expected one of each per element (damping may be left out)")
        if min(stiffness) <= 0 or min(force) <= 0 or min(self.damping, default=0.0) < 0:
            raise ParameterError(f"{self.name} needs stiffness and limit_force above 0 and damping of at least 0")

    @cached_property
    def elements(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """K_i [N/m] and F_mi [N] of all elements."""
        return self.curve.stiffness_and_force() if self.curve is not None else (self.stiffness, self.limit_force)

    @property
    def law(self) -> Callable[..., float]:
        """`advance` for damped elements; without dampers all sliders are the same, and need no velocity."""
        return _advance_undamped if not self.damping else super().law

    @property
    def state_size(self) -> int:
        """Deflection [m] of each element, and the last step's mean velocity [m/s] if elements are damped."""
        return len(self.elements[0]) + (1 if self.damping else 0)

    @property
    def has_unique_periodic_force(self) -> bool:
        """Whether elements have no dampers: then one that slips forgets what came before, one that sticks is a spring.

        A damped element that never slips keeps its offset, and its force limit clips the force about that.
        """
        return not self.damping

    @property
    def force_bound(self) -> float:
        """ΣF_mi [N]."""
        return float(sum(self.elements[1]))

    @property
    def max_stiffness(self) -> float:
        """ΣK_i [N/m]: the stiffness after any reversal."""
        return float(sum(self.elements[0]))

    @cached_property
    def limit_deflection(self) -> NDArray[np.float64]:
        """Y_mi = F_mi/K_i [m], eq (8), shape (N,)."""
        return np.array(self.elements[1]) / self.element_stiffness

    @cached_property
    def element_stiffness(self) -> NDArray[np.float64]:
        """K_i [N/m], shape (N,)."""
        return np.array(self.elements[0])


def _advance_undamped(
    z: NDArray[np.float64],
    dy: float,
    dt: float,
    z_next: NDArray[np.float64],
    element_stiffness: NDArray[np.float64],
    damping: NDArray[np.float64],
    limit_deflection: NDArray[np.float64],
) -> float:
    force = 0.0
    for i in range(element_stiffness.size):
        z_next[i] = min(max(z[i] + dy, -limit_deflection[i]), limit_deflection[i])
        force += element_stiffness[i] * z_next[i]
    return force
