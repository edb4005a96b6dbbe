"""Elastoplastic friction from a record."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrictionModel, param
from fraexp_plugins.friction.elastoplastic import Elastoplastic
from fraexp_plugins.identification.friction._shared.friction_report import ReportedElements
from fraexp_plugins.identification.friction._shared.law_identification import LawIdentification

START_STATIC_EXCESS, START_ELASTIC_LIMIT, START_DAMPING = 0.2, 0.5, 0.01
"""Start values of static over Coulomb friction less one, of z_ba over Fc/σ0, and of σ1 over Fc/vs."""


class ElastoplasticIdentification(LawIdentification, name="elastoplastic_identification", version=3):
    """σ0, Fc, Fs, vs and z_ba of the elastoplastic model, with σ2, offset and optionally σ1, by least squares.

    P. Dupont, V. Hayward, B. Armstrong and F. Altpeter, IEEE Trans. Automatic Control 47(5), 2002,
    doi:10.1109/TAC.2002.1000274. It starts from the slope and the force of all elements of `rolling_identification`.
    It needs sliding at speeds from well below to well above vs; the message names parameters that are not identifiable.
    Do not use it for guides with a long presliding region: one bristle has no memory of reversals within reversals.
    """

    elements: int = param("1", "number of elements to start from; chosen by held-out cycles if 0", 0, at_least=0)

    fit_damping: bool = param("", "whether the bristle's damping σ1 is identified", False)

    def start_parameters(self, found: ReportedElements, speed: float) -> NDArray[np.float64]:
        """Return the logarithms of σ0, Fc, Fs/Fc - 1, vs, of the odds of z_ba σ0/Fc, and of σ1."""
        stiffness, force = float(found.stiffness.sum()), float(found.limit_force.sum())
        odds = START_ELASTIC_LIMIT / (1 - START_ELASTIC_LIMIT)
        damping = [START_DAMPING * force / speed] if self.fit_damping else []
        return np.log(np.array([stiffness, force, START_STATIC_EXCESS, speed, odds, *damping]))

    def named_values(self, law: NDArray[np.float64]) -> Mapping[str, tuple[float, str]]:
        """Return the parameters as the model names them."""
        stiffness, force, excess, speed, odds, *damping = np.exp(law).tolist()
        named = {
            "bristle_stiffness": (stiffness, "N/m"),
            "coulomb_force": (force, "N"),
            "static_force": (force * (1 + excess), "N"),
            "stribeck_velocity": (speed, "m/s"),
            "elastic_limit_ratio": (odds / (1 + odds), "1"),
        }
        return named | ({"bristle_damping": (damping[0], "N s/m")} if damping else {})

    def model(self, law: NDArray[np.float64], viscous: float) -> FrictionModel:
        """Return the model."""
        named = {name: value for name, (value, _) in self.named_values(law).items()}
        named["elastic_limit_ratio"] = min(named["elastic_limit_ratio"], 1 - 1e-9)
        return Elastoplastic(**named, viscous_coefficient=viscous)
