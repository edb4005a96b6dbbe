"""A force with an offset and a ripple, from rest."""

import numpy as np

from fraexp.api import Excitation, Period, Schedule, param
from fraexp_plugins.excitations._shared.sampling import check_recorded, samples_per_period


class BiasedSine(Excitation, name="biased_sine", version=1):
    """u = B + A sin(2πft) from rest, recorded from the start.

    Below the static friction a machine stays where it is; models without an elastic range creep (P. Dupont et al.,
    IEEE Trans. Automatic Control 47(5), 2002, doi:10.1109/TAC.2002.1000274, section II).
    """

    bias: float = param("N", "offset B")
    amplitude: float = param("N", "amplitude A of the ripple", above=0)
    frequency: float = param("Hz", "frequency f of the ripple", above=0)
    recorded_periods: int = param("1", "periods recorded", 50, at_least=2, at_most=100_000)

    def check(self, sample_time: float) -> None:
        """Refuse a frequency with too few samples per period, and more samples than fit into memory."""
        recorded = self.recorded_periods * samples_per_period(self.name, self.frequency, sample_time)
        check_recorded(self.name, recorded, "lower 'recorded_periods', or raise 'frequency'")

    def periods(self, sample_time: float) -> tuple[Period, ...]:
        """Return one period, of the whole number of samples that is nearest to 1/(f Ts)."""
        samples = samples_per_period(self.name, self.frequency, sample_time)
        ripple = self.amplitude * np.sin(2 * np.pi * np.arange(samples) / samples)
        return (Period(self.bias + ripple, np.array([1])),)

    @property
    def schedule(self) -> Schedule:
        """Record from rest: the transient is the subject."""
        return Schedule(settling_timeout=0.0, recorded_periods=self.recorded_periods)
