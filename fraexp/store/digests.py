"""Digests of stored rows: each is stored beside what it covers, and compared whenever that is read.

A digest is a CRC-32, which notices up to three changed bits in any row for certain and more of them with a probability
of 1 - 2⁻³². It protects from disks and memory, not from people. The columns that a digest covers are named here.

Not covered are a run's heartbeat and progress, which are only shown while it runs, the leases, and the names that a
filter suggests. States are words of which none becomes another one by a few bits.
"""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from datetime import UTC, datetime
from operator import itemgetter
from typing import Any
from zlib import crc32

from fraexp.store.tables import RowValues, TableRow

RESULT_COLUMNS: dict[str, tuple[str, ...]] = {
    "frequency_response": (
        *("unit", "input", "output", "points", "frequency", "response", "covariance", "input_amplitude"),
        *("output_amplitude", "settled", "settling_time", "residual", "harmonics", "freedom", "noise_variance"),
        *("nonlinear_variance", "coherence", "model_covariance", "numerical_error"),
    ),
    "metric": ("position", "name", "value", "unit"),
    "curve": ("position", "name"),
    "curve_column": ("curve", "position", "name", "unit", "samples"),
    "fit": ("position", "kind", "component", "parameters", "units", "values", "covariance"),
}
"""Columns of a result's tables that its digest covers, beside the key."""
STATE_COLUMNS = ("key", "outcome", "message", "numerics", "elapsed")
"""Columns of a sweep that the digest of its result covers."""
LISTED_COLUMNS = (
    *("key", "outcome", "message", "elapsed", "created", "source"),
    *("plant_name", "friction_name", "controller_name", "excitation_name", "estimator_name"),
)
"""Columns of a sweep that listings show, which have a digest of their own: listings do not read results."""
RUN_COLUMNS = (
    *("number", "study", "study_file", "command", "started", "ended", "host", "boot", "pid", "process_start"),
    *("provenance", "sweeps", "deleted"),
)
RUN_SWEEP_COLUMNS = ("run", "position", "key", "labels", "message", "log_digest")
ORIGIN_COLUMNS = ("kind", "name", "version", "source_hash", "distribution")
SEPARATOR = "\x1f"
_compact = json.JSONEncoder(separators=(",", ":")).encode
_listed_values = itemgetter(*LISTED_COLUMNS)
_run_values = itemgetter(*RUN_COLUMNS)
_run_sweep_values = itemgetter(*RUN_SWEEP_COLUMNS)
_origin_values = itemgetter(*ORIGIN_COLUMNS)
_result_values = {table: itemgetter(*columns) for table, columns in RESULT_COLUMNS.items()}


def _number_text(value: float) -> str:
    return repr(value + 0.0)  # a database may store -0 as 0


def _moment_text(value: datetime) -> str:
    return value.astimezone(UTC).isoformat()


TEXTS: Mapping[type, Callable[[Any], str]] = {
    str: str,
    float: _number_text,
    datetime: _moment_text,
    dict: _compact,
    list: _compact,
}


def digest(values: Iterable[Any]) -> int:
    """Return the digest of values as a database returns them: texts, numbers, moments, plain data, bytes and None."""
    texts, blobs = [], []
    for value in values:
        if value.__class__ is bytes:
            blobs.append(value)
        else:
            texts.append(TEXTS.get(value.__class__, str)(value))
    # As free text is stored: with escapes for what no database accepts.
    text = SEPARATOR.join(texts).encode("utf-8", "backslashreplace").replace(b"\0", b"\\x00")
    return crc32(b"".join(blobs), crc32(text))


def listed_digest(row: TableRow) -> int:
    """Return the digest of what listings show of a sweep."""
    return digest(_listed_values(row))


def content_digest(state: Iterable[Any], tables: Mapping[str, Iterable[Sequence[Any]]]) -> int:
    """Return the digest of a result.

    `state` has the values of STATE_COLUMNS; `tables` has the values of RESULT_COLUMNS of each row, in the order of
    their positions, by the name of the table.
    """
    values = list(state)
    for name in RESULT_COLUMNS:
        for row in tables.get(name, ()):
            values += row
    return digest(values)


def result_digest(state: TableRow, tables: Mapping[str, Sequence[TableRow]]) -> int:
    """Return the digest of a result by its sweep's row and the rows of its tables."""
    values = {name: [_result_values[name](row) for row in tables.get(name, ())] for name in RESULT_COLUMNS}
    return content_digest((state[name] for name in STATE_COLUMNS), values)


def origins_digest(key: str, rows: Iterable[TableRow]) -> int:
    """Return the digest of the origins of a sweep's components, in whatever order."""
    found = sorted((_origin_values(row) for row in rows), key=itemgetter(0, 1))
    return digest([key, *(value for row in found for value in row)])


def parts_digest(key: str, digests: Iterable[str | None]) -> int:
    """Return the digest of a sweep's parts by their own digests in the order of PARTS, None for a part without."""
    return digest([key, *digests])


def annotations_digest(key: str, tags: Iterable[str], note: str) -> int | None:
    """Return the digest of a sweep's tags and note; None without any."""
    tags = sorted(tags)
    return digest([key, note, *tags]) if tags or note else None


def run_digest(row: TableRow) -> int:
    """Return the digest of a run."""
    return digest(_run_values(row))


def run_sweep_digest(row: TableRow) -> int:
    """Return the digest of a sweep's part in a run."""
    return digest(_run_sweep_values(row))


def log_digest(text: str) -> int:
    """Return the digest of a log; 0 for none."""
    return digest([text]) if text else 0


def new_run_sweep(row: RowValues) -> RowValues:
    """Return the row of a sweep in a run with its digests."""
    row = {"message": "", "log": "", **row}
    row["log_digest"] = log_digest(row["log"])
    return row | {"digest": run_sweep_digest(row)}
