"""The sum of several friction models."""

from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrictionModel, ParameterError, PositionDependentFriction, param

if TYPE_CHECKING:  # only the checker needs the name of this type: importing it would import numba
    from fraexp.kernels.law_arguments import LawArgument

Law = Callable[..., float]


class Composite(FrictionModel, name="composite", version=1):
    """Several friction models that act on the same displacement; their forces add up (paper, eq 13)."""

    parts: tuple[FrictionModel, ...] = param("", "the models, each with its name and parameters")

    presets: ClassVar[dict[str, dict[str, object]]] = {
        "dahl_and_viscous": {
            "parts": [
                {"name": "dahl", "stiffness": 3.9e5, "coulomb_force": 17.9},
                {"name": "none", "viscous_coefficient": 4.69},
            ]
        }
    }

    def model_post_init(self, context: object) -> None:
        """Check that there is something to add, at one contact."""
        if not self.parts:
            raise ParameterError("composite has no parts; expected friction models such as [{ name = 'rolling', ... }]")
        positioned = next((part.name for part in self.parts if isinstance(part, PositionDependentFriction)), "")
        if positioned:
            found = f"composite's part {positioned} has a position_dependence"
            raise ParameterError(f"{found}; expected it beside parts: all of them act at one contact")

    @property
    def state_size(self) -> int:
        """Size of all parts' states, which lie one after another."""
        return sum(part.state_size for part in self.parts)

    @property
    def viscous(self) -> float:
        """Sum of the parts' viscous coefficients [N s/m]."""
        return sum(part.viscous for part in self.parts)

    @property
    def force_bound(self) -> float | None:
        """Sum of the parts' bounds [N]; None if one of them has none."""
        bounds = [part.force_bound for part in self.parts]
        known = [bound for bound in bounds if bound is not None]
        return sum(known) if len(known) == len(bounds) else None

    @property
    def max_stiffness(self) -> float:
        """Sum of the parts' maximum stiffnesses [N/m]."""
        return sum(part.max_stiffness for part in self.parts)

    @property
    def law(self) -> Law:
        """The sum of the parts' laws."""
        law = self.parts[-1].law
        for part in self.parts[-2::-1]:
            law = _sum(part.law, law)
        return law

    def law_arguments(self) -> "tuple[LawArgument, ...]":
        """Return the size of the first part's state, its arguments, and those of the rest."""
        arguments = self.parts[-1].law_arguments()
        for part in self.parts[-2::-1]:
            arguments = (part.state_size, part.law_arguments(), arguments)
        return arguments

    @staticmethod
    def advance(z: NDArray[np.float64], dy: float, dt: float, z_next: NDArray[np.float64]) -> float:
        """Not used: `law` adds up the parts' laws."""
        raise NotImplementedError


@cache
def _sum(first: Law, rest: Law) -> Law:
    def advance(
        z: NDArray[np.float64],
        dy: float,
        dt: float,
        z_next: NDArray[np.float64],
        size: int,
        first_arguments: tuple[object, ...],
        rest_arguments: tuple[object, ...],
    ) -> float:
        force = first(z[:size], dy, dt, z_next[:size], *first_arguments)
        return force + rest(z[size:], dy, dt, z_next[size:], *rest_arguments)

    return advance
