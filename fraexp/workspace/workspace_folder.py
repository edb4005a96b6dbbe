"""The folder and the database of a workspace: all that is needed to read, mark and delete; importing this is instant.

Whoever computes, draws or resolves studies uses `WorkspaceService`, which is one of these and imports far more.
"""

import shlex
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Self

from fraexp.data.identity import file_stamps
from fraexp.errors import StoreError, StudyError

if TYPE_CHECKING:
    from fraexp.components.registry import Registry
    from fraexp.store import Store

DATABASE_VARIABLE = "FRAEXP_DB"
"""Environment variable with the path or URL of the database, unless ``--db`` names one."""


@dataclass(frozen=True)
class WorkspaceFolder:
    """A folder with ``plugins/``, ``studies/`` and ``results.db``, each of which may be missing."""

    folder: Path
    database: str
    """Path or URL."""

    @classmethod
    def open(cls, folder: str | Path, database: str | None = None) -> Self:
        """Open a folder; the database is ``results.db`` in it, unless a path or URL is given."""
        root = Path(folder)
        try:
            is_folder, is_file = root.is_dir(), root.is_file()
        except (OSError, ValueError):  # such as a name that is too long
            is_folder = is_file = False
        if is_file:
            raise StudyError(f"{root}: is a file; expected the folder to work in, such as {root.parent}")
        if not is_folder:
            raise StudyError(f"{root}: there is no such folder to work in")
        return cls(root, str(database or root / "results.db"))

    @cached_property
    def registry(self) -> "Registry":
        """All components: installed ones and those in the workspace's ``plugins/``."""
        from fraexp.components.registry import discover

        return discover(self.folder / "plugins")

    def __getstate__(self) -> dict[str, object]:
        """Return folder and database: a copy in another process finds the plugins itself."""
        return {"folder": self.folder, "database": self.database}

    def reload(self) -> None:
        """Forget the registry, so that plugins that were added, repaired or broken since are loaded anew."""
        self.__dict__.pop("registry", None)

    def has_current_plugins(self) -> bool:
        """Return whether the registry is loaded, and from the plugin files as they are now."""
        if "registry" not in self.__dict__:
            return False
        return self.registry.local_files == file_stamps(self.folder / "plugins")

    def units(self, path: str) -> dict[str, set[str]]:
        """Return the units that a parameter can have on a straight axis, by component: for filters."""
        from fraexp.study.paths import units_of

        return units_of(path, self.registry)

    def open_store(self, mode: Literal["read", "write", "create"] = "read") -> "Store":
        """Return the opened database, a context manager: to read, to write, or made first if it is missing.

        Raises
        ------
        StoreError : the database is missing, damaged or of another schema; with ``create`` a missing one is made.
        """
        from fraexp.store import Store

        return Store.open(self.database, create=mode == "create", read_only=mode == "read", units=self.units)

    def has_database(self) -> bool:
        """Return whether there is probably a database; cheap, as the first `open_store` finds out what is wrong."""
        if "://" not in self.database:
            return Path(self.database).exists()
        try:
            return self.database_exists()
        except StoreError:  # there is something: opening it raises the same error where it can be reported
            return True

    def database_exists(self) -> bool:
        """Return whether a run has made the database; StoreError if something else is in its place."""
        from fraexp.store import Store

        return Store.exists(self.database)

    def write_refusal(self) -> str:
        """Return why the database cannot be written, so far as that shows before writing; empty if it can."""
        from fraexp.store import Store

        return Store.refusal(self.database)

    def restore_database(self, copy: str) -> str:
        """Put a checked copy in the place of the database, and return the name that the earlier one has now."""
        from fraexp.store import Store

        return Store.restore(self.database, copy)

    def shown_options(self) -> str:
        """Return the options that name workspace and database in a proposed command, with a blank before each."""
        from fraexp.store import url_without_password

        place = "" if self.folder.resolve() == Path.cwd() else f" --workspace {shlex.quote(str(self.folder))}"
        if self.database == str(self.folder / "results.db"):
            return place
        return f"{place} --db {shlex.quote(url_without_password(self.database))}"

    def location_options(self) -> list[str]:
        """Return the options that name this workspace from any folder."""
        return [f"--workspace={self.folder.absolute()}"]

    def location_environment(self) -> dict[str, str]:
        """Return the variable that names the database to a child process: everybody can read arguments.

        A URL may contain a password.
        """
        return {DATABASE_VARIABLE: self.database if "://" in self.database else str(Path(self.database).absolute())}
