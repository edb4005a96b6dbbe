"""The local polynomial method: a response from a record that includes its transient."""

from fraexp_plugins.estimators._shared.local_estimator import LocalEstimator
from fraexp_plugins.estimators._shared.local_models import LocalModel


class LocalPolynomial(LocalEstimator, name="local_polynomial", version=3):
    """Ĝ = Ŷ/Û, with a transient that is a polynomial in the distance r from a line (Pintelon et al., 2010 and 2011).

    Periodic variant, P periods, from rest or not: between two lines there are P - 1 bins with only transient and noise,
    Y(kP + r) = T(k) + Σ t_s r^s + V. The 2n nearest of them give the noise, and T at the line, which is subtracted from
    y and from u. Lines may lie at any distance, and a closed loop needs no excitation channel.

    Arbitrary variant, one record of any broadband signal: Y(k + r) = (G + Σ g_s r^s) R(k + r) + T + Σ t_s r^s + V over
    2n + 1 bins, for y and for u over the excitation R, and Ĝ is the ratio of both, with E|dG|² = [1 -G] C
    [1 -G]^H/|G_ur|² times the fit's leverage (R. Voorhoeve, A. van der Maas and T. Oomen, Mechanical Systems and
    Signal Processing 105, 2018, 129-152; E. Evers, R. Voorhoeve and T. Oomen, 2020, arXiv:2006.10373). Without a
    channel of R it is u itself: in a closed loop noise then biases Ĝ towards -1/C.

    The q complex degrees of freedom of the residuals give the covariance, ν = 2q. M realisations are averaged before
    dividing; their scatter then gives it, ν = 2(M - 1), nonlinear distortions included. With `integrators` = n the
    polynomials describe Δⁿy, Δ = 1 - z⁻¹, whose transient is smooth; the noise is that of y, white from bin to bin.
    R. Pintelon, J. Schoukens, G. Vandersteen and K. Barbé, Mechanical Systems and Signal Processing 24(3), 2010,
    573-595, doi:10.1016/j.ymssp.2009.08.009; R. Pintelon, K. Barbé, G. Vandersteen and J. Schoukens, 25(7), 2011,
    2683-2704.

    It removes transients and noise, not the bias by friction. The confidence band covers noise, not a resonance that is
    narrower than the bins around a line, |Δf| < n/T of a record of T seconds: use `local_rational` there, or record for
    longer.
    """

    def model(self, feedback: bool) -> LocalModel:
        """Return polynomials, with Δⁿ in a closed loop too: it makes the effect of the loop's slow poles smoother."""
        return LocalModel(self.order, 0, 0, self.integrators)
