"""Base class of the excitations that settle until periodic before they are recorded."""

from abc import ABC

from fraexp.api import Excitation, Schedule, param

MAX_SETTLING_TOLERANCE = 0.1
"""Greatest tolerance: the error of a response is about half of it, that of the proposed method up to three times it."""


class SettledExcitation(Excitation, ABC):
    """Whole periods, recorded once successive ones agree."""

    ramp: float = param("s", "time over which the amplitude rises", 0.1, at_least=0, at_most=1000)
    settling_tolerance: float = param(
        "1",
        "relative difference of successive periods that counts as settled",
        1e-5,
        above=0,
        at_most=MAX_SETTLING_TOLERANCE,
    )
    settling_timeout: float = param("s", "time after which settling is given up", 30.0, above=0, at_most=10_000)
    recorded_periods: int = param("1", "minimum number of whole periods recorded", 1, at_least=1, at_most=100_000)

    @property
    def schedule(self) -> Schedule:
        """Settle until periodic."""
        return Schedule(self.ramp, self.settling_tolerance, self.settling_timeout, self.recorded_periods)
