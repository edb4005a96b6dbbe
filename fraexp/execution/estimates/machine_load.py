"""What other programs take of the machine: a run beside them takes longer than on an idle one."""

import os
from math import sqrt
from pathlib import Path

RUNNING = Path("/proc/loadavg")
"""Where Linux tells how many programs want a core: on average over a minute, and at this moment."""
GREATEST_SLOWDOWN = 4.0


def slowdown(processes: int) -> float:
    """Return how much longer so many processes take than on an idle machine; 1 where that cannot be told.

    Others count if they were there over the last minute and still are: a run that has just ended is no load. What a
    system gives to each of them is not known, for it may share by user or by session: anything from an even share to
    all that is wanted. The geometric mean of both is nearest to either.
    """
    try:
        average, _, _, now, _ = RUNNING.read_text(encoding="ascii").split()
        others = min(float(average), float(now.partition("/")[0]) - 1)
    except (OSError, ValueError):
        return 1.0
    even_share = (others + processes) / (os.cpu_count() or 1)
    return min(sqrt(max(even_share, 1.0)), GREATEST_SLOWDOWN)
