"""Load of the machine by other programs, which makes a run slower."""

import os
from math import sqrt
from pathlib import Path

LOAD_FILE = Path("/proc/loadavg")
"""File in which Linux reports how many programs want a core: on average over a minute, and now.

psutil reports the average only.
"""
MAX_SLOWDOWN = 4.0


def slowdown(processes: int) -> float:
    """Return how much longer so many processes take than on an idle machine; 1 if that is unknown.

    Other programs count if they ran during the last minute and still do: a run that has just ended is no load. The
    share of each program is unknown, because a system may divide by user or by session: anything between an even share
    and all that a program wants is possible. The geometric mean of both limits is nearest to either.
    """
    try:
        average, _, _, now, _ = LOAD_FILE.read_text(encoding="ascii").split()
        others = min(float(average), float(now.partition("/")[0]) - 1)
    except (OSError, ValueError):
        return 1.0
    even_share = (others + processes) / (os.cpu_count() or 1)
    return min(sqrt(max(even_share, 1.0)), MAX_SLOWDOWN)
