"""Speeds of this machine: how long each kind of work takes here, relative to the reference core.

They are learned from every run and kept in a small file of the user's cache folder, one for each machine. Whatever
happens to that file costs no more than what was learned: a damaged one is as good as none.
"""

import json
import math
import os
import platform
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

from fraexp.kernels.cache_folder import cache_folder

FORMAT = 1
"""Version of the file."""
LEAST_WEIGHT = 0.25
"""Least weight of a run's measurements against all earlier ones: what changes on a machine is learned in a few runs."""
SMALLEST_RATIO, GREATEST_RATIO = 1e-3, 1e3
"""Ratios beyond these come from a stopped clock or a suspended machine, not from a processor."""
SETTLING, PARALLEL, COMPILE = "settling", "parallel", "compile"
"""Families of ratios: of samples until a loop is settled, of work over workers, of compiling. None of them tells how
fast the processor is at other work, and the first two do not depend on it."""

SIZE = "@"
"""Stands between a kind of work and the order of magnitude of its amount, which is learned besides."""


class Learned(NamedTuple):
    """A ratio of measured to reference time."""

    log: float
    """Its natural logarithm."""
    runs: int
    """Runs from which it was learned."""


@dataclass(frozen=True)
class Speeds:
    """What is known about this machine."""

    ratios: Mapping[str, Learned] = field(default_factory=dict)
    """By kind of work, such as ``loop/rolling/lanes`` or ``estimate/proposed``."""
    kernels: frozenset[str] = frozenset()
    """Kernels that have been compiled on this machine, named like the work that they do."""

    def ratio(self, kind: str) -> float:
        """Return measured over reference time of a kind of work.

        Of an amount that has not been measured yet it is that of other amounts, of a kind that has not been it is the
        median of those that have: the processor is the same.
        """
        if kind in self.ratios:
            return math.exp(self.ratios[kind].log)
        if SIZE in kind:
            return self.ratio(kind.partition(SIZE)[0])
        if _family(kind) in (SETTLING, PARALLEL):
            return 1.0
        known = [learned.log for other, learned in self.ratios.items() if _is_telling(other)]
        return math.exp(median(known)) if known else 1.0

    def learned(self, measured: Mapping[str, Sequence[float]], kernels: Iterable[str] = ()) -> "Speeds":
        """Return the speeds with a run's ratios taken in, of which each kind of work counts as one: their median."""
        found = dict(self.ratios)
        for kind, ratios in measured.items():
            usable = [ratio for ratio in ratios if SMALLEST_RATIO < ratio < GREATEST_RATIO]
            if usable:
                found[kind] = _moved(found.get(kind), math.log(median(usable)))
        return Speeds(found, self.kernels | frozenset(kernels))


def _family(kind: str) -> str:
    return kind.partition("/")[0]


def _is_telling(kind: str) -> bool:
    """Say whether a ratio tells how fast the processor is; those of amounts are in the one of their kind."""
    return _family(kind) not in (SETTLING, PARALLEL, COMPILE) and SIZE not in kind


def _moved(before: Learned | None, log: float) -> Learned:
    """Return a ratio after one more run: the mean over the first runs, then an exponential average."""
    if before is None:
        return Learned(log, 1)
    weight = max(1 / (before.runs + 1), LEAST_WEIGHT)
    return Learned(before.log + weight * (log - before.log), before.runs + 1)


def speeds_file() -> Path:
    """Return where this machine's speeds are kept: a home folder may be shared by several machines."""
    return cache_folder() / f"speeds-{platform.node() or 'machine'}.json"


def read_speeds() -> Speeds:
    """Return what is known about this machine; nothing if the file is missing or damaged."""
    try:
        return _parsed(json.loads(speeds_file().read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return Speeds()


def learn_speeds(measured: Mapping[str, Sequence[float]], kernels: Iterable[str] = ()) -> None:
    """Add a run's measured ratios to the file; where it cannot be written nothing is learned.

    Of two runs that end at the same moment one may be lost: the next one is learned from again.
    """
    speeds = read_speeds().learned(measured, kernels)
    with suppress(OSError):
        _write(speeds_file(), json.dumps(_plain(speeds), indent=1, sort_keys=True))


def _parsed(data: Any) -> Speeds:
    if data["format"] != FORMAT:
        return Speeds()
    ratios = {str(kind): Learned(float(log), int(runs)) for kind, (log, runs) in data["ratios"].items()}
    sound = {kind: learned for kind, learned in ratios.items() if math.isfinite(learned.log) and learned.runs > 0}
    limit = math.log(GREATEST_RATIO)
    return Speeds(
        {kind: learned for kind, learned in sound.items() if abs(learned.log) <= limit},
        frozenset(str(kernel) for kernel in data["kernels"]),
    )


def _plain(speeds: Speeds) -> dict[str, Any]:
    ratios = {kind: [round(learned.log, 4), learned.runs] for kind, learned in speeds.ratios.items()}
    return {"format": FORMAT, "ratios": ratios, "kernels": sorted(speeds.kernels)}


def _write(file: Path, text: str) -> None:
    """Write a file in one step, so that other processes read either the old text or the new one."""
    file.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=file.parent, prefix=f".{file.name}-")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as stream:
            stream.write(text)
        Path(name).replace(file)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
