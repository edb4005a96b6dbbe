"""Contents of a measured file: its variables with their probable roles."""

from collections.abc import Callable, Mapping
from pathlib import Path

from fraexp.components.registry import Registry
from fraexp.errors import RecordError
from fraexp.records.roles import UNREADABLE, FileContent, guess_role
from fraexp.records.source import existing_file, find_reader

ContentLister = Callable[[Path], Mapping[str, tuple[tuple[int, ...], str]]]
"""Signature of a reader's optional `contents`: shape and unit of each variable of a file, by name."""


def list_contents(file: Path, registry: Registry, reader: str = "") -> list[FileContent]:
    """Return the variables of a file; RecordError if its reader cannot list them, or it has none."""
    path = existing_file(file)
    found = find_reader(reader, path, registry)
    listing: ContentLister | None = getattr(found, "contents", None)
    if listing is None:
        raise RecordError(f"{path.name}: reader '{found.name}' cannot list a file; give --channel NAME=COLUMN")
    contents = []
    for name, (shape, unit) in listing(path).items():
        role = guess_role(name, unit, shape)
        contents.append(FileContent(name, shape, unit, role.name, role.score))
    unreadable: Callable[[Path], Mapping[str, str]] | None = getattr(found, "unreadable", None)
    for name, kind in unreadable(path).items() if unreadable else ():
        contents.append(FileContent(name, (0,), "", f"{UNREADABLE}: {kind}"))
    if not contents:
        raise RecordError(f"{path.name}: nothing in the file can be read; expected columns or variables of numbers")
    return contents


def list_remarks(file: Path, registry: Registry, reader: str = "") -> list[str]:
    """Return in sentences what the reader of a file cannot know from it."""
    path = existing_file(file)
    remarks: Callable[[Path], list[str]] | None = getattr(find_reader(reader, path, registry), "remarks", None)
    return remarks(path) if remarks else []
