"""What a sweep may take at most: time and memory."""

import re
import sys
from dataclasses import dataclass
from math import inf

from fraexp.errors import StudyError

LONGEST = 3600.0
"""Seconds that a sweep may take unless told otherwise: no experiment of the built-in kinds comes near."""
LEAST_MEMORY = 400 * 10**6
"""Bytes: a worker that has loaded the compiler takes half of it before its first job."""
PREFIXES = {
    None: 1,
    "k": 10**3,
    "M": 10**6,
    "G": 10**9,
    "T": 10**12,
    "Ki": 2**10,
    "Mi": 2**20,
    "Gi": 2**30,
    "Ti": 2**40,
}
SECONDS = {"": 1.0, "s": 1.0, "min": 60.0, "h": 3600.0}


@dataclass(frozen=True)
class ResourceLimits:
    """What a sweep may take at most."""

    time: float = LONGEST
    """Seconds for the experiment with its first estimator, and for each further one; infinite for no limit."""
    memory: int | None = None
    """Bytes that a worker may have; None for no limit."""

    def overdue(self) -> str:
        """Return why a sweep was ended that took too long."""
        return f"it took longer than the time limit of {self.time:g} s; see --time-limit"

    @classmethod
    def parse(cls, time: str | None, memory: str | None) -> "ResourceLimits":
        """Return the limits written as ``90``, ``5min`` or ``none`` and as ``2GB``; StudyError for other texts."""
        return cls(LONGEST if time is None else _seconds(time), None if memory is None else _bytes(memory))

    def options(self) -> list[str]:
        """Return the options of a command line that set these limits."""
        time = [] if self.time == LONGEST else [f"--time-limit={'none' if self.time == inf else self.time}"]
        return time + ([] if self.memory is None else [f"--memory={self.memory}"])

    def check(self, executor: str | None) -> None:
        """Raise StudyError for an executor that cannot keep to these limits."""
        if self.memory is not None and executor is not None and executor.startswith("dask:"):
            raise StudyError("the memory of Dask workers is capped where they are started: dask worker --memory-limit")
        if self.memory is not None and executor == "serial":
            raise StudyError("executor 'serial' cannot cap memory, as it computes in this process; take processes:1")


def _seconds(text: str) -> float:
    if text == "none":
        return inf
    match = re.fullmatch(r"(\d+\.?\d*|\.\d+)\s*([a-z]*)", text.strip())
    if match is None or match[2] not in SECONDS or float(match[1]) <= 0:
        raise StudyError(f"time limit '{text}': expected a time above 0 such as 60, 90s, 5min or 2h, or none")
    return float(match[1]) * SECONDS[match[2]]


def _bytes(text: str) -> int:
    match = re.fullmatch(r"(\d+\.?\d*|\.\d+)\s*([kMGT]i?)?B?", text.strip())
    if match is None:
        raise StudyError(f"memory cap '{text}': expected such as 2GB, 1.5GiB or 800MB")
    size = round(float(match[1]) * PREFIXES[match[2]])
    if size < LEAST_MEMORY:
        raise StudyError(f"memory cap '{text}': a worker alone needs {size_text(LEAST_MEMORY)}; give it more")
    if not sys.platform.startswith("linux"):
        raise StudyError("a memory cap needs Linux; leave out --memory")
    return size


def size_text(size: int) -> str:
    """Return a number of bytes for people."""
    power, prefix = (10**9, "GB") if size >= 10**9 else (10**6, "MB")
    return f"{size / power:.3g} {prefix}"


def cap_memory(size: int | None) -> None:
    """Let this process have no more than that; what asks for more gets a MemoryError."""
    if size is not None:
        import resource  # there is none on Windows

        resource.setrlimit(resource.RLIMIT_DATA, (size, size))
