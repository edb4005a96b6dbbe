"""How long work will take, and how fast it goes: an estimate in words, sweeps per second over the last seconds."""

from collections import deque

from fraexp.views.words import duration

WINDOW = 30.0
"""Time over which the speed is measured [s]: long against a sweep, short against a change of speed."""
SURE = 1.0
"""Time after which a measured speed is told [s]."""


LEAST_COMPILING = 1.0
"""Time of compiling that is told [s]."""


def expected_time(seconds: float | None, compiling: float) -> str:
    """Return the end of a plan's line: how long it will take, and how long of that is compiling; may be empty."""
    if not seconds:
        return ""
    part = f", of which {duration(compiling)} compiling" if compiling >= LEAST_COMPILING else ""
    return f", about {duration(seconds)}{part}"


class Speed:
    """The speed of the work, measured over the last seconds."""

    def __init__(self, window: float = WINDOW) -> None:
        self._window = window
        self._seen: deque[tuple[float, float]] = deque()

    def see(self, now: float, done: float) -> None:
        """Take note of how much is done at a time [s]; what passes before anything is done does not count."""
        if self._seen and (done <= 0 or done < self._seen[-1][1]):
            self._seen.clear()
        while len(self._seen) > 1 and now - self._seen[1][0] >= self._window:
            self._seen.popleft()
        self._seen.append((now, done))

    @property
    def rate(self) -> float | None:
        """Sweeps per second; None while it is not known."""
        (start, before), (end, after) = self._seen[0], self._seen[-1]
        return (after - before) / (end - start) if end - start >= SURE and after > before else None


def rate_text(rate: float) -> str:
    """Return a rate [1/s] per second, minute or hour, so that it is a number above one."""
    factor, unit = next((pair for pair in ((1, "s"), (60, "min")) if rate * pair[0] >= 1), (3600, "h"))
    shown = rate * factor
    return f"{shown:.0f}/{unit}" if shown >= 10 else f"{shown:.1f}/{unit}"
