"""Many seeded histories, one after another, on the same two engines."""

import logging
import shutil
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from fraexp.store import Store
from fraexp.store.changes.writing import ensure_sweeps
from tests.execution.simulation.faulty_sqlite import FaultyFile
from tests.execution.simulation.history import GRID, History

SLOTS = 2
"""Processes that run at the same time."""


@dataclass(frozen=True)
class BrokenHistory:
    """A history in which an invariant is broken."""

    seed: int
    findings: list[str]
    log: list[str]
    """The faults that it suffered."""


class World:
    """A folder, preferably in memory, in which histories run."""

    def __init__(self, folder: Path) -> None:
        self._template, self._path = folder / "template.db", folder / "history.db"
        with Store.open(str(self._template), create=True) as store, store._writing() as connection:
            ensure_sweeps(connection, GRID)  # sweeps that exist make histories shorter
        self._files = [FaultyFile(self._path, 0.0) for _ in range(SLOTS)]
        self._engines = [file.writer() for file in self._files]
        shutil.copyfile(self._template, self._path)
        for file, engine in zip(self._files, self._engines, strict=True):
            engine.connect().close()  # the first connection executes more statements, and all histories are alike
            engine.dispose()
            file.close_all()
        logging.getLogger("sqlalchemy.pool").disabled = True  # it reports the connections of killed processes

    def history(self, seed: int) -> BrokenHistory | None:
        """Run the history of a seed; return None if no invariant is broken."""
        for suffix in ("", "-wal", "-shm"):
            Path(f"{self._path}{suffix}").unlink(missing_ok=True)
        shutil.copyfile(self._template, self._path)
        history = History(seed, self._files, self._engines)
        try:
            findings = history.run()
        finally:
            for slot in range(SLOTS):
                history.close_connections(slot)
        return BrokenHistory(seed, findings, history.log) if findings else None

    def broken(self, seeds: Iterable[int]) -> Iterator[BrokenHistory]:
        """Yield the histories in which an invariant is broken."""
        return filter(None, map(self.history, seeds))
