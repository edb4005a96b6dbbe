"""What excitations have in common that are settled until periodic and then recorded."""

from abc import ABC

from fraexp.api import Excitation, Schedule, param


class SettledExcitation(Excitation, ABC):
    """Whole periods, recorded once successive ones agree."""

    ramp: float = param("s", "time over which the amplitude rises", 0.1, at_least=0, at_most=1000)
    tolerance: float = param("1", "relative difference of successive periods that counts as settled", 1e-5, above=0)
    settle_limit: float = param("s", "time after which settling is given up", 30.0, above=0, at_most=10_000)
    whole_periods: int = param("1", "whole periods recorded at least", 1, at_least=1, at_most=100_000)

    @property
    def schedule(self) -> Schedule:
        """Settle until periodic."""
        return Schedule(self.ramp, self.tolerance, self.settle_limit, self.whole_periods)
