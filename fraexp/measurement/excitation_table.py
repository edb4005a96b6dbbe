"""The whole of an excitation in one table: each point from rest to rest, with pauses, and where its record lies."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fraexp.components.machine_session import PlayRequest
from fraexp.errors import StudyError
from fraexp.measurement.measurement_plan import MeasurementPlan, PlannedPoint

PAUSE_S = 0.5
"""Time at rest after each point."""
MAX_TABLE_SAMPLES = 50_000_000
"""Most samples of a table: more is no file that a machine plays."""


@dataclass(frozen=True)
class TableEntry:
    """A point of a table."""

    point: PlannedPoint
    request: PlayRequest
    first: int
    """Row of its first sample."""

    @property
    def segment(self) -> dict[str, Any]:
        """What the section [record] says of it: the last periods before the ramp out."""
        size, record = self.point.period.waveform.size, self.point.counts.record
        start = self.request.full_samples - record
        return {
            "start": self.first + start,
            "periods": record // size,
            "samples": size,
            "harmonics": [int(line) for line in self.point.period.lines],
            "rest": self.first,
            "expected": self.point.expected_amplitudes,
            "excitation": [list(each) for each in self.point.excitation_at(start)],
        }


@dataclass(frozen=True)
class ExcitationTable:
    """The samples of an excitation, and its points in the order in which they are played."""

    sample_time: float
    """Sample time [s]."""
    unit: str
    entries: tuple[TableEntry, ...]
    pause: int
    """Samples at rest after each point."""

    @property
    def samples(self) -> int:
        """Number of samples."""
        last = self.entries[-1]
        return last.first + last.request.samples + self.pause

    def columns(self) -> dict[str, NDArray[np.float64]]:
        """Return time [s], excitation and point (from 1; 0 in pauses), each of shape (n,)."""
        excitation, point = np.zeros(self.samples), np.zeros(self.samples)
        for place, entry in enumerate(self.entries, start=1):
            rows = slice(entry.first, entry.first + entry.request.samples)
            excitation[rows], point[rows] = entry.request.excitation(0, entry.request.samples), place
        return {
            "time": self.sample_time * np.arange(self.samples, dtype=np.float64),
            "excitation": excitation,
            "point": point,
        }

    def segments(self) -> list[dict[str, Any]]:
        """Return where the record of each point lies, in the order of the study."""
        return [entry.segment for entry in sorted(self.entries, key=lambda entry: entry.point.number)]


def excitation_table(plan: MeasurementPlan) -> ExcitationTable:
    """Return the table of a plan; StudyError if it is too long."""
    sample_time = plan.points[0].sample_time
    pause = max(round(PAUSE_S / sample_time), 1)
    entries = list(_entries(plan.points, pause))
    table = ExcitationTable(
        sample_time, "N m" if plan.task.experiment["loop"].get("rotary") else "N", tuple(entries), pause
    )
    if table.samples > MAX_TABLE_SAMPLES:
        raise StudyError(
            f"the excitation has {table.samples:,} samples; expected {MAX_TABLE_SAMPLES:,} at most: take fewer points, "
            "or shorter records"
        )
    return table


def _entries(points: Sequence[PlannedPoint], pause: int) -> list[TableEntry]:
    entries, first = [], 0
    for point in points:
        request = point.expected_request(point.counts.record)
        entries.append(TableEntry(point, request, first))
        first += request.samples + pause
    return entries
