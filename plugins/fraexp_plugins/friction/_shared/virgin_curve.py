"""Virgin curves g(x), and the elasto-slide elements that follow them."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fraexp.api import ParameterError, Parameters, param


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
            raise ParameterError(f"min_knot is {first:g} m; it must be below max_knot, {last:g} m")
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
