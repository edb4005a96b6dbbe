"""The store: the only access to the database."""

import signal
import threading
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import wraps
from types import FrameType
from typing import Concatenate, ParamSpec, Self, TypeVar

from sqlalchemy import Connection, Engine

from fraexp.data.results import Outcome, Result
from fraexp.data.sweep import Plain, Sweep
from fraexp.errors import StoreError, UnavailableError
from fraexp.store import integrity
from fraexp.store.backends import locate_database
from fraexp.store.backends.engine import CONCURRENT, EXCLUSIVE, WRITE_MODE, Database
from fraexp.store.changes import leases, merging, trash, writing
from fraexp.store.liveness import steady_time, this_process
from fraexp.store.queries import reading, stored_results, sweep_pages, tags
from fraexp.store.queries.known_names import UnitDeclarations, no_declared_units
from fraexp.store.stored_records import Deletion, ListingPage, MergeSummary, RunProgress
from fraexp.store.tables import SCHEMA_NUMBER
from fraexp.store.validation import FOREIGN_DATA_ERRORS, DamagedError, foreign_data_error

DEFAULT_TIMEOUT_S = 10.0
"""Time to wait for another process that writes."""
Arguments = ParamSpec("Arguments")
Found = TypeVar("Found")


def _reads(
    query: Callable[Concatenate[Connection, Arguments], Found],
) -> Callable[Concatenate["Store", Arguments], Found]:
    """Return a query as a method of the store, in a transaction of its own."""

    @wraps(query)
    def method(store: "Store", /, *arguments: Arguments.args, **options: Arguments.kwargs) -> Found:
        with store._reading() as connection:
            return query(connection, *arguments, **options)

    return method


def _writes(
    change: Callable[Concatenate[Connection, Arguments], Found],
) -> Callable[Concatenate["Store", Arguments], Found]:
    """Return a change as a method of the store, in a transaction of its own."""

    @wraps(change)
    def method(store: "Store", /, *arguments: Arguments.args, **options: Arguments.kwargs) -> Found:
        with store._writing() as connection:
            return change(connection, *arguments, **options)

    return method


class Store:
    """Runs, sweeps and results in a database. Each call is one transaction: it takes effect completely or not at all.

    All failures of the database are raised as StoreError, in one line with the remedy.
    """

    def __init__(self, database: Database, engine: Engine, units: UnitDeclarations = no_declared_units) -> None:
        self._database, self._unit_declarations = database, units
        self._engine = engine
        self._writers = {mode: engine.execution_options(**{WRITE_MODE: mode}) for mode in (EXCLUSIVE, CONCURRENT)}
        self._reader = engine.execution_options(**database.reading)
        self._identity = database.identity()
        self._written = 0
        self._begin_times: dict[int, float] = {}
        """Steady times at which the runs of this process began [s]."""

    @classmethod
    def open(
        cls,
        url: str,
        *,
        create: bool = False,
        read_only: bool = False,
        timeout: float = DEFAULT_TIMEOUT_S,
        units: UnitDeclarations = no_declared_units,
    ) -> Self:
        """Open the database at ``postgresql://user@host/database``, ``sqlite:///results.db`` or a plain path.

        It is a context manager.

        Parameters
        ----------
        create : create the tables (and the file) if the database is missing or empty.
        read_only : for readers, which cannot disturb a run; the database must exist.
        timeout : time to wait for another process that writes [s].
        units : returns the units in which a parameter is declared, so that filters can refuse others.
        """
        database = locate_database(url, timeout)
        if create and not database.exists():
            database.create()
        _check_schema(database)
        if not read_only:
            database.check_writable()
        return cls(database, database.reader() if read_only else database.writer(), units)

    @staticmethod
    def exists(url: str) -> bool:
        """Return whether there is a database of any schema; StoreError if there is something else."""
        return locate_database(url, DEFAULT_TIMEOUT_S).exists()

    @staticmethod
    def restore(url: str, copy: str) -> str:
        """Put a copy of a sound database in the place of another one, if that exists, and return its name from now on.

        Nothing is lost: the earlier file is kept under that name, with its log. StoreError if the copy is not sound,
        or while a process has the earlier file open.
        """
        database = locate_database(url, DEFAULT_TIMEOUT_S)
        with Store.open(copy, read_only=True) as source:
            if (found := source.health()) != "sound":
                raise StoreError(f"{source.name}: {found}")
            if (number := _find_running(url)) is not None:
                raise StoreError(f"{database.name}: run {number} is running; stop it with 'fraexp stop {number}' first")
            return database.restore(source._database)

    @staticmethod
    def refusal(url: str) -> str:
        """Return why the database cannot be written, if that is known in advance; otherwise an empty text."""
        try:
            locate_database(url, DEFAULT_TIMEOUT_S).check_writable()
        except StoreError as error:
            return str(error)
        return ""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections."""
        self._engine.dispose()

    @property
    def name(self) -> str:
        """Name of the database for messages: its file, or its URL without the password."""
        return self._database.name

    @property
    def advice(self) -> str:
        """A warning about the place of the database; empty if there is none."""
        return self._database.advice()

    # What these take and return is said where they are defined.
    stored_states = _reads(stored_results.stored_states)
    like_times = _reads(stored_results.like_times)
    claim = _writes(leases.claim_sweeps)
    lease_holders = _reads(leases.find_holders)
    save = _writes(writing.save_results)
    fail = _writes(writing.record_failure)
    runs = _reads(reading.read_runs)
    run = _reads(reading.read_run)
    sweeps = _reads(reading.read_sweeps)
    fields = _reads(sweep_pages.field_names)
    tag = _writes(tags.add_tag)
    untag = _writes(tags.remove_tag)
    tags = _reads(tags.count_tags)
    trash = _reads(trash.read_trash)
    sources = _reads(stored_results.count_sources)
    find = _reads(reading.find_sweep)
    find_all = _reads(reading.find_sweeps)
    log = _reads(reading.read_log)
    results = _reads(stored_results.read_results)
    leases = _reads(leases.count_leases)

    def begin_run(self, study: str, study_file: str, command: str, provenance: Plain, sweeps: Sequence[Sweep]) -> int:
        """Store a run of this process with its sweeps, all pending, and return its number.

        With a ``run_id`` in its provenance it is stored once, however often the call is repeated.
        """
        began = steady_time()
        with self._writing() as connection:
            number = writing.begin_run(connection, study, study_file, command, provenance, sweeps)
        self._begin_times[number] = began
        return number

    def beat(self, run: int, progress: RunProgress | None = None) -> None:
        """Store a heartbeat of a run, with its progress.

        Readers on other hosts cannot see the process, and no reader can ask it for its progress.
        """
        with self._writing(CONCURRENT) as connection:  # this run must not seem dead while another one stores much
            writing.record_heartbeat(connection, run, progress)

    def reuse(self, run: int, keys: Iterable[str]) -> None:
        """Mark sweeps of a run as reused."""
        with self._writing() as connection:
            writing.mark_sweeps(connection, run, keys, "reused")

    def end_run(self, run: int, state: str) -> None:
        """Store the final state of a run: ``complete``, ``partial`` or ``interrupted``."""
        began = self._begin_times.get(run)
        with self._writing() as connection:
            writing.end_run(connection, run, state, None if began is None else steady_time() - began)

    def page(
        self,
        filter: str = "",  # noqa: A002 (the word that users know)
        order: str = "",
        offset: int = 0,
        limit: int = 100,
        run: int | None = None,
    ) -> ListingPage:
        """Return a page of the listing of all sweeps, or of a run's sweeps, without arrays.

        Parameters
        ----------
        filter : terms such as ``estimator=effective_input excitation.amplitude>=12 -tag:baseline``; all must hold.
        order : one of `fields`, a leading ``-`` for falling values; by default ``-created``, or a run's ``position``.
            Sweeps without the value come last.
        offset, limit : number of rows before the page, and in it.
        """
        with self._reading() as connection:
            if run is not None:
                reading.check_run(connection, run)
            return sweep_pages.read_page(connection, filter, order, offset, limit, run, self._unit_declarations)

    def keys(self, filter: str = "", run: int | None = None) -> list[str]:  # noqa: A002 (the same)
        """Return the keys of all sweeps that match a filter, in the default order of `page`."""
        with self._reading() as connection:
            if run is not None:
                reading.check_run(connection, run)
            return sweep_pages.matching_keys(connection, filter, run, self._unit_declarations)

    def delete(self, keys: Iterable[str] = (), runs: Sequence[int] = ()) -> int:
        """Move sweeps, and runs with the sweeps that no other run has, to the trash; return the number of these sweeps.

        StoreError while one of the runs, or one that uses a sweep, is running.
        """
        with self._writing() as connection:
            for number in runs:
                reading.check_run(connection, number)
            return trash.move_to_trash(connection, keys, runs)

    def undelete(self, keys: Sequence[str] = (), runs: Sequence[int] = ()) -> Deletion:
        """Bring sweeps, and runs with their sweeps, back from the trash, and return those that came back.

        Without arguments this undoes the latest deletion of which something can come back. A sweep that was computed
        again keeps its newer result.
        """
        with self._writing() as connection:
            if keys or runs:
                return trash.take_from_trash(connection, keys, runs)
            for deletion in trash.read_trash(connection):
                restored = trash.take_from_trash(connection, deletion.keys, deletion.runs)
                if restored.keys or restored.runs:
                    return restored
            return Deletion((), ())

    def empty_trash(self) -> Deletion:
        """Delete what is in the trash for good, free its space, and return what it was."""
        with self._writing() as connection:
            gone = trash.empty_trash(connection)
        with suppress(UnavailableError):  # another process reads: the space is reused instead
            self._database.tidy()
        return gone

    def result(self, key: str) -> Result:
        """Return the result of a sweep, with arrays."""
        if (found := self.results([key]).get(key)) is None:
            raise StoreError(f"{self.name}: there is no result of sweep {key}; run its study")
        if found.outcome is Outcome.DAMAGED:
            raise StoreError(f"{self.name}: sweep {key[4:12]}: {found.message}; {Outcome.DAMAGED.value}")
        return found

    def size(self) -> int:
        """Return the size of the database [bytes]."""
        return self._database.size()

    def health(self) -> str:
        """Return ``sound``, or what is damaged in the structure of the database and in its contents."""
        return str(self.examine())

    def examine(self) -> integrity.Examination:
        """Check the structure of the database and all digests; this reads everything."""
        try:
            with self._reading() as connection:
                structure = self._database.health(connection)
        except StoreError as error:
            structure = str(error).removeprefix(f"{self.name}: ")
        return integrity.examine(self._reading, "" if structure == "sound" else structure)

    def confirm_run(self, number: int, computed: int) -> None:
        """Raise StoreError unless the database is sound and has a run of this process with as many computed sweeps.

        If another program overwrites the file while a run uses it, neither SQLite nor the system reports that.
        """
        with self._reading() as connection:
            found = self._database.health(connection)
            runs = reading.read_runs(connection, number) if found == "sound" else []
        why = "some of its results are missing" if found == "sound" else found
        if not any(run.process == this_process() and run.computed >= computed for run in runs):
            what = f"the database was overwritten or damaged while run {number} was using it ({why})"
            raise StoreError(f"{self.name}: {what}; restore a copy, and run again")

    def merge(self, other: "Store") -> Generator[tuple[int, int], None, MergeSummary]:
        """Add the contents of another database; yield the numbers of done and of all sweeps, and return a summary.

        Results are matched by key. Results that differ are reported, and this database keeps its own. Runs get new
        numbers; host, process and start identify runs that exist already. A second merge adds nothing.
        """
        if other.name == self.name or (self._identity is not None and other._identity == self._identity):
            raise StoreError(f"{self.name}: a database cannot be merged into itself; name another one")
        return merging.merge_databases(other._reading, self._reading, self._writing)

    def version(self) -> int:
        """Return a number that changes when any process writes; it is cheap to poll."""
        with self._reading() as connection:
            return self._written + self._database.version(connection)

    def is_replaced(self) -> bool:
        """Return whether the opened file has been deleted or replaced since."""
        return self._database.identity() != self._identity

    def _check_unchanged(self) -> None:
        if self.is_replaced():
            fate = "replaced by another file" if self._database.identity() else "deleted or moved"
            raise StoreError(f"{self.name}: the database has been {fate} since it was opened; open it again")

    @contextmanager
    def _reading(self) -> Iterator[Connection]:
        self._check_unchanged()
        with self._database.translated_errors(), self._reader.connect() as connection:
            try:
                yield connection
            except DamagedError as error:
                raise StoreError(f"{self.name}: {error}") from error
            except FOREIGN_DATA_ERRORS as error:
                raise foreign_data_error(self.name, error) from error

    @contextmanager
    def _writing(self, mode: str = EXCLUSIVE) -> Iterator[Connection]:
        self._check_unchanged()
        with deferred_interrupt(), self._database.translated_errors(), self._writers[mode].begin() as connection:
            yield connection
        self._written += 1


def _check_schema(database: Database) -> None:
    """Raise StoreError if there is no database, or one of another schema."""
    if not database.exists():
        raise StoreError(f"{database.name}: there is no database yet; 'fraexp run STUDY' makes one")
    number = database.schema_number()
    if number != SCHEMA_NUMBER:
        found = "no schema number" if number is None else f"schema {number}"
        raise StoreError(
            f"{database.name}: the database has {found}, this fraexp needs schema {SCHEMA_NUMBER}; open it with the "
            "version of fraexp that made it, or name another database with --db and run the studies again"
        )


def _find_running(url: str) -> int | None:
    """Return the number of a run that uses a database; None if there is none, or if the database cannot be read."""
    try:
        with Store.open(url, read_only=True) as store:
            return next((run.number for run in store.runs() if run.state == "running"), None)
    except StoreError:
        return None


@contextmanager
def deferred_interrupt() -> Iterator[None]:
    """Put off Ctrl-C until the block has ended; a second one takes effect at once.

    An exception in the middle of a transaction's beginning or end would leave it open, and the database locked.
    """
    if threading.current_thread() is not threading.main_thread():  # where Python delivers no signals
        yield
        return
    before = signal.getsignal(signal.SIGINT)
    if not callable(before):  # ignored, or left to the system
        yield
        return
    waiting: list[tuple[int, FrameType | None]] = []

    def put_off(number: int, frame: FrameType | None) -> None:
        if waiting:
            before(number, frame)
        waiting.append((number, frame))

    signal.signal(signal.SIGINT, put_off)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if waiting:
        before(*waiting[0])
