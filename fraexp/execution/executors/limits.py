"""Limits of a sweep: time and memory."""

import re
import sys
from dataclasses import dataclass
from math import inf

from fraexp.errors import StudyError

DEFAULT_TIME_LIMIT_S = 3600.0
"""Default time limit of a sweep: all experiments of the built-in kinds take much less."""
DEFAULT_DATABASE_TIMEOUT_S = 3600.0
"""Default time for which a run waits for a database that is unavailable: it outlasts restarts and short failures."""
MIN_WORKER_MEMORY = 400 * 10**6
"""Least memory limit [bytes]: a worker that has loaded the compiler takes half of it before its first job."""
BYTE_PREFIXES = " kMGT"
"""Prefixes of bytes, each a thousand times the one before; with i 1024 times."""
SECONDS_PER_UNIT = {"": 1.0, "s": 1.0, "min": 60.0, "h": 3600.0}


@dataclass(frozen=True)
class ResourceLimits:
    """Limits of a sweep, and of the time for which its run waits for the database."""

    time: float = DEFAULT_TIME_LIMIT_S
    """Time for the experiment with its first estimator, and for each further estimator [s]; infinite for no limit."""
    memory: int | None = None
    """Memory of a worker [bytes]; None for no limit."""
    database: float = DEFAULT_DATABASE_TIMEOUT_S
    """Time for which a run waits for a database that is unavailable [s]; infinite for no limit."""

    def overdue_message(self) -> str:
        """Return why a sweep was stopped that exceeded the time limit."""
        return f"it took longer than the time limit of {self.time:g} s; see --time-limit"

    @classmethod
    def parse(cls, time: str | None, memory: str | None, database: str | None = None) -> "ResourceLimits":
        """Return the limits in texts: times such as ``90``, ``5min`` or ``none``, and a memory such as ``2GB``."""
        return cls(
            DEFAULT_TIME_LIMIT_S if time is None else parse_duration(time, "time limit"),
            None if memory is None else _parse_memory(memory),
            DEFAULT_DATABASE_TIMEOUT_S if database is None else parse_duration(database, "database timeout"),
        )

    def options(self) -> list[str]:
        """Return the command-line options that set these limits."""
        times = (
            ("--time-limit", self.time, DEFAULT_TIME_LIMIT_S),
            ("--database-timeout", self.database, DEFAULT_DATABASE_TIMEOUT_S),
        )
        options = [f"{name}={'none' if value == inf else value}" for name, value, default in times if value != default]
        return options + ([] if self.memory is None else [f"--memory-limit={self.memory}"])

    def check(self, executor: str | None) -> None:
        """Raise StudyError if an executor cannot enforce these limits."""
        if self.memory is not None and executor is not None and executor.startswith("dask:"):
            raise StudyError("the memory of Dask workers is capped where they are started: dask worker --memory-limit")
        if self.memory is not None and executor == "serial":
            raise StudyError("executor 'serial' cannot cap memory, as it computes in this process; take processes:1")


def parse_duration(text: str, what: str) -> float:
    """Return a duration [s] such as ``90``, ``5min`` or ``none``, which is infinite; `what` names it in an error."""
    if text == "none":
        return inf
    match = re.fullmatch(r"(\d+\.?\d*|\.\d+)\s*([a-z]*)", text.strip())
    if match is None or match[2] not in SECONDS_PER_UNIT or float(match[1]) <= 0:
        raise StudyError(f"{what} '{text}': expected a time above 0 such as 60, 90s, 5min or 2h, or none")
    return float(match[1]) * SECONDS_PER_UNIT[match[2]]


def _parse_memory(text: str) -> int:
    match = re.fullmatch(r"(\d+\.?\d*|\.\d+)\s*([kMGT]?)(i?)B?", text.strip())
    if match is None:
        raise StudyError(f"memory cap '{text}': expected such as 2GB, 1.5GiB or 800MB")
    size = round(float(match[1]) * (1024 if match[3] else 1000) ** BYTE_PREFIXES.index(match[2] or " "))
    if size < MIN_WORKER_MEMORY:
        raise StudyError(f"memory cap '{text}': a worker alone needs {size_text(MIN_WORKER_MEMORY)}; give it more")
    if not sys.platform.startswith("linux"):
        raise StudyError("a memory cap needs Linux; leave out --memory-limit")
    return size


def size_text(size: int) -> str:
    """Return a number of bytes as text, such as ``2 GB``."""
    power, prefix = (10**9, "GB") if size >= 10**9 else (10**6, "MB")
    return f"{size / power:.3g} {prefix}"


def cap_memory(size: int | None) -> None:
    """Limit the memory of this process [bytes]; an allocation beyond it raises MemoryError."""
    if size is not None:
        import resource  # Windows has no such module

        resource.setrlimit(resource.RLIMIT_DATA, (size, size))
