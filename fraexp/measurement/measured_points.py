"""What was measured: points with their place in the file of samples, and the files in which it is kept."""

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fraexp.components.machine_session import Chunk
from fraexp.data.atomic_file import process_lock
from fraexp.data.identity import digest_of
from fraexp.data.sample_file import SampleHeader, SampleWriter, create_sample_file, read_header
from fraexp.errors import RecordError, StudyError
from fraexp.measurement.tasks import MeasurementTask

PLAY_COLUMN = "play"
"""Column with the number of the play in which a sample was recorded, from 1."""

SETTINGS_AFTER_FAULTS = ("adapt_amplitude", "attempts")
"""Settings that say how to go on after a fault: points that are measured need not be measured again."""
LOST = "lost"
"""Name under which the log has points whose samples never reached the disk."""


@dataclass(frozen=True)
class MeasuredPoint:
    """A point whose record is in the file of samples."""

    number: int
    """Its place in the excitation, from 0."""
    frequency: str
    amplitude: float
    """Factor on the amplitude that the study gives."""
    rest: int
    """Row of its first sample after rest."""
    start: int
    """Row of the first sample of its record."""
    periods: int
    samples: int
    """Samples per period."""
    harmonics: tuple[int, ...]
    settled: bool
    residual: float | None
    """Relative difference of the last windows compared; None if none was."""
    machine_time: float
    """Time for which the machine was excited, plays in vain included [s]."""
    repeats: tuple[str, ...] = ()
    """What was repeated, and why."""
    band: float | None = None
    """Half-width of the 95 % band by the scatter of the periods [dB]; None if there are too few."""
    used: float = 0.0
    """Greatest part of a limit that its last play reached."""
    expected: Mapping[str, float] = field(default_factory=dict)
    """Amplitude of channels at the excited lines, if it was predicted [N or m]."""
    excitation: tuple[tuple[float, float], ...] = ()
    """Amplitude [N] and phase [deg] of what was played at each line, from `start` on."""

    def as_segment(self) -> dict[str, Any]:
        """Return what the section [record] of a study says of it."""
        known = {"rest": self.rest, "settled": self.settled, "residual": self.residual}
        counts = {"start": self.start, "periods": self.periods, "samples": self.samples}
        played = {"expected": dict(self.expected), "excitation": [list(each) for each in self.excitation]}
        return {
            **counts,
            "harmonics": list(self.harmonics),
            **{k: v for k, v in known.items() if v is not None},
            **{k: v for k, v in played.items() if v},
        }


class MeasurementFiles:
    """The samples of a measurement, and a log of its points, in a folder; what is there already is continued."""

    def __init__(self, folder: Path, name: str) -> None:
        self.folder = folder
        self.samples = folder / f"{name}.samples"
        self.log = folder / f"{name}.log"

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keep other processes from measuring into the same files; BusyError if one does."""
        with process_lock(self.samples.with_suffix(".lock"), f"{self.samples}", "into this file"):
            yield

    @contextmanager
    def open_samples(self, task: MeasurementTask, header: SampleHeader, fresh: bool = False) -> Iterator[SampleWriter]:
        """Open the samples for more of them; StudyError if they are of another measurement, unless it is a fresh one.

        A measurement is another one if the machine, the excitation or the settings differ. A fresh one discards what is
        there with its first samples: if the machine gives none, nothing is lost.
        """
        self._settle_aside()
        if fresh:
            for file in self._both:
                if file.exists():
                    file.replace(_aside_path(file))
        try:
            with closing(self._writer(task, header)) as writer:
                yield writer
        finally:
            self._settle_aside()

    def _settle_aside(self) -> None:
        """Discard what was set aside for a fresh measurement that has samples, else put it back."""
        kept = _aside_path(self.samples)
        if not kept.exists():
            return
        has_samples = self.samples.exists() and self.samples.stat().st_size > read_header(self.samples)[1]
        for file in reversed(self._both):  # the samples last: while they are aside, this is not finished
            if has_samples:
                _aside_path(file).unlink(missing_ok=True)
            elif _aside_path(file).exists():
                _aside_path(file).replace(file)

    def _writer(self, task: MeasurementTask, header: SampleHeader) -> SampleWriter:
        if not self.samples.exists():
            self.folder.mkdir(parents=True, exist_ok=True)
            self.log.write_text(json.dumps({"identity": measurement_identity(task)}) + "\n", encoding="utf-8")
            create_sample_file(self.samples, header)
        elif not self.are_of(task) or read_header(self.samples)[0] != header:
            raise StudyError(
                f"{self.samples}: a measurement of another machine, excitation or setting is in this file; move it "
                "away, or measure anew with --fresh"
            )
        else:
            self._cut_log()
        return SampleWriter(self.samples)

    def _cut_log(self) -> None:
        """Remove a last line that was cut off: the next one would be part of it."""
        text = self.log.read_bytes()
        os.truncate(self.log, text.rfind(b"\n") + 1)

    @property
    def _both(self) -> tuple[Path, Path]:
        """Samples and log."""
        return self.samples, self.log

    def identity(self) -> str:
        """Return what tells the measurement from others; empty if there is no log."""
        return str(next(self._lines(), {}).get("identity", ""))

    def are_of(self, task: MeasurementTask) -> bool:
        """Return whether a task has been measured into these files, and no other one."""
        return self.identity() == measurement_identity(task)

    def add(self, point: MeasuredPoint) -> None:
        """Note a point whose samples are in the file."""
        with self.log.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps({"point": asdict(point)}) + "\n")

    def note(self, name: str, values: Mapping[str, Any]) -> None:
        """Note what was found by the way, under a name."""
        with self.log.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps({name: dict(values)}) + "\n")

    def noted(self, name: str) -> dict[str, Any] | None:
        """Return what was noted under a name; None if nothing was."""
        found = [line[name] for line in self._lines() if name in line]
        return dict(found[-1]) if found else None

    def points(self) -> list[MeasuredPoint]:
        """Return the points that were measured, in the order of the excitation; of a repeated one the last."""
        found = dict[int, MeasuredPoint]()
        for line in self._lines():
            for number in line.get(LOST, ()):
                found.pop(number, None)
            if "point" in line:
                fields = {**line["point"]}
                for name in ("harmonics", "repeats"):
                    fields[name] = tuple(fields[name])
                fields["excitation"] = tuple(map(tuple, fields.get("excitation", ())))
                point = MeasuredPoint(**fields)
                found[point.number] = point
        return [found[number] for number in sorted(found)]

    def drop_lost(self, rows: int) -> list[MeasuredPoint]:
        """Forget the points whose samples are not among so many rows, as after a power failure; return them."""
        lost = [point for point in self.points() if point.start + point.periods * point.samples > rows]
        if lost:
            with self.log.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps({LOST: [point.number for point in lost]}) + "\n")
        return lost

    def _lines(self) -> Iterator[dict[str, Any]]:
        """Yield the whole lines of the log: the last one may have been cut off."""
        if not self.log.exists():
            return
        for text in self.log.read_text(encoding="utf-8").splitlines():
            try:
                yield json.loads(text)
            except ValueError:
                return
            except RecursionError:
                raise RecordError(f"{self.log}: it is no log of a measurement") from None


def store_chunk(writer: SampleWriter, play: int, chunk: Chunk) -> NDArray[np.float64]:
    """Append what was recorded in a play, and return it without the number of the play, shape (channels, n)."""
    rows = np.array([chunk.channels[name] for name in writer.header.units if name != PLAY_COLUMN])
    writer.append(np.vstack([np.full(chunk.size, float(play)), rows]).T)
    return rows


def _aside_path(file: Path) -> Path:
    """Return where a file is until a fresh measurement has samples."""
    return file.with_name(f"{file.name}.before")


def kept_points(files: MeasurementFiles, task: MeasurementTask) -> list[MeasuredPoint]:
    """Return the points with which a measurement goes on; none if those that are stored are of another one."""
    return files.points() if files.identity() == measurement_identity(task) else []


def measurement_identity(task: MeasurementTask) -> str:
    """Return what tells a measurement from others."""
    settings = task.settings.plain() if task.settings else {}
    settings = {key: value for key, value in settings.items() if key not in SETTINGS_AFTER_FAULTS}
    return f"{task.key} {digest_of(settings).hex()}"
