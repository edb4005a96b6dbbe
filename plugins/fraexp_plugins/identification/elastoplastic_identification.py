"""Elastoplastic friction from a record."""

from collections.abc import Mapping

import numpy as np

from fraexp.api import FrictionModel, param
from fraexp_plugins.friction.elastoplastic import Elastoplastic
from fraexp_plugins.identification.friction_report import ReportedElements
from fraexp_plugins.identification.law_identification import LawIdentification

EXCESS, ELASTIC, DAMPED = 0.2, 0.5, 0.01
"""To start from: static over Coulomb friction less one; z_ba over Fc/σ0; the part of σ0 times a sliding time in σ1."""


class ElastoplasticIdentification(LawIdentification, name="elastoplastic_identification", version=2):
    """σ0, Fc, Fs, vs and z_ba of the elastoplastic model, with σ2, offset and, if wanted, σ1, by least squares.

    P. Dupont, V. Hayward, B. Armstrong and F. Altpeter, IEEE Trans. Automatic Control 47(5), 2002,
    doi:10.1109/TAC.2002.1000274. It starts from the slope and the force of all elements of `rolling_identification`.
    Sliding at speeds from well below to well above vs is needed; the message names what the record does not tell. Not
    to be used for guides with a long presliding region: one bristle has no memory of reversals within reversals.
    """

    elements: int = param("1", "number of elements to start from; chosen by held-out cycles if 0", 0, at_least=0)
    damped: bool = param("", "whether the bristle's damping σ1 is identified", False)

    def begin(self, found: ReportedElements, speed: float) -> np.ndarray:
        """Return logarithms of σ0, Fc, Fs/Fc - 1, vs, of the odds of z_ba σ0/Fc, and of σ1."""
        stiffness, force = float(found.stiffness.sum()), float(found.limit_force.sum())
        odds = ELASTIC / (1 - ELASTIC)
        damping = [DAMPED * force / speed] if self.damped else []
        return np.log(np.array([stiffness, force, EXCESS, speed, odds, *damping]))

    def natural(self, law: np.ndarray) -> Mapping[str, tuple[float, str]]:
        """Return the parameters as the model names them."""
        stiffness, force, excess, speed, odds, *damping = np.exp(law).tolist()
        named = {
            "sigma0": (stiffness, "N/m"),
            "coulomb": (force, "N"),
            "breakaway": (force * (1 + excess), "N"),
            "stribeck_velocity": (speed, "m/s"),
            "elastic_share": (odds / (1 + odds), "1"),
        }
        return named | ({"sigma1": (damping[0], "N s/m")} if damping else {})

    def model(self, law: np.ndarray, viscous: float) -> FrictionModel:
        """Return the model."""
        named = {name: value for name, (value, _) in self.natural(law).items()}
        named["elastic_share"] = min(named["elastic_share"], 1 - 1e-9)
        return Elastoplastic(**named, sigma2=viscous)
