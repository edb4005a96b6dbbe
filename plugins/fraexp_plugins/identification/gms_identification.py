"""Generalized Maxwell slip friction from a record."""

from collections.abc import Mapping

import numpy as np

from fraexp.api import FrictionModel, param
from fraexp_plugins.friction.gms import GeneralizedMaxwellSlip
from fraexp_plugins.identification.friction_report import ReportedElements
from fraexp_plugins.identification.law_identification import LawIdentification

EXCESS = 0.2
"""Static over Coulomb friction less one, to start from."""
RELAXATION = 10.0
"""Attraction to start from: C = 10 Fc vs/Y."""


class GmsIdentification(LawIdentification, name="gms_identification", version=2):
    """k_i, α_i, Fc, Fs, vs and C of the generalized Maxwell slip model, with σ2 and offset, by least squares.

    F. Al-Bender, V. Lampaert and J. Swevers, IEEE Trans. Automatic Control 50(11), 2005,
    doi:10.1109/TAC.2005.858676. It starts from the elements of `rolling_identification`. The Stribeck curve and C need
    sliding at speeds from well below to well above vs, and several reversals; the message names what the record does
    not tell. Not to be used where a rolling model meets the force already: Fs, vs and C then mean nothing.
    """

    elements: int = param("1", "number of elements", 4, at_least=1, at_most=20)

    def begin(self, found: ReportedElements, speed: float) -> np.ndarray:
        """Return logarithms of k_i, F_mi, Fs/Fc - 1, vs and C."""
        force = float(found.limit_force.sum())
        deflection = force / float(found.stiffness.sum())
        rest = [EXCESS, speed, RELAXATION * force * speed / deflection]
        return np.log(np.concatenate([found.stiffness, found.limit_force, rest]))

    def natural(self, law: np.ndarray) -> Mapping[str, tuple[float, str]]:
        """Return the parameters as the model names them; the shares are F_mi/Fc."""
        numbers = np.exp(law)
        count = (law.size - 3) // 2
        stiffness, force = numbers[:count], numbers[count : 2 * count]
        excess, speed, attraction = numbers[2 * count :]
        coulomb = float(force.sum())
        named = {f"stiffness.{k}": (float(stiffness[k]), "N/m") for k in range(count)}
        named |= {f"shares.{k}": (float(force[k] / coulomb), "1") for k in range(count)}
        named["coulomb"] = (coulomb, "N")
        named["breakaway"] = (float(coulomb * (1 + excess)), "N")
        named["stribeck_velocity"] = (float(speed), "m/s")
        named["attraction"] = (float(attraction), "N/s")
        return named

    def model(self, law: np.ndarray, viscous: float) -> FrictionModel:
        """Return the model; its breakaway force is not below its Coulomb force."""
        named = {name: value for name, (value, _) in self.natural(law).items()}
        count = (law.size - 3) // 2
        return GeneralizedMaxwellSlip(
            stiffness=tuple(named[f"stiffness.{k}"] for k in range(count)),
            shares=tuple(named[f"shares.{k}"] for k in range(count)),
            coulomb=named["coulomb"],
            breakaway=max(named["breakaway"], named["coulomb"]),
            stribeck_velocity=named["stribeck_velocity"],
            attraction=named["attraction"],
            viscous_coefficient=viscous,
        )
