"""Generalized Maxwell slip friction from a record."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrictionModel, param
from fraexp_plugins.friction.gms import GeneralizedMaxwellSlip
from fraexp_plugins.identification.friction._shared.friction_report import ReportedElements
from fraexp_plugins.identification.friction._shared.law_identification import LawIdentification

START_STATIC_EXCESS = 0.2
"""Start value of static over Coulomb friction less one."""
START_ATTRACTION = 10.0
"""Start value of the attraction rate over Fc vs/Y."""


class GmsIdentification(LawIdentification, name="gms_identification", version=3):
    """k_i, α_i, Fc, Fs, vs and C of the generalized Maxwell slip model, with σ2 and offset, by least squares.

    F. Al-Bender, V. Lampaert and J. Swevers, IEEE Trans. Automatic Control 50(11), 2005,
    doi:10.1109/TAC.2005.858676. It starts from the elements of `rolling_identification`. The Stribeck curve and C need
    sliding at speeds from well below to well above vs, and several reversals; the message names parameters that are not
    identifiable. Do not use it if a rolling model already explains the force: Fs, vs and C then have no meaning.
    """

    elements: int = param("1", "number of elements", 4, at_least=1, at_most=20)

    def start_parameters(self, found: ReportedElements, speed: float) -> NDArray[np.float64]:
        """Return the logarithms of k_i, F_mi, Fs/Fc - 1, vs and C."""
        force = float(found.limit_force.sum())
        deflection = force / float(found.stiffness.sum())
        rest = [START_STATIC_EXCESS, speed, START_ATTRACTION * force * speed / deflection]
        return np.log(np.concatenate([found.stiffness, found.limit_force, rest]))

    def named_values(self, law: NDArray[np.float64]) -> Mapping[str, tuple[float, str]]:
        """Return the parameters as the model names them; the force fractions are F_mi/Fc."""
        numbers = np.exp(law)
        count = (law.size - 3) // 2
        stiffness, force = numbers[:count], numbers[count : 2 * count]
        excess, speed, rate = numbers[2 * count :]
        coulomb = float(force.sum())
        named = {f"stiffness.{k}": (float(stiffness[k]), "N/m") for k in range(count)}
        named |= {f"force_fractions.{k}": (float(force[k] / coulomb), "1") for k in range(count)}
        named["coulomb_force"] = (coulomb, "N")
        named["static_force"] = (float(coulomb * (1 + excess)), "N")
        named["stribeck_velocity"] = (float(speed), "m/s")
        named["attraction_rate"] = (float(rate), "N/s")
        return named

    def model(self, law: NDArray[np.float64], viscous: float) -> FrictionModel:
        """Return the model; its static force is not below its Coulomb force."""
        named = {name: value for name, (value, _) in self.named_values(law).items()}
        count = (law.size - 3) // 2
        return GeneralizedMaxwellSlip(
            stiffness=tuple(named[f"stiffness.{k}"] for k in range(count)),
            force_fractions=tuple(named[f"force_fractions.{k}"] for k in range(count)),
            coulomb_force=named["coulomb_force"],
            static_force=max(named["static_force"], named["coulomb_force"]),
            stribeck_velocity=named["stribeck_velocity"],
            attraction_rate=named["attraction_rate"],
            viscous_coefficient=viscous,
        )
