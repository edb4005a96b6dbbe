"""The contract of a database, and its name for messages."""

import json
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping
from contextlib import AbstractContextManager
from typing import ClassVar

from sqlalchemy import Connection, Engine

from fraexp.errors import StoreError

WRITE_MODE = "fraexp_write"
"""Execution option of a transaction that writes: EXCLUSIVE or CONCURRENT."""
EXCLUSIVE, CONCURRENT = "alone", "beside"
"""No other process writes during the transaction, or others may, because it changes rows of one run only."""
PASSWORD_PATTERNS = (
    (r"([?&](?:password|sslpassword)=)[^&#\s]*", r"\1***"),
    (r"(://[^:/?#]*:)(.+)@", r"\1***@"),
    (r"(\bpostgres[\w+]*(?!://)[:/]+[^:/?#]*:)(.+)@", r"\1***@"),  # a URL that lacks a part of ://
)


def masked_url(text: str) -> str:
    """Return a URL, or a text that contains one, with its password replaced by ``***``."""
    for pattern, replacement in PASSWORD_PATTERNS:
        text = re.sub(pattern, replacement, text)
    return text


def url_without_password(url: str) -> str:
    """Return a URL that can be pasted: its password, which is not shown, comes from PGPASSWORD or ~/.pgpass."""
    if "://" not in url:
        return masked_url(url)
    url = re.sub(r"(?<=[?&])(password|sslpassword)=[^&#]*&?", "", url).rstrip("?&")
    return re.sub(r"(://[^:/?#]*):.+@", r"\1@", url)


def compact_json(data: object) -> str:
    """Return plain data as JSON without blanks."""
    return json.dumps(data, separators=(",", ":"))


class Database(ABC):
    """A database that may not exist yet. All failures are raised as StoreError, in one line."""

    name: str
    """Name for messages, without password."""
    reading: ClassVar[Mapping[str, object]]
    """Execution options of a transaction that only reads: all its queries see the same state."""

    @property
    def location(self) -> str:
        """The file or URL for commands that are suggested, without a password."""
        return self.name

    @abstractmethod
    def exists(self) -> bool:
        """Return whether there is a database of fraexp; False if there is nothing."""

    @abstractmethod
    def identity(self) -> object:
        """Return an identifier that distinguishes the database from a later one of its name; None without one."""

    @abstractmethod
    def check_writable(self) -> None:
        """Raise StoreError if it is known in advance that nothing can be written."""

    def advice(self) -> str:
        """Return a warning about the place of the database; empty if there is none."""
        return ""

    @abstractmethod
    def writer(self) -> Engine:
        """Return an engine with one connection, which can read and write."""

    @abstractmethod
    def reader(self) -> Engine:
        """Return an engine that cannot write."""

    @abstractmethod
    def translated_errors(self) -> AbstractContextManager[None]:
        """Raise StoreError for the errors of the database in this context."""

    @abstractmethod
    def schema_number(self) -> int | None:
        """Return the number of the schema; None without one."""

    @abstractmethod
    def create(self) -> None:
        """Create the tables, completely or not at all, unless another process has just done so."""

    def restore(self, source: "Database") -> str:
        """Put a copy of another database in the place of this one; return what the earlier one is called now, or ""."""
        raise StoreError(f"{self.name}: fraexp restores files; restore a server with pg_restore")

    @abstractmethod
    def tidy(self) -> None:
        """Free the space of deleted rows."""

    @abstractmethod
    def size(self) -> int:
        """Return the size [bytes]."""

    @abstractmethod
    def version(self, connection: Connection) -> int:
        """Return a number that changes when another process writes."""

    @abstractmethod
    def health(self, connection: Connection) -> str:
        """Return ``sound``, or the first fault that the database's own check finds."""
