"""Access of the screens to database and workspace, each in a thread of its own, so that keys never wait for them."""

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TypeVar

from fraexp.errors import StoreError
from fraexp.store import Store, masked_url
from fraexp.workspace.workspace_service import WorkspaceService

Answer = TypeVar("Answer")


class Backend:
    """A workspace and its database, which may be created, deleted or replaced at any time."""

    def __init__(self, folder: str | Path, database: str | None) -> None:
        self.workspace = WorkspaceService.open(folder, database)
        self._store: Store | None = None
        self._stamp: object = None
        self.opened = 0
        """How often the database was opened, as its version restarts each time."""
        self._reader = ThreadPoolExecutor(1, "reader")
        self._worker = ThreadPoolExecutor(1, "worker")

    async def read(self, question: Callable[[Store], Answer]) -> Answer:
        """Read from the database; StoreError if it is missing or cannot be read."""
        return await asyncio.get_running_loop().run_in_executor(self._reader, self._read_store, question)

    async def write(self, action: Callable[[Store], Answer]) -> Answer:
        """Change the database in one short transaction, which waits while a run is writing."""
        return await asyncio.get_running_loop().run_in_executor(self._reader, self._write_store, action)

    async def work(self, task: Callable[[WorkspaceService], Answer]) -> Answer:
        """Run a task of the workspace that may take long; tasks run one after another."""
        return await asyncio.get_running_loop().run_in_executor(self._worker, task, self.workspace)

    def close(self) -> None:
        """Close the database, and cancel pending tasks."""
        self._worker.shutdown(wait=False, cancel_futures=True)
        self._reader.submit(self._close_store)
        self._reader.shutdown(wait=True)

    def _read_store(self, question: Callable[[Store], Answer]) -> Answer:
        if self._store and (self._store.is_replaced() or self._stamp != self._file_stamp()):
            self._close_store()
        if not self.workspace.has_database():
            raise StoreError(
                f"{masked_url(self.workspace.database)}: there is no database yet; the first run creates it"
            )
        if self._store is None:
            self._store = self.workspace.open_store()
            self.opened += 1
            self._stamp = self._file_stamp()
        try:
            return question(self._store)
        except StoreError:
            self._close_store()  # it may be repaired before the next read, which opens it again
            raise

    def _file_stamp(self) -> object:
        """Return time and size of the file, which change when SQLite writes it, or when a user restores a copy.

        An open connection may go on with its cache of the earlier file.
        """
        try:
            state = Path(self.workspace.database).stat()
        except OSError:  # on a server, or deleted
            return None
        return state.st_mtime_ns, state.st_size

    def _write_store(self, action: Callable[[Store], Answer]) -> Answer:
        if not self.workspace.has_database():
            raise StoreError(f"{masked_url(self.workspace.database)}: the database was deleted; nothing was changed")
        with self.workspace.open_store("write") as store:
            return action(store)

    def _close_store(self) -> None:
        if self._store:
            self._store.close()
        self._store = None
