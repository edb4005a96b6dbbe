"""Points of a measurement whose band is wider than the one that is asked for."""

import math

from fraexp.measurement.measured_points import MeasuredPoint
from fraexp.measurement.measurement import MeasurementBegun
from fraexp.views.words import plural


def misses_band(point: MeasuredPoint, band: float | None) -> bool:
    """Return whether a point has not reached a band [dB], or nothing is known of its own."""
    return band is not None and not (point.band is not None and point.band <= band)


class MissedBands:
    """Counts points and those that miss their band, as they come."""

    def __init__(self) -> None:
        self._band: float | None = None
        self._count = 0
        self._missed: list[MeasuredPoint] = []

    def begin(self, event: MeasurementBegun) -> None:
        """Take note of the band of an experiment, and of the points that are kept."""
        settings = event.plan.task.settings
        self._band = settings.band if settings else None
        for point in event.kept:
            self.add(point)

    def add(self, point: MeasuredPoint) -> None:
        """Take note of a point that was measured."""
        self._count += 1
        if misses_band(point, self._band):
            self._missed.append(point)

    @property
    def text(self) -> str:
        """How many points miss the band, and what to do about it; empty if none does."""
        if not self._missed:
            return ""
        known = [(point.band, point.frequency) for point in self._missed if point.band is not None]
        widest = "the widest is ±{:.2g} dB at {}".format(*max(known)) if known else "it is not known of any"
        found = f"{len(self._missed)} of {plural(self._count, 'point')} did not reach the band of ±{self._band:g} dB"
        if hidden := sum(math.isinf(band) for band, _ in known):
            return (
                f"{found}; at {hidden} noise hides the motion: see that the brake is released and the drive enabled "
                "before you raise the amplitude or measurement.max_record_time"
            )
        return f"{found}; {widest}: raise measurement.max_record_time, or the amplitude"
