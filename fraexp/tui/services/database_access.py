"""What the screens ask: the database in one thread, the workspace in another, so that keys never wait for either."""

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TypeVar

from fraexp.errors import StoreError
from fraexp.store import Store, shown
from fraexp.workspace.workspace import Workspace

Answer = TypeVar("Answer")


class Desk:
    """A workspace and its database; the database may come, go or be replaced at any time."""

    def __init__(self, folder: str | Path, database: str | None) -> None:
        self.workspace = Workspace.open(folder, database)
        self._store: Store | None = None
        self._stamp: object = None
        self.opened = 0
        """How often the database was opened: its version begins anew each time."""
        self._reader = ThreadPoolExecutor(1, "reader")
        self._worker = ThreadPoolExecutor(1, "worker")

    async def read(self, question: Callable[[Store], Answer]) -> Answer:
        """Ask the database; StoreError if there is none, or if it cannot answer."""
        return await asyncio.get_running_loop().run_in_executor(self._reader, self._asked, question)

    async def write(self, action: Callable[[Store], Answer]) -> Answer:
        """Let the database be changed in one short transaction, which waits for a run that writes at the moment."""
        return await asyncio.get_running_loop().run_in_executor(self._reader, self._changed, action)

    async def work(self, task: Callable[[Workspace], Answer]) -> Answer:
        """Let the workspace do something that may take its time; tasks follow one after another."""
        return await asyncio.get_running_loop().run_in_executor(self._worker, task, self.workspace)

    def close(self) -> None:
        """Leave the database, and what has not been asked yet."""
        self._worker.shutdown(wait=False, cancel_futures=True)
        self._reader.submit(self._leave)
        self._reader.shutdown(wait=True)

    def _asked(self, question: Callable[[Store], Answer]) -> Answer:
        if self._store and (self._store.replaced() or self._stamp != self._stamp_now()):
            self._leave()
        if not self.workspace.has_database():
            raise StoreError(f"{shown(self.workspace.database)}: there is no database yet; the first run makes it")
        if self._store is None:
            self._store = Store.open(self.workspace.database, read_only=True, units=self.workspace.units)
            self.opened += 1
            self._stamp = self._stamp_now()
        try:
            return question(self._store)
        except StoreError:
            self._leave()  # it may be mended by the next look: what was damaged is not asked again
            raise

    def _stamp_now(self) -> object:
        """Return what tells that the file itself was written: by SQLite now and then, or by whoever restores a copy.

        What is open then may go on with what it remembers of the file as it was.
        """
        try:
            state = Path(self.workspace.database).stat()
        except OSError:  # on a server, or gone
            return None
        return state.st_mtime_ns, state.st_size

    def _changed(self, action: Callable[[Store], Answer]) -> Answer:
        if not self.workspace.has_database():
            raise StoreError(f"{shown(self.workspace.database)}: there is no database any more; nothing was changed")
        with Store.open(self.workspace.database) as store:
            return action(store)

    def _leave(self) -> None:
        if self._store:
            self._store.close()
        self._store = None
