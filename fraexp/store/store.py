"""The store: the one door to the database."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from sqlalchemy import Connection, Engine

from fraexp.errors import StoreError
from fraexp.results import Result
from fraexp.store import reading, writing
from fraexp.store.engine import WRITE, Database, locate
from fraexp.store.records import RunSummary, StoredState, StoredSweep, Supplied
from fraexp.store.schema import Schema, check_readable, prepare
from fraexp.sweep import Sweep

TIMEOUT = 10.0
"""How long to wait for another process that writes [s]."""


class Store:
    """Runs, sweeps and results in a database file. Every call is one transaction: it happens wholly or not at all.

    Whatever the database cannot do is raised as StoreError, in one line with the remedy.
    """

    def __init__(self, database: Database, engine: Engine) -> None:
        self._database = database
        self._engine = engine
        self._writer = engine.execution_options(**{WRITE: True})

    @classmethod
    def open(cls, url: str, *, create: bool = False, read_only: bool = False, timeout: float = TIMEOUT) -> Self:
        """Open the database at ``sqlite:///results.db`` or a plain path; a context manager.

        Parameters
        ----------
        create : make it if it is missing or empty.
        read_only : for watchers, which cannot disturb a run; the database must be there.
        timeout : how long to wait for another process that writes [s].
        """
        database = Database(locate(url), timeout)
        if read_only:
            check_readable(database, Schema())
            return cls(database, database.reader())
        prepare(database, create, Schema())
        return cls(database, database.writer())

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections."""
        self._engine.dispose()

    @property
    def path(self) -> Path:
        """The database file."""
        return self._database.path

    def known(self, keys: Iterable[str]) -> dict[str, StoredState]:
        """Return the state of those sweeps that have a result."""
        with self._reading() as connection:
            return reading.known(connection, keys)

    def begin_run(
        self, study: str, study_file: str, command: str, provenance: Mapping[str, Any], sweeps: Sequence[Sweep]
    ) -> int:
        """Write a run of this process and its sweeps, all pending; return its number."""
        with self._writing() as connection:
            return writing.begin_run(connection, study, study_file, command, provenance, sweeps)

    def beat(self, run: int) -> None:
        """Note that the run is still being worked on; watchers on other hosts cannot see the process."""
        with self._writing() as connection:
            writing.beat(connection, run)

    def reuse(self, run: int, keys: Iterable[str]) -> None:
        """Mark sweeps of the run as answered by stored results."""
        with self._writing() as connection:
            writing.mark(connection, run, keys, "reused")

    def save(self, run: int, results: Sequence[tuple[Sweep, Result, Mapping[str, Supplied]]]) -> None:
        """Store results, with the origin of each component by ``kind:name``, in place of older ones."""
        with self._writing() as connection:
            writing.save(connection, run, results)

    def fail(self, run: int, key: str, message: str, log: str) -> None:
        """Note a failed attempt with its log; no result is stored, and an older one stays."""
        with self._writing() as connection:
            writing.fail(connection, run, key, message, log)

    def end_run(self, run: int, state: str) -> None:
        """Note how a run ended: ``complete``, ``partial`` or ``interrupted``."""
        with self._writing() as connection:
            writing.end_run(connection, run, state)

    def runs(self) -> list[RunSummary]:
        """Return all runs, newest first; one whose process died shows as ``interrupted``."""
        with self._reading() as connection:
            return reading.runs(connection)

    def run(self, number: int) -> RunSummary:
        """Return the run of a number."""
        with self._reading() as connection:
            return reading.one_run(connection, number)

    def sweeps(self, run: int) -> list[StoredSweep]:
        """Return the sweeps of a run in grid order, without arrays."""
        with self._reading() as connection:
            return reading.sweeps(connection, run)

    def find(self, prefix: str) -> StoredSweep:
        """Return the sweep whose key starts with a prefix, with or without ``fx1-``, as its latest run saw it."""
        with self._reading() as connection:
            return reading.find(connection, prefix)

    def log(self, key: str) -> str:
        """Return the log of a sweep's latest attempt; empty if it did not fail."""
        with self._reading() as connection:
            return reading.log(connection, key)

    def result(self, key: str) -> Result:
        """Return the result of a sweep, with arrays."""
        found = self.results([key])
        if key not in found:
            raise StoreError(f"{self.path}: there is no result of sweep {key}; run its study")
        return found[key]

    def results(self, keys: Iterable[str]) -> dict[str, Result]:
        """Return the results of those sweeps that have one, with arrays."""
        with self._reading() as connection:
            return reading.results(connection, keys)

    def health(self) -> str:
        """Return ``sound``, or the first finding of the database's own check of its structure."""
        with self._reading() as connection:
            return reading.health(connection)

    @contextmanager
    def _reading(self) -> Iterator[Connection]:
        with self._database.sentences(), self._engine.connect() as connection:
            yield connection

    @contextmanager
    def _writing(self) -> Iterator[Connection]:
        with self._database.sentences(), self._writer.begin() as connection:
            yield connection
