"""The local rational method: as the local polynomial one, for lightly damped resonances."""

from fraexp.api import param
from fraexp_plugins.estimators._shared.local_estimator import LocalEstimator
from fraexp_plugins.estimators._shared.local_models import LocalModel


class LocalRational(LocalEstimator, name="local_rational", version=3):
    """Ĝ = Ŷ/Û, with polynomials over a common denominator D(r) = 1 + Σ d_s r^s around each line (McKelvey, 2012).

    D Y = (G + Σ g_s r^s) R + T + Σ t_s r^s, with the same D for u, is linear in all unknowns; each iteration weights it
    with the last 1/D. A resonance that is narrower than the bins around a line has a pole there, which no polynomial
    follows. If D does not explain more than chance (F-test), the line keeps its polynomials. The covariance includes
    the uncertainty of D to first order. All else is as in `local_polynomial`.
    T. McKelvey and G. Guérin, Non-parametric frequency response estimation using a local rational model, 16th IFAC
    Symposium on System Identification, Brussels 2012; R. Voorhoeve, A. van der Maas and T. Oomen, Mechanical Systems
    and Signal Processing 105, 2018, 129-152.

    It removes transients and noise, not the bias by friction. Use `local_polynomial` instead if it is good enough, as
    it is simpler. In an arbitrary record with a thousandth of noise or less the confidence band at resonances covers
    about 90 % instead of 95 %; below n bins from 0 Hz it is too wide in a closed loop.
    """

    order: int = param("1", "order R of the polynomials", 2, at_least=0, at_most=10)
    denominator_order: int = param("1", "order of the denominator", 2, at_least=1, at_most=6)
    iterations: int = param("1", "Sanathanan-Koerner iterations after the first solution", 2, at_least=0, at_most=50)

    def model(self, feedback: bool) -> LocalModel:
        """Return polynomials over a denominator, which describes the slow poles of a closed loop too."""
        return LocalModel(self.order, self.denominator_order, self.iterations, 0 if feedback else self.integrators)
