"""An excitation as a file: a table for instruments and programs, or source code that plays it in a controller."""

import wave
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.resources import files
from itertools import accumulate
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.components.machine_session import PlayRequest
from fraexp.data.atomic_file import atomic_file
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


NUMBERS_PER_LINE = 6


class PlayerLanguage(NamedTuple):
    """A language in which a controller plays the excitation, sample by sample and without memory of its own."""

    template: str
    """Name of the text of the player, with names in braces for what differs."""
    array: str
    """How an array of whole numbers is written, one for each point."""
    whole: str
    """How a whole number is written."""
    hint: str
    """What the user must know to play it."""


HEADER = PlayerLanguage(
    "excitation.h",
    "static const long fraexp_{name}[{points}] = {{{numbers}}};",
    "{}L",
    "call fraexp_next every {sample_time:g} s, and add what it returns [{unit}] to the control input",
)
STRUCTURED_TEXT = PlayerLanguage(
    "excitation.st",
    "    {upper} : ARRAY[0..{last_point}] OF DINT := [{numbers}];",
    "{}",
    "call FB_FraexpExcitation every {sample_time:g} s, and add Force [{unit}] to the control input",
)


def _write_player(language: PlayerLanguage, path: Path, table: ExcitationTable) -> str:
    requests = [entry.request for entry in table.entries]
    sizes = [request.waveform.size for request in requests]
    counts = {
        "first": [0, *accumulate(sizes)][:-1],
        "samples": sizes,
        "periods": [request.repetitions for request in requests],
        "ramp_out": [request.ramp_out for request in requests],
    }
    values: dict[str, Any] = {
        "points": len(requests),
        "last_point": len(requests) - 1,
        "samples": table.samples,
        "sample_time": table.sample_time,
        "unit": table.unit,
        "pause": table.pause,
        "size": sum(sizes),
        "last": sum(sizes) - 1,
        "wave": _lines(np.concatenate([request.waveform for request in requests]).tolist()),
        "rise": _lines([request.amplitude_rise for request in requests]),
    }
    arrays = []
    for name, numbers in counts.items():
        listed = ", ".join(map(language.whole.format, numbers))
        arrays.append(language.array.format(name=name, upper=name.upper(), numbers=listed, **values))
    template = files("fraexp.measurement").joinpath("templates", f"{language.template}.template")
    path.write_text(template.read_text("utf-8").format(counts="\n".join(arrays), **values), encoding="utf-8")
    return language.hint.format(**values)


def _lines(numbers: list[float]) -> str:
    """Return numbers, each with all of its digits, several a line."""
    texts = [repr(float(number)) for number in numbers]
    rows = [texts[k : k + NUMBERS_PER_LINE] for k in range(0, len(texts), NUMBERS_PER_LINE)]
    return ",\n".join("        " + ", ".join(row) for row in rows)


WAV_PEAK = 32767
"""Greatest number of a sample of 16 bits."""


def write_excitation(path: Path, table: ExcitationTable) -> str:
    """Write a file in the format of its suffix; return what the user must know to play it."""
    if path.suffix.lower() not in WRITERS:
        known = ", ".join(WRITERS)
        raise StudyError(f"{path}: an excitation cannot be written as '{path.suffix}'; expected one of {known}")
    with atomic_file(path) as draft:
        return WRITERS[path.suffix.lower()](draft, table)


def _write_csv(path: Path, table: ExcitationTable) -> str:
    columns = table.columns()
    with path.open("w", encoding="utf-8", newline="\n") as stream:
        stream.write(f"time [s],excitation [{table.unit}],point\n")
        cells = zip(*(values.tolist() for values in columns.values()), strict=True)
        stream.writelines(f"{time:.10g},{force!r},{point:.0f}\n" for time, force, point in cells)
    return f"excitation [{table.unit}] at {1 / table.sample_time:g} Hz"


def _write_mat(path: Path, table: ExcitationTable) -> str:
    from scipy.io import savemat

    content = {**table.columns(), "sample_time": table.sample_time, "unit": table.unit}
    with path.open("wb") as stream:
        savemat(stream, content, oned_as="column", do_compression=True)
    return f"variable 'excitation' [{table.unit}] at {1 / table.sample_time:g} Hz"


def _write_hdf5(path: Path, table: ExcitationTable) -> str:
    import h5py

    with h5py.File(path, "w") as file:
        units = {"time": "s", "excitation": table.unit, "point": "1"}
        for name, values in table.columns().items():
            data = file.create_dataset(name, data=values, compression="gzip", track_times=False)
            data.attrs["unit"] = units[name]
        file.attrs["sample_time"] = table.sample_time
    return f"dataset 'excitation' [{table.unit}] at {1 / table.sample_time:g} Hz"


def _write_wav(path: Path, table: ExcitationTable) -> str:
    rate = 1 / table.sample_time
    if abs(rate - round(rate)) > 1e-6 * rate:
        raise StudyError(f"a WAV file has a whole number of samples per second; 1/loop.sample_time is {rate:.6g} Hz")
    force = table.columns()["excitation"]
    peak = float(np.abs(force).max())
    numbers = np.rint(force / peak * WAV_PEAK).astype("<i2")
    with path.open("wb") as stream, wave.open(stream, "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(round(rate))
        file.writeframes(numbers.tobytes())
    return f"full scale is {peak:.6g} {table.unit}, a step {peak / WAV_PEAK:.3g} {table.unit}; {rate:g} Hz, 16 bit"


WRITERS: dict[str, Callable[[Path, ExcitationTable], str]] = {
    ".csv": _write_csv,
    ".mat": _write_mat,
    ".h5": _write_hdf5,
    ".hdf5": _write_hdf5,
    ".wav": _write_wav,
    ".h": partial(_write_player, HEADER),
    ".st": partial(_write_player, STRUCTURED_TEXT),
}
"""Writers by suffix; each returns what the user must know to play the file."""
