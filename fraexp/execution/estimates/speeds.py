"""Speeds of this machine: how long each kind of work takes here, relative to the reference core.

They are learned from every run and stored in a small file in the user's cache folder, one for each machine. A damaged
file is ignored.
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

FORMAT_VERSION = 2
"""Version of the file, whose ratios are to the reference times of its day."""
MIN_WEIGHT = 0.25
"""Least weight of a run against all earlier ones: a change of the machine is learned within a few runs."""
MIN_RATIO, MAX_RATIO = 1e-3, 1e3
"""Ratios outside of this range come from a stopped clock or a suspended machine."""
SETTLING, PARALLEL, COMPILE = "settling", "parallel", "compile"
"""Families of ratios that do not show the processor's speed: samples until a loop is settled, division over workers,
and compiling. The first two do not depend on the processor."""

SIZE_MARK = "@"
"""Separates a kind of work from the order of magnitude of its amount, for which a ratio is learned, too."""


class LearnedRatio(NamedTuple):
    """A ratio of measured to reference time."""

    log: float
    """Its natural logarithm."""
    runs: int
    """Runs from which it was learned."""


@dataclass(frozen=True)
class Speeds:
    """The learned speeds of this machine."""

    ratios: Mapping[str, LearnedRatio] = field(default_factory=dict)
    """By kind of work, such as ``loop/rolling/lanes`` or ``estimate/effective_input``."""
    kernels: frozenset[str] = frozenset()
    """Kernels that have been compiled on this machine, named like their kind of work."""

    def ratio(self, kind: str) -> float:
        """Return measured over reference time of a kind of work.

        Without a measurement of this amount it is the ratio of other amounts, without one of this kind the median of
        the measured kinds, because the processor is the same.
        """
        if kind in self.ratios:
            return math.exp(self.ratios[kind].log)
        if SIZE_MARK in kind:
            return self.ratio(kind.partition(SIZE_MARK)[0])
        if _family(kind) in (SETTLING, PARALLEL):
            return 1.0
        known = [ratio.log for other, ratio in self.ratios.items() if _shows_processor_speed(other)]
        return math.exp(median(known)) if known else 1.0

    def updated(self, measured: Mapping[str, Sequence[float]], kernels: Iterable[str] = ()) -> "Speeds":
        """Return the speeds updated by a run: the median of the run's ratios for each kind of work."""
        found = dict(self.ratios)
        for kind, ratios in measured.items():
            usable = [ratio for ratio in ratios if MIN_RATIO < ratio < MAX_RATIO]
            if usable:
                found[kind] = _averaged(found.get(kind), math.log(median(usable)))
        return Speeds(found, self.kernels | frozenset(kernels))


def _family(kind: str) -> str:
    return kind.partition("/")[0]


def _shows_processor_speed(kind: str) -> bool:
    """Return whether a ratio shows the processor's speed; ratios of amounts are part of the ratio of their kind."""
    return _family(kind) not in (SETTLING, PARALLEL, COMPILE) and SIZE_MARK not in kind


def _averaged(before: LearnedRatio | None, log: float) -> LearnedRatio:
    """Return a ratio after one more run: the mean over the first runs, then an exponential average."""
    if before is None:
        return LearnedRatio(log, 1)
    weight = max(1 / (before.runs + 1), MIN_WEIGHT)
    return LearnedRatio(before.log + weight * (log - before.log), before.runs + 1)


def speeds_file() -> Path:
    """Return the path of this machine's speeds: several machines may share a home folder."""
    return cache_folder() / f"speeds-{platform.node() or 'machine'}.json"


def read_speeds() -> Speeds:
    """Return the speeds of this machine; no ratios if the file is missing or damaged."""
    try:
        return _parse_speeds(json.loads(speeds_file().read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return Speeds()


def save_ratios(measured: Mapping[str, Sequence[float]], kernels: Iterable[str] = ()) -> None:
    """Add a run's measured ratios to the file; nothing happens if it cannot be written.

    If two runs end at the same moment, the ratios of one may be lost.
    """
    speeds = read_speeds().updated(measured, kernels)
    with suppress(OSError):
        _write(speeds_file(), json.dumps(_plain(speeds), indent=1, sort_keys=True))


def _parse_speeds(data: Any) -> Speeds:
    if data["format"] != FORMAT_VERSION:
        return Speeds()
    ratios = {str(kind): LearnedRatio(float(log), int(runs)) for kind, (log, runs) in data["ratios"].items()}
    sound = {kind: ratio for kind, ratio in ratios.items() if math.isfinite(ratio.log) and ratio.runs > 0}
    limit = math.log(MAX_RATIO)
    return Speeds(
        {kind: ratio for kind, ratio in sound.items() if abs(ratio.log) <= limit},
        frozenset(str(kernel) for kernel in data["kernels"]),
    )


def _plain(speeds: Speeds) -> dict[str, Any]:
    ratios = {kind: [round(ratio.log, 4), ratio.runs] for kind, ratio in speeds.ratios.items()}
    return {"format": FORMAT_VERSION, "ratios": ratios, "kernels": sorted(speeds.kernels)}


def _write(file: Path, text: str) -> None:
    """Write a file atomically: other processes read either the old text or the new one."""
    file.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=file.parent, prefix=f".{file.name}-")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as stream:
            stream.write(text)
        Path(name).replace(file)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
