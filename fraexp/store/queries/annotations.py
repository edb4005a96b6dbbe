"""What people add to sweeps, and what they take away: tags, notes, deletion."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Any

from sqlalchemy import Connection, delete, func, insert, select, update

from fraexp.errors import StoreError, did_you_mean
from fraexp.store import shared_sections
from fraexp.store.clock import now
from fraexp.store.liveness import Process, alive
from fraexp.store.tables import LATEST, OVERTAKEN, chunks, note, run, run_sweep, sweep, tag


def check_tag(name: str) -> None:
    """Raise StoreError unless a text is a word that can be typed in a filter."""
    if not name or not name.isprintable() or any(letter in ' ,"' or letter.isspace() for letter in name):
        raise StoreError(f"{name!r} is no tag; expected a word without blanks, commas and quotes, such as baseline")


def add_tag(connection: Connection, keys: Iterable[str], name: str) -> None:
    """Give sweeps a tag; those that have it keep it."""
    check_tag(name)
    for chunk in _existing(connection, keys):
        has = set(connection.scalars(select(tag.c.key).where(tag.c.name == name, tag.c.key.in_(chunk))))
        rows = [{"key": key, "name": name} for key in chunk if key not in has]
        if rows:
            connection.execute(insert(tag), rows)


def remove_tag(connection: Connection, keys: Iterable[str], name: str) -> None:
    """Take a tag from sweeps; StoreError if no sweep at all has it."""
    known = tags(connection)
    if name not in known:
        raise StoreError(f"no sweep has the tag '{name}'{did_you_mean(name, known)}")
    for chunk in _existing(connection, keys):
        connection.execute(delete(tag).where(tag.c.name == name, tag.c.key.in_(chunk)))


def tags(connection: Connection) -> dict[str, int]:
    """Return how many sweeps have each tag, by name."""
    counts = select(tag.c.name, func.count().label("sweeps")).group_by(tag.c.name).order_by(tag.c.name)
    return {row.name: row.sweeps for row in connection.execute(counts)}


def annotate(connection: Connection, key: str, text: str) -> None:
    """Give a sweep a note in place of an older one; blank text takes it away."""
    list(_existing(connection, [key]))
    connection.execute(delete(note).where(note.c.key == key))
    if text.strip():
        connection.execute(insert(note).values(key=key, text=text.strip()))


def tags_of(connection: Connection, keys: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """Return the tags of those sweeps that have some, in alphabetical order."""
    found: dict[str, tuple[str, ...]] = defaultdict(tuple)
    for chunk in chunks(keys):
        query = select(tag.c.key, tag.c.name).where(tag.c.key.in_(chunk)).order_by(tag.c.name)
        for key, name in connection.execute(query):
            found[key] += (name,)
    return dict(found)


def notes(connection: Connection, keys: Iterable[str]) -> dict[str, str]:
    """Return the notes of those sweeps that have one."""
    found: dict[str, str] = {}
    for chunk in chunks(keys):
        found |= {row.key: row.text for row in connection.execute(select(note).where(note.c.key.in_(chunk)))}
    return found


def delete_sweeps(connection: Connection, keys: Iterable[str]) -> int:
    """Delete sweeps with all that belongs to them; return how many there were."""
    living = _living(connection)
    count = 0
    for chunk in chunks(keys):
        using = select(run_sweep.c.run).where(run_sweep.c.run.in_(living), run_sweep.c.key.in_(chunk)).limit(1)
        number = connection.scalar(using)
        if number is not None:
            raise StoreError(f"run {number} is going on and uses these sweeps; wait until it has ended, or cancel it")
        count += connection.execute(delete(sweep).where(sweep.c.key.in_(chunk))).rowcount
    shared_sections.sweep_out(connection)
    return count


def delete_run(connection: Connection, number: int) -> int:
    """Delete a run, and those of its sweeps that are in no other; return how many these were."""
    if number in _living(connection):
        raise StoreError(f"run {number} is going on; wait until it has ended, or cancel it, before it is deleted")
    keys = list(connection.scalars(select(run_sweep.c.key).where(run_sweep.c.run == number)))
    connection.execute(delete(run).where(run.c.number == number))
    left = run_sweep.alias()
    count = 0
    for chunk in chunks(keys):
        latest = select(func.max(left.c.run)).where(left.c.key == run_sweep.c.key).scalar_subquery()
        chosen = (run_sweep.c.key.in_(chunk), run_sweep.c.standing == OVERTAKEN, run_sweep.c.run == latest)
        connection.execute(update(run_sweep).where(*chosen).values(standing=LATEST))
        orphans = sweep.c.key.not_in(select(run_sweep.c.key).where(run_sweep.c.key.in_(chunk)))
        count += connection.execute(delete(sweep).where(sweep.c.key.in_(chunk), orphans)).rowcount
    shared_sections.sweep_out(connection)
    return count


def _living(connection: Connection) -> list[int]:
    going = select(run.c.number, run.c.host, run.c.boot, run.c.pid, run.c.process_start, run.c.heartbeat)
    rows: Sequence[Any] = connection.execute(going.where(run.c.state == "running")).all()
    moment = now(connection)
    return [number for number, *process, beat in rows if alive(Process(*process), moment - beat)]


def _existing(connection: Connection, keys: Iterable[str]) -> Iterable[list[str]]:
    """Yield lists of keys; StoreError for one that does not exist."""
    for chunk in chunks(keys):
        there = set(connection.scalars(select(sweep.c.key).where(sweep.c.key.in_(chunk))))
        missing = next((key for key in chunk if key not in there), None)
        if missing is not None:
            raise StoreError(f"there is no sweep {missing}; it may have been deleted")
        yield chunk
