"""Sweeps as parts: sections that many sweeps share are stored once, their long lists beside what is searched."""

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from sqlalchemy import Connection, Row, delete, insert, select

from fraexp.data.sweep import Sweep
from fraexp.store.tables import PARTS, SECTIONS, chunks, field, part, sweep

LONGEST = 16
"""Values of a list that can be searched; longer ones are kept apart."""
_compact = json.JSONEncoder(separators=(",", ":")).encode


def store(connection: Connection, grid: Sequence[Sweep]) -> list[dict[str, int | None]]:
    """Write what is new in sweeps; return the numbers of their parts, by column."""
    texts: dict[str, tuple[str, str]] = {}
    digests = [{name: _digest(name, data, texts) for name, data in _parts(item)} for item in grid]
    numbers = _numbers(connection, texts)
    fresh = [digest for digest in texts if digest not in numbers]
    rows = [_row(digest, *texts[digest]) for digest in fresh]
    if rows:
        connection.execute(insert(part), rows)
        numbers |= _numbers(connection, fresh)
        names = {name for row in rows for name in paths(_below(row["section"]), row["content"])}
        learn(connection, "parameter", names)
    return [{f"{name}_part": numbers[of[name]] if name in of else None for name in PARTS} for of in digests]


def load(connection: Connection, rows: Sequence[Any]) -> dict[str, tuple[dict[str, Any], dict[str, Any]]]:
    """Return experiment and estimator, by key, of rows that have the key and the columns of the parts.

    What sweeps share is the same object in all of them.
    """
    wanted = {number for row in rows for name in PARTS if (number := row[f"{name}_part"]) is not None}
    contents: dict[int, Any] = {}
    for chunk in chunks(wanted):
        for found in connection.execute(select(part).where(part.c.number.in_(chunk))):
            contents[found.number] = _whole(found)
    return {row["key"]: _assembled(row, contents) for row in rows}


def learn(connection: Connection, kind: str, names: Iterable[str]) -> None:
    """Note names that sweeps can be found by from now on."""
    wanted = set(names)
    if wanted:
        wanted -= set(connection.scalars(select(field.c.name).where(field.c.kind == kind)))
        rows = [{"kind": kind, "name": name} for name in sorted(wanted)]
        if rows:
            connection.execute(insert(field), rows)


def sweep_out(connection: Connection) -> None:
    """Delete the parts that no sweep has any more."""
    for name in PARTS:
        column = sweep.c[f"{name}_part"]
        used = select(column).where(column.is_not(None))
        connection.execute(delete(part).where(part.c.section == name, part.c.number.not_in(used)))


def paths(prefix: str, data: Any) -> Iterator[str]:
    """Yield the dotted paths of all single values in plain data."""
    match data:
        case Mapping():
            items: Iterable[tuple[Any, Any]] = data.items()
        case list() | tuple():
            items = enumerate(data)
        case _:
            yield prefix
            return
    for key, value in items:
        yield from paths(f"{prefix}.{key}" if prefix else str(key), value)


def _parts(item: Sweep) -> Iterator[tuple[str, Any]]:
    yield "rest", {key: value for key, value in item.experiment.items() if key not in SECTIONS}
    yield from ((name, item.experiment[name]) for name in SECTIONS if name in item.experiment)
    yield "estimator", item.estimator


def _digest(section: str, data: Any, texts: dict[str, tuple[str, str]]) -> str:
    text = _compact(data)
    digest = hashlib.blake2b(f"{section}\n{text}".encode(), digest_size=20).hexdigest()
    texts[digest] = (section, text)
    return digest


def _numbers(connection: Connection, digests: Iterable[str]) -> dict[str, int]:
    query = select(part.c.digest, part.c.number)
    return {
        digest: number
        for chunk in chunks(digests)
        for digest, number in connection.execute(query.where(part.c.digest.in_(chunk)))
    }


def _row(digest: str, section: str, text: str) -> dict[str, Any]:
    lists: list[tuple[list[Any], list[Any]]] = []
    content = _without_lists(json.loads(text), [], lists)
    return {"section": section, "digest": digest, "content": content, "lists": lists or None}


def _without_lists(data: Any, place: list[Any], lists: list[tuple[list[Any], list[Any]]]) -> Any:
    if isinstance(data, list):
        if len(data) > LONGEST:
            lists.append((place, data))
            return None
        return [_without_lists(value, [*place, index], lists) for index, value in enumerate(data)]
    if isinstance(data, dict):
        return {key: _without_lists(value, [*place, key], lists) for key, value in data.items()}
    return data


def _whole(row: Row[Any]) -> Any:
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


def _assembled(row: Any, contents: Mapping[int, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    experiment = dict(contents[row["rest_part"]])
    for name in SECTIONS:
        if row[f"{name}_part"] is not None:
            experiment[name] = contents[row[f"{name}_part"]]
    return experiment, contents[row["estimator_part"]]


def _below(section: str) -> str:
    return "" if section == "rest" else section
