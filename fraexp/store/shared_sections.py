"""Shared sections of sweeps: each is stored once as a part, with its long lists beside the searchable values."""

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence

from sqlalchemy import Connection, bindparam, delete, insert, select

from fraexp.data.sweep import Sweep, as_section
from fraexp.store.damage import read_tolerantly
from fraexp.store.digests import parts_digest
from fraexp.store.tables import PARTS, SECTIONS, ResultRow, RowValues, TableRow, field, key_chunks, part, sweep
from fraexp.store.validation import Json, JsonTable

MAX_SEARCHABLE_VALUES = 16
"""Length of lists whose values can be searched; longer ones are stored separately."""
Place = list[str | int]
"""Keys and indices of a value in plain data, from outside to inside."""
FIND_NAMES = select(field.c.name).where(field.c.kind == bindparam("kind"))
_compact = json.JSONEncoder(separators=(",", ":")).encode


def store_parts(connection: Connection, grid: Sequence[Sweep]) -> list[dict[str, int | None]]:
    """Store the new parts of sweeps, and return the numbers of each sweep's parts, and their digest, by column."""
    texts: dict[str, tuple[str, str]] = {}
    digests = [{name: _digest(name, data, texts) for name, data in _sections(item)} for item in grid]
    numbers = _part_numbers(connection, texts)
    fresh = [digest for digest in texts if digest not in numbers]
    rows = [_part_row(digest, *texts[digest]) for digest in fresh]
    if rows:
        connection.execute(insert(part), rows)
        numbers |= _part_numbers(connection, fresh)
        names = {name for row in rows for name in value_paths(_path_prefix(row["section"]), row["content"])}
        add_field_names(connection, "parameter", names)
    return [
        {f"{name}_part": numbers[of[name]] if name in of else None for name in PARTS}
        | {"parts": parts_digest(item.key, map(of.get, PARTS))}
        for item, of in zip(grid, digests, strict=True)
    ]


def load_parts(connection: Connection, rows: Sequence[TableRow]) -> dict[str, tuple[JsonTable, JsonTable]]:
    """Return experiment and estimator, by key, of rows with the key, the numbers of the parts, and their digest.

    Sweeps of which a part is missing or damaged are left out. Parts that sweeps share are the same objects.
    """
    wanted = {number for row in rows for name in PARTS if (number := row[f"{name}_part"]) is not None}
    found = read_tolerantly(lambda chunk: _read_parts(connection, chunk), wanted)
    contents = {number: content for number, (content, _) in found.items()}
    digests = {number: digest for number, (_, digest) in found.items()}
    return {row["key"]: _join_parts(row, contents) for row in rows if _has_parts(row, digests)}


def _has_parts(row: TableRow, digests: Mapping[int, str]) -> bool:
    """Return whether the parts of a sweep are there, and are those that it was stored with."""
    numbers = [row[f"{name}_part"] for name in PARTS]
    if any(number is not None and number not in digests for number in numbers):
        return False
    own = (None if number is None else digests[number] for number in numbers)
    return bool(row["parts"] == parts_digest(row["key"], own))


def _read_parts(connection: Connection, numbers: list[int]) -> dict[int, tuple[Json, str]]:
    """Return content and digest of parts by their numbers; damaged ones are left out."""
    found: dict[int, tuple[Json, str]] = {}
    for row in connection.execute(select(part).where(part.c.number.in_(numbers))):
        content = _restore_lists(row)
        if row.digest == _part_digest(row.section, _compact(content)):
            found[row.number] = (as_section(content), row.digest)
    return found


def add_field_names(connection: Connection, kind: str, names: Iterable[str]) -> None:
    """Add names to those that a filter can use."""
    wanted = set(names)
    if wanted:
        wanted -= set(connection.scalars(FIND_NAMES, {"kind": kind}))
        rows = [{"kind": kind, "name": name} for name in sorted(wanted)]
        if rows:
            connection.execute(insert(field), rows)


def delete_unused_parts(connection: Connection) -> None:
    """Delete the parts that no sweep uses; the trash must be empty."""
    for name in PARTS:
        column = sweep.c[f"{name}_part"]
        used = select(column).where(column.is_not(None))
        connection.execute(delete(part).where(part.c.section == name, part.c.number.not_in(used)))


def value_paths(prefix: str, data: Json) -> Iterator[str]:
    """Yield the dotted paths of all values in plain data."""
    match data:
        case Mapping():
            items: Iterable[tuple[object, Json]] = data.items()
        case list() | tuple():
            items = enumerate(data)
        case _:
            yield prefix
            return
    for key, value in items:
        yield from value_paths(f"{prefix}.{key}" if prefix else str(key), value)


def _sections(item: Sweep) -> Iterator[tuple[str, Json]]:
    yield "rest", {key: value for key, value in item.experiment.items() if key not in SECTIONS}
    yield from ((name, item.experiment[name]) for name in SECTIONS if name in item.experiment)
    yield "estimator", item.estimator


def _digest(section: str, data: Json, texts: dict[str, tuple[str, str]]) -> str:
    text = _compact(data)
    digest = _part_digest(section, text)
    texts[digest] = (section, text)
    return digest


def _part_digest(section: str, text: str) -> str:
    return hashlib.blake2b(f"{section}\n{text}".encode(), digest_size=20).hexdigest()


def _part_numbers(connection: Connection, digests: Iterable[str]) -> dict[str, int]:
    query = select(part.c.digest, part.c.number)
    return {
        digest: number
        for chunk in key_chunks(digests)
        for digest, number in connection.execute(query.where(part.c.digest.in_(chunk)))
    }


def _part_row(digest: str, section: str, text: str) -> RowValues:
    lists: list[tuple[Place, list[Json]]] = []
    content = _extract_lists(json.loads(text), [], lists)
    return {"section": section, "digest": digest, "content": content, "lists": lists or None}


def _extract_lists(data: Json, place: Place, lists: list[tuple[Place, list[Json]]]) -> Json:
    if isinstance(data, list):
        if len(data) > MAX_SEARCHABLE_VALUES:
            lists.append((place, data))
            return None
        return [_extract_lists(value, [*place, index], lists) for index, value in enumerate(data)]
    if isinstance(data, dict):
        return {key: _extract_lists(value, [*place, key], lists) for key, value in data.items()}
    return data


def _restore_lists(row: ResultRow) -> Json:
    content = row.content
    for place, values in row.lists or ():
        if not place:
            return values
        *way, last = place
        inside = content
        for step in way:
            inside = inside[step]
        inside[last] = values
    return content


def _join_parts(row: TableRow, contents: Mapping[int, Json]) -> tuple[JsonTable, JsonTable]:
    experiment = dict(contents[row["rest_part"]])
    for name in SECTIONS:
        if row[f"{name}_part"] is not None:
            experiment[name] = contents[row[f"{name}_part"]]
    return experiment, contents[row["estimator_part"]]


def _path_prefix(section: str) -> str:
    return "" if section == "rest" else section
