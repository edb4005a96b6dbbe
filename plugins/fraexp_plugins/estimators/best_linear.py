"""The best linear approximation of a machine from several realisations of a multisine: the robust method."""

import numpy as np

from fraexp.api import Signals
from fraexp_plugins.estimators.realisations import Group, Part, ReferencedEstimator, circular, mean, power


class BestLinear(ReferencedEstimator, name="best_linear_approximation", version=1):
    """Ĝ = Ȳ/Ū from M random-phase realisations of P periods, with the scatter of both (robust method).

    Spectra are turned back by the phase of the injected signal, averaged over periods and realisations, and divided
    last. With e = (Y - ĜU)/Ū of each period, its scatter over the periods is noise, σ_n² = Σ|e - ē_m|²/(M² P(P-1)),
    that over the realisations all there is, σ² = Σ|ē_m|²/(M(M-1)), ν = 2(M-1). What is left,
    M max(σ² - σ_n², 0), is the variance of one realisation by stochastic nonlinear distortions. R. Pintelon and
    J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed. 2012, ch. 4, doi:10.1002/9781118287422.

    One realisation teaches the noise alone. In closed loop noise and feedback do no harm, since only what the
    injected signal causes is averaged; friction does: what is found is the best linear approximation of plant **and**
    friction at this amplitude, and the band holds that, not P. Not to be used as a plant model unless friction is
    negligible, or taken out of the input by the proposed method; nor on a record with a transient.
    """

    def part(self, signals: Signals, group: Group) -> Part:
        """Return Ȳ/Ū of a group of realisations."""
        u, y = self.rotated(signals, group)
        realisations, periods = u.shape[:2]
        u_mean, y_mean = mean(mean(u, 1)), mean(mean(y, 1))
        response = y_mean / u_mean
        error = (y - response * u) / u_mean
        of_realisation = mean(error, 1)
        noise = nonlinear = None
        total = np.full(response.size, np.nan)
        if periods > 1:
            within = power(error - of_realisation[:, None], (0, 1))
            total = noise = within / (realisations**2 * periods * (periods - 1))
        if realisations > 1:
            total = power(of_realisation) / (realisations * (realisations - 1))
            nonlinear = None if noise is None else realisations * np.maximum(total - noise, 0.0)
        return Part(
            group,
            group[0].frequency,
            response,
            circular(total),
            2.0 * ((realisations if realisations > 1 else periods) - 1),
            np.abs(u_mean),
            np.abs(y_mean),
            noise_variance=noise,
            nonlinear_variance=nonlinear,
        )
