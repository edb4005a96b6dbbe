"""What the store asks of a database, whichever it is; and the names under which databases are shown."""

import json
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from typing import Any, ClassVar

from sqlalchemy import Connection, Engine

WRITE = "fraexp_write"
"""Execution option of a transaction that is going to write: one of ALONE and BESIDE."""
ALONE, BESIDE = "alone", "beside"
"""Nobody else writes meanwhile, or others may, as rows of one run alone are changed."""
SECRETS = ((r"(://[^:/?#]*:)(.+)@", r"\1***@"), (r"([?&](?:password|sslpassword)=)[^&#\s]*", r"\1***"))
Step = Callable[[Connection], None]


def shown(text: str) -> str:
    """Return a URL, or a text with one in it, without its password."""
    for secret, instead in SECRETS:
        text = re.sub(secret, instead, text)
    return text


def compact(data: Any) -> str:
    """Return plain data as JSON without blanks."""
    return json.dumps(data, separators=(",", ":"))


class Database(ABC):
    """A place for tables, whether there are any yet or not. What goes wrong is raised as StoreError, in one line."""

    name: str
    """As people know it, without password."""
    reading: ClassVar[Mapping[str, Any]]
    """Execution options of a transaction that only reads: all its questions are answered from the same moment."""
    upgrades_itself: ClassVar[bool]
    """Whether a writer may change an older schema without being asked: nobody else uses the database."""

    @abstractmethod
    def exists(self) -> bool:
        """Return whether there is a database of ours; False if there is nothing yet."""

    @abstractmethod
    def identity(self) -> object:
        """Return what tells the database from another that may come to bear its name; None if there is none."""

    @abstractmethod
    def check_writable(self) -> None:
        """Raise StoreError if it is plain beforehand that nothing can be written."""

    def advice(self) -> str:
        """Return what people should know of the place before they write to it; nothing if all is well."""
        return ""

    @abstractmethod
    def writer(self) -> Engine:
        """Return an engine of one connection, which also reads."""

    @abstractmethod
    def reader(self) -> Engine:
        """Return an engine that cannot write."""

    @abstractmethod
    def sentences(self) -> AbstractContextManager[None]:
        """Turn what the database raises into StoreError."""

    @abstractmethod
    def revision(self) -> str | None:
        """Return the revision of the schema; None if there is none."""

    @abstractmethod
    def create(self, first: str, upgrade: Callable[[Connection, str | None], None]) -> None:
        """Make the tables unless somebody else was quicker; wholly or not at all.

        `upgrade` is given a connection and the revision that its tables have: None, or `first`, the current one.
        """

    @abstractmethod
    def migrate(self, head: str, upgrade: Step) -> None:
        """Bring the tables up to the revision `head` unless somebody else was quicker; wholly or not at all."""

    @abstractmethod
    def tidy(self) -> None:
        """Give back the room that deleted rows have left."""

    @abstractmethod
    def size(self) -> int:
        """Return the room that it takes [bytes]."""

    def journal(self, connection: Connection) -> str:
        """Return how it keeps what is being written, as far as that differs between databases of its kind."""
        return ""

    @abstractmethod
    def version(self, connection: Connection) -> int:
        """Return a number that changes when another process writes."""

    @abstractmethod
    def health(self, connection: Connection) -> str:
        """Return ``sound``, or the first finding of the database's own checks."""
