"""The sum of several friction models."""

from collections.abc import Callable
from functools import cache
from typing import Any, ClassVar

from fraexp.api import FrictionModel, ParameterError, param

Law = Callable[..., float]


class Composite(FrictionModel, name="composite", version=1):
    """Several friction models that act on the same displacement; their forces add up (paper, eq 13)."""

    parts: tuple[FrictionModel, ...] = param("", "the models, each with its name and parameters")

    presets: ClassVar[dict[str, dict[str, Any]]] = {
        "dahl_and_viscous": {
            "parts": [
                {"name": "dahl", "stiffness": 3.9e5, "coulomb": 17.9},
                {"name": "none", "viscous_coefficient": 4.69},
            ]
        }
    }

    def model_post_init(self, context: object) -> None:
        """Check that there is something to add."""
        if not self.parts:
            raise ParameterError("composite has no parts; expected friction models such as [{ name = 'rolling', ... }]")

    @property
    def state_size(self) -> int:
        """The parts' memories, one after another."""
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
    def greatest_stiffness(self) -> float:
        """Sum of the parts' greatest stiffnesses [N/m]."""
        return sum(part.greatest_stiffness for part in self.parts)

    @property
    def law(self) -> Law:
        """The sum of the parts' laws."""
        law = self.parts[-1].law
        for part in self.parts[-2::-1]:
            law = _sum(part.law, law)
        return law

    def law_arguments(self) -> tuple[Any, ...]:
        """Size of the first part's memory, its arguments, and those of the rest."""
        arguments = self.parts[-1].law_arguments()
        for part in self.parts[-2::-1]:
            arguments = (part.state_size, part.law_arguments(), arguments)
        return arguments

    @staticmethod
    def advance(z, dy, dt, z_next):  # type: ignore[no-untyped-def]
        """Not used: `law` puts the parts' laws together."""
        raise NotImplementedError


@cache
def _sum(first: Law, rest: Law) -> Law:
    def advance(z, dy, dt, z_next, size, first_arguments, rest_arguments):  # type: ignore[no-untyped-def]
        force = first(z[:size], dy, dt, z_next[:size], *first_arguments)
        return force + rest(z[size:], dy, dt, z_next[size:], *rest_arguments)

    return advance
