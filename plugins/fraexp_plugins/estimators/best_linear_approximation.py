"""The best linear approximation of a machine from several realisations of a multisine: the robust method."""

import numpy as np

from fraexp.api import Signals
from fraexp_plugins.estimators._shared.realisations import (
    Group,
    Part,
    ReferencedEstimator,
    circular_covariance,
    mean,
    sum_of_squares,
)


class BestLinearApproximation(ReferencedEstimator, name="best_linear_approximation", version=2):
    """Ĝ = Ȳ/Ū from M random-phase realisations of P periods, with the scatter of both (robust method).

    The spectra are referred to the phase of the excitation, averaged over periods and realisations, and divided last.
    With e = (Y - ĜU)/Ū of each period, the scatter of e over the periods is noise, σ_n² = Σ|e - ē_m|²/(M² P(P-1)), and
    that over the realisations is the total, σ² = Σ|ē_m|²/(M(M-1)), ν = 2(M-1). The difference M max(σ² - σ_n², 0) is
    the variance of one realisation by stochastic nonlinear distortions. R. Pintelon and J. Schoukens, System
    Identification: A Frequency Domain Approach, 2nd ed. 2012, ch. 4, doi:10.1002/9781118287422.

    One realisation identifies the noise only. In closed loop noise and feedback cause no bias, because only the part
    that the excitation causes is averaged. Friction does: the estimate is the best linear approximation of plant
    **and** friction at this amplitude, and the confidence band covers that, not P. Do not use it as a plant model
    unless friction is negligible, or `effective_input` removes it from the input; nor on a record with a transient.
    """

    def part(self, signals: Signals, group: Group) -> Part:
        """Return Ȳ/Ū of a group of realisations."""
        u, y = self.relative_phasors(signals, group)
        realisations, periods = u.shape[:2]
        u_mean, y_mean = mean(mean(u, 1)), mean(mean(y, 1))
        response = y_mean / u_mean
        error = (y - response * u) / u_mean
        mean_errors = mean(error, 1)
        noise = nonlinear = None
        total = np.full(response.size, np.nan)
        if periods > 1:
            squares = sum_of_squares(error - mean_errors[:, None], (0, 1))
            total = noise = squares / (realisations**2 * periods * (periods - 1))
        if realisations > 1:
            total = sum_of_squares(mean_errors) / (realisations * (realisations - 1))
            nonlinear = None if noise is None else realisations * np.maximum(total - noise, 0.0)
        return Part(
            group,
            group[0].frequency,
            response,
            circular_covariance(total),
            2.0 * ((realisations if realisations > 1 else periods) - 1),
            np.abs(u_mean),
            np.abs(y_mean),
            noise_variance=noise,
            nonlinear_variance=nonlinear,
        )
