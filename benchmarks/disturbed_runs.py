"""What the tortures share: runs in processes, a run in peace, and what must hold in a database at the end."""

import sqlite3
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

QUESTIONS = (
    "SELECT key, outcome, findings, numerics FROM sweep ORDER BY key",
    *(
        f"SELECT * FROM {table} ORDER BY 1, 2, 3"
        for table in ("frequency_response", "metric", "curve", "curve_column", "fit")
    ),
)
"""All numbers of all results."""


def rows(database: Path, question: str) -> list[Any]:
    """Return the rows of a query."""
    with closing(sqlite3.connect(f"{database.as_uri()}?mode=ro", uri=True, timeout=20)) as connection:
        return connection.execute(question).fetchall()


def start_run(
    folder: Path, executor: str, database: Path, told: Any, environment: Mapping[str, str] | None = None
) -> "subprocess.Popen[bytes]":
    """Start a run of study ``torture`` in a process group of its own."""
    command = [sys.executable, "-m", "fraexp", "run", "torture", f"--executor={executor}", f"--db={database}"]
    return subprocess.Popen(
        command, cwd=folder, env=environment, stdin=subprocess.DEVNULL, stdout=told, stderr=told, start_new_session=True
    )


def run_in_peace(folder: Path, executor: str) -> Path:
    """Compute all without disturbances; return the database."""
    database = folder / "reference.db"
    with (folder / "reference.txt").open("wb") as told:
        code = start_run(folder, executor, database, told).wait()
    if code:
        raise SystemExit(f"the run in peace fails: {(folder / 'reference.txt').read_text()}")
    return database


def audit(database: Path, reference: Path, sweeps: int) -> Iterator[str]:
    """Yield what is wrong in a database: each sweep is computed once, with the bits of the run in peace."""
    count = rows(database, "SELECT count(*), count(outcome) FROM sweep")[0]
    if count != (sweeps, sweeps):
        yield f"{count[1]} results of {count[0]} sweeps; expected {sweeps}"
    times = Counter(key for (key,) in rows(database, "SELECT key FROM run_sweep WHERE state = 'computed'"))
    if len(times) != sweeps or set(times.values()) != {1}:
        yield f"{len(times)} sweeps are computed, {sum(number > 1 for number in times.values())} more than once"
    for pragma, sound in (("integrity_check", [("ok",)]), ("foreign_key_check", [])):
        if (found := rows(database, f"PRAGMA {pragma}")) != sound:
            yield f"{pragma}: {found[:3]}"
    if rows(database, "SELECT count(*) FROM lease") != [(0,)]:
        yield "leases are left"
    for question in QUESTIONS:
        if rows(database, question) != rows(reference, question):
            yield f"{question}: not as in the run in peace"
