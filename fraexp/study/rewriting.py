"""Study files rewritten with the names of today; comments, order and layout stay as they are."""

import codecs
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.container import Container
from tomlkit.items import AbstractTable, AoT, Array, Item, Key, SingleKey, Table

from fraexp.components.registry import Registry
from fraexp.data.atomic_file import atomic_file
from fraexp.data.sweep import Plain
from fraexp.errors import FraexpError, StudyError
from fraexp.study.former_names import CurrentNames
from fraexp.study.study_file import machine_of, read


@dataclass(frozen=True)
class Rewritten:
    """What happened to a study's file."""

    file: Path
    renamed: dict[str, str]
    """Former names with those of today, by path; empty if there were none."""
    error: str = ""


def rewrite_all(files: Sequence[Path], folder: Path, registry: Registry) -> Iterator[Rewritten]:
    """Rewrite files one after another, all studies and machines of the workspace if none is given."""
    for file in _study_files(files or [folder / "studies"]):
        try:
            yield Rewritten(file, rewrite(file, folder, registry))
        except FraexpError as error:
            yield Rewritten(file, {}, str(error))


def _study_files(paths: Sequence[Path]) -> Iterator[Path]:
    """Yield the study files among paths, and those in folders among them."""
    for path in paths:
        yield from sorted(file for file in path.rglob("*.toml") if not file.is_dir()) if path.is_dir() else [path]


def rewrite(file: Path, folder: Path, registry: Registry) -> dict[str, str]:
    """Replace the former names in a file, of a study or of a machine; return them with those of today, by path.

    `folder` is the workspace, in which the study's machine may be. StudyError if the file is no study, or if it is
    written in a way that cannot be kept; it is left as it is then.
    """
    data, written = read(file), file.read_bytes()
    text = written.decode("utf-8-sig")  # with its line endings, which stay
    names = CurrentNames(registry, str(file))
    current = names.study(data, machine_of(data, file, folder, registry))
    if not names.renamed:
        return {}
    document = tomlkit.parse(text)
    _replace_names(document, data, current)
    rewritten = tomlkit.dumps(document)
    if tomllib.loads(rewritten) != current:
        told = ", ".join(f"{old} → {new}" for old, new in names.renamed.items())
        raise StudyError(f"{file}: cannot be rewritten without changing more than names; change by hand: {told}")
    with atomic_file(file) as draft:
        draft.write_bytes((codecs.BOM_UTF8 if written.startswith(codecs.BOM_UTF8) else b"") + rewritten.encode())
    return names.renamed


def _replace_names(container: Container, before: Plain, after: Plain) -> None:
    """Give the keys of a table, and of the tables in it, the names that they have in `after`."""
    values = dict(zip(before, zip(before.values(), after.items(), strict=True), strict=True))
    for at, (key, item) in enumerate(container.body):
        if key is None:  # a comment, or an empty line
            continue
        old, (name, new) = values[key.key]
        container.body[at] = (_rename_key(key, name), _replace_item(item, old, new))


def _rename_key(key: Key, name: str) -> Key:
    if key.key == name or not isinstance(key, SingleKey):
        return key
    written = key.as_string()
    return SingleKey(name, key.t, written[len(written.rstrip()) :] + key.sep)


def _replace_item(item: Item, old: Any, new: Any) -> Item:
    """Return an item with the names of `new` in it."""
    if isinstance(item, Table):
        item.display_name = None  # the header as it was read, with the former name
    if isinstance(item, AbstractTable) and isinstance(new, Mapping):
        _replace_names(item.value, old, new)
    elif isinstance(item, AoT | Array) and isinstance(new, list) and isinstance(old, list) and len(old) == len(new):
        for at, (one, was, now) in enumerate(zip(list(item), old, new, strict=True)):
            if isinstance(one, AbstractTable):
                _replace_names(one.value, was, now)
            elif was != now:
                item[at] = now
    elif old != new:
        replacement = tomlkit.item(new)
        replacement.trivia.__dict__.update(vars(item.trivia))
        return replacement
    return item
