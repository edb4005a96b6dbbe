"""Expected time and measured rate of a run, in words."""

from collections import deque

from fraexp.views.words import duration_text

SPEED_WINDOW_S = 30.0
"""Time over which the rate is measured [s]: longer than a sweep, shorter than changes of the rate."""
MIN_SPEED_TIME_S = 1.0
"""Minimum time after which a measured rate is shown [s]."""


MIN_COMPILE_TIME_S = 1.0
"""Minimum compiling time that is shown [s]."""


def expected_time_text(seconds: float | None, compiling: float) -> str:
    """Return the end of a plan's line: the expected time, and how much of it is compiling; may be empty."""
    if not seconds:
        return ""
    part = f" including {duration_text(compiling)} for compiling" if compiling >= MIN_COMPILE_TIME_S else ""
    return f", about {duration_text(seconds)}{part}"


class Speed:
    """The speed of the work, measured over the last seconds."""

    def __init__(self, window: float = SPEED_WINDOW_S) -> None:
        self._window = window
        self._seen: deque[tuple[float, float]] = deque()

    def update(self, now: float, done: float) -> None:
        """Note how much is done at a time [s]; the time before anything is done does not count."""
        if self._seen and (done <= 0 or done < self._seen[-1][1]):
            self._seen.clear()
        while len(self._seen) > 1 and now - self._seen[1][0] >= self._window:
            self._seen.popleft()
        self._seen.append((now, done))

    @property
    def rate(self) -> float | None:
        """Sweeps per second; None while unknown."""
        (start, before), (end, after) = self._seen[0], self._seen[-1]
        return (after - before) / (end - start) if end - start >= MIN_SPEED_TIME_S and after > before else None


def rate_text(rate: float) -> str:
    """Return a rate [1/s] per second, minute or hour, whichever gives a number above one."""
    factor, unit = next((pair for pair in ((1, "s"), (60, "min")) if rate * pair[0] >= 1), (3600, "h"))
    shown = rate * factor
    return f"{shown:.0f}/{unit}" if shown >= 10 else f"{shown:.1f}/{unit}"
