"""The store: the one door to the database."""

from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import TracebackType
from typing import Any, Self

from sqlalchemy import Connection, Engine

from fraexp.data.results import Result
from fraexp.data.sweep import Sweep
from fraexp.errors import StoreError
from fraexp.store import integrity
from fraexp.store.backends.engine import ALONE, BESIDE, WRITE, Database
from fraexp.store.backends.urls import locate
from fraexp.store.changes import leases, merging, writing
from fraexp.store.queries import annotations, reading, sweep_pages
from fraexp.store.queries.filter_sql import Declared, undeclared
from fraexp.store.schema import Schema, check_readable, migrate, prepare
from fraexp.store.stored_records import (
    ListingPage,
    Merged,
    Migrated,
    RunProgress,
    RunSummary,
    StoredState,
    StoredSweep,
    Supplied,
)
from fraexp.store.validation import FOREIGN, DamagedError, foreign

TIMEOUT = 10.0
"""How long to wait for another process that writes [s]."""


class Store:
    """Runs, sweeps and results in a database. Every call is one transaction: it happens wholly or not at all.

    Whatever the database cannot do is raised as StoreError, in one line with the remedy.
    """

    def __init__(self, database: Database, engine: Engine, units: Declared = undeclared) -> None:
        self._database, self._declared = database, units
        self._engine = engine
        self._reader = engine.execution_options(**database.reading)
        self._identity = database.identity()
        self._written = 0

    @classmethod
    def open(
        cls,
        url: str,
        *,
        create: bool = False,
        read_only: bool = False,
        timeout: float = TIMEOUT,
        units: Declared = undeclared,
    ) -> Self:
        """Open the database at ``postgresql://user@host/database``, ``sqlite:///results.db`` or a plain path.

        It is a context manager.

        Parameters
        ----------
        create : make its tables (and the file) if it is missing or empty.
        read_only : for watchers, which cannot disturb a run; the database must be there.
        timeout : how long to wait for another process that writes [s].
        units : returns the units in which a parameter may be declared, so that filters can refuse others.
        """
        database = locate(url, timeout)
        if read_only:
            check_readable(database, Schema())
            return cls(database, database.reader(), units)
        prepare(database, create, Schema())
        return cls(database, database.writer(), units)

    @staticmethod
    def exists(url: str, timeout: float = TIMEOUT) -> bool:
        """Return whether there is a database, of whatever schema; StoreError if there is something else."""
        return locate(url, timeout).exists()

    @staticmethod
    def refusal(url: str, timeout: float = TIMEOUT) -> str:
        """Return why nothing can be written there, as far as that is plain beforehand; empty if it may be."""
        try:
            locate(url, timeout).check_writable()
        except StoreError as error:
            return str(error)
        return ""

    @staticmethod
    def migrate(url: str, timeout: float = TIMEOUT) -> Migrated:
        """Bring a database up to date, and give back unused room."""
        database, schema = locate(url, timeout), Schema()
        before = migrate(database, schema)
        size = database.size()
        database.tidy()
        return Migrated(before, schema.head, size, database.size())

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
    def name(self) -> str:
        """The database as people know it: a file, or a URL without its password."""
        return self._database.name

    @property
    def advice(self) -> str:
        """What people should know of its place before they write to it; empty if all is well."""
        return self._database.advice()

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

    def beat(self, run: int, progress: RunProgress | None = None) -> None:
        """Note that the run is still being worked on, and how far it came.

        Watchers on other hosts cannot see the process, and none can ask it for its progress.
        """
        with self._writing(BESIDE) as connection:  # another run may be storing much: that must not seem our death
            writing.beat(connection, run, progress)

    def claim(self, run: int, keys: Iterable[str], again: bool = False) -> set[str]:
        """Take sweeps upon a run, all at once, and return those that it is to compute: no other living run holds them.

        What has a result is left out; `again`: only what has got one since the run began. `beat` keeps what is held,
        and `save`, `fail` and `end_run` give it up. A run that is over, whose process here has died, or that has been
        silent for a minute holds nothing.
        """
        with self._writing() as connection:
            return leases.claim(connection, run, keys, again)

    def held(self, keys: Iterable[str]) -> dict[str, int]:
        """Return the living run that holds each of those sweeps that one holds."""
        with self._reading() as connection:
            return leases.held(connection, keys)

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

    def page(
        self,
        filter: str = "",  # noqa: A002 (the word that users know)
        order: str = "",
        offset: int = 0,
        limit: int = 100,
        run: int | None = None,
    ) -> ListingPage:
        """Return a part of the listing of all sweeps, or of a run's, without arrays.

        Parameters
        ----------
        filter : terms such as ``estimator=proposed excitation.amplitude>=12 -tag:baseline``, which must all hold.
        order : one of `fields`, with ``-`` before it for falling values: by default ``-created``, or a run's own
            order (``position``). What lacks the value comes last.
        offset, limit : how many rows are left out before the first, and how many are returned.
        """
        with self._reading() as connection:
            if run is not None:
                reading.one_run(connection, run)
            return sweep_pages.page(connection, filter, order, offset, limit, run, self._declared)

    def keys(self, filter: str = "", run: int | None = None) -> list[str]:  # noqa: A002 (the same)
        """Return the keys of all sweeps that a filter lets through, in the default order of `page`."""
        with self._reading() as connection:
            if run is not None:
                reading.one_run(connection, run)
            return sweep_pages.keys(connection, filter, run, self._declared)

    def fields(self) -> list[str]:
        """Return the names that a filter may use: columns, then parameters, labels and metrics."""
        with self._reading() as connection:
            return sweep_pages.fields(connection)

    def tag(self, keys: Iterable[str], name: str) -> None:
        """Give sweeps a tag: a word."""
        with self._writing() as connection:
            annotations.add_tag(connection, keys, name)

    def untag(self, keys: Iterable[str], name: str) -> None:
        """Take a tag from sweeps."""
        with self._writing() as connection:
            annotations.remove_tag(connection, keys, name)

    def tags(self) -> dict[str, int]:
        """Return how many sweeps have each tag, by name."""
        with self._reading() as connection:
            return annotations.tags(connection)

    def annotate(self, key: str, text: str) -> None:
        """Give a sweep a note in place of an older one; an empty text takes it away."""
        with self._writing() as connection:
            annotations.annotate(connection, key, text)

    def note(self, key: str) -> str:
        """Return the note of a sweep; empty if it has none."""
        with self._reading() as connection:
            return annotations.notes(connection, [key]).get(key, "")

    def delete_sweeps(self, keys: Iterable[str]) -> int:
        """Delete sweeps with their results, tags and notes; return how many there were. Not while a run uses them."""
        with self._writing() as connection:
            return annotations.delete_sweeps(connection, keys)

    def delete_run(self, number: int) -> int:
        """Delete a run that has ended, and those of its sweeps that are in no other; return how many these were."""
        with self._writing() as connection:
            reading.one_run(connection, number)
            return annotations.delete_run(connection, number)

    def sources(self) -> dict[str, dict[str, int]]:
        """Return how many sweeps each component has computed, by ``kind:name`` and by the hash of its source."""
        with self._reading() as connection:
            return reading.sources(connection)

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
            raise StoreError(f"{self.name}: there is no result of sweep {key}; run its study")
        return found[key]

    def results(self, keys: Iterable[str]) -> dict[str, Result]:
        """Return the results of those sweeps that have one, with arrays."""
        with self._reading() as connection:
            return reading.results(connection, keys)

    def leases(self) -> dict[int, int]:
        """Return how many sweeps each run has taken upon itself, whether it lives or not."""
        with self._reading() as connection:
            return leases.counts(connection)

    def size(self) -> int:
        """Return the room that the database takes [bytes]."""
        return self._database.size()

    def journal(self) -> str:
        """Return how the database keeps what is being written."""
        with self._reading() as connection:
            return self._database.journal(connection)

    def health(self) -> str:
        """Return ``sound``, or the first finding: of the database's own check of its structure, or in what it holds."""
        with self._reading() as connection:
            found = self._database.health(connection)
            return found if found != "sound" else integrity.finding(connection) or found

    def merge(self, other: "Store") -> Generator[tuple[int, int], None, Merged]:
        """Add what another database has; yield how many of how many sweeps are done, and return what came of it.

        Results are joined by key. What both have and differs is told, and stays as it is here. Runs are given new
        numbers; those that are here already are known by host, process and start. Merging again adds nothing.
        """
        if other.name == self.name or (self._identity is not None and other._identity == self._identity):
            raise StoreError(f"{self.name}: a database cannot be merged into itself; name another one")
        return merging.merge(other._reading, self._reading, self._writing)

    def version(self) -> int:
        """Return a number that changes when anything is written, by this process or another: cheap enough to poll."""
        with self._reading() as connection:
            return self._written + self._database.version(connection)

    def replaced(self) -> bool:
        """Return whether the file that was opened has been deleted since, or another put in its place."""
        return self._database.identity() != self._identity

    def _check_there(self) -> None:
        if self.replaced():
            what = "replaced by another file" if self._database.identity() else "deleted or moved"
            raise StoreError(f"{self.name}: the database has been {what} since it was opened; open it again")

    @contextmanager
    def _reading(self) -> Iterator[Connection]:
        self._check_there()
        with self._database.sentences(), self._reader.connect() as connection:
            try:
                yield connection
            except DamagedError as error:
                raise StoreError(f"{self.name}: {error}") from error
            except FOREIGN as error:
                raise foreign(self.name, error) from error

    @contextmanager
    def _writing(self, how: str = ALONE) -> Iterator[Connection]:
        self._check_there()
        writer = self._engine.execution_options(**{WRITE: how})
        with self._database.sentences(), writer.begin() as connection:
            yield connection
        self._written += 1
