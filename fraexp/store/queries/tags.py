"""Tags by the user."""

from collections.abc import Iterable

from sqlalchemy import Connection, delete, func, insert, select

from fraexp.errors import StoreError, did_you_mean
from fraexp.store.damage import RESTORE_HINT
from fraexp.store.digests import read_tags, seal_tags, tags_digest
from fraexp.store.tables import key_chunks, sweep, tag


def check_tag(name: str) -> None:
    """Raise StoreError if a text is not a word that a filter can contain."""
    if not name or not name.isprintable() or any(letter in ' ,"' or letter.isspace() for letter in name):
        raise StoreError(f"{name!r} is not a tag; expected a word without blanks, commas and quotes, such as baseline")


def add_tag(connection: Connection, keys: Iterable[str], name: str) -> None:
    """Add a tag to sweeps."""
    check_tag(name)
    for chunk in _sound_keys(connection, keys):
        has = set(connection.scalars(select(tag.c.key).where(tag.c.name == name, tag.c.key.in_(chunk))))
        rows = [{"key": key, "name": name} for key in chunk if key not in has]
        if rows:
            connection.execute(insert(tag), rows)
            seal_tags(connection, [row["key"] for row in rows])


def remove_tag(connection: Connection, keys: Iterable[str], name: str) -> None:
    """Remove a tag from sweeps; StoreError if no sweep has it."""
    known = count_tags(connection)
    if name not in known:
        raise StoreError(f"no sweep has the tag '{name}'{did_you_mean(name, known)}")
    for chunk in _sound_keys(connection, keys):
        connection.execute(delete(tag).where(tag.c.name == name, tag.c.key.in_(chunk)))
        seal_tags(connection, chunk)


def count_tags(connection: Connection) -> dict[str, int]:
    """Return the number of sweeps with each tag, by name."""
    counts = select(tag.c.name, func.count().label("sweeps")).group_by(tag.c.name).order_by(tag.c.name)
    return {row.name: row.sweeps for row in connection.execute(counts)}


def _sound_keys(connection: Connection, keys: Iterable[str]) -> Iterable[list[str]]:
    """Yield the keys in lists; StoreError if one does not exist, or its tags are damaged."""
    for chunk in key_chunks(keys):
        tags = read_tags(connection, chunk)
        query = select(sweep.c.key, sweep.c.tags).where(sweep.c.key.in_(chunk))
        stored = {row.key: row.tags for row in connection.execute(query)}
        for key in chunk:
            if key not in stored:
                raise StoreError(f"there is no sweep {key}; it may have been deleted")
            if tags_digest(key, tags.get(key, ())) != stored[key]:
                raise StoreError(f"the tags of sweep {key[4:12]} are damaged; {RESTORE_HINT}")
        yield chunk
