"""Sweeps as parts that are stored once and can be searched; tags, notes, and the progress of runs.

The way back is the copy that is made before.
"""

import hashlib
import json
from collections.abc import Iterator
from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None

SECTIONS = ("plant", "friction", "controller", "loop", "excitation", "numerics", "compensation", "record")
PARTS = ("rest", *SECTIONS, "estimator")
LONGEST = 16
AT_ONCE = 1000


def upgrade() -> None:
    """Take experiments and estimators apart."""
    _make_tables()
    with op.batch_alter_table("run") as table:
        table.add_column(sa.Column("progress", sa.JSON, nullable=True))
    with op.batch_alter_table("run_sweep") as table:
        table.add_column(sa.Column("standing", sa.SmallInteger, nullable=False, server_default="0"))
    with op.batch_alter_table("sweep") as table:
        for name in PARTS:
            table.add_column(sa.Column(f"{name}_part", sa.Integer, nullable=True))
    _take_apart(op.get_bind())
    _rank(op.get_bind())
    with op.batch_alter_table("sweep") as table:
        table.drop_column("experiment")
        table.drop_column("estimator")
    op.create_index("ix_sweep_created", "sweep", ["created"])
    op.drop_index("ix_metric_name", "metric")
    op.create_index("ix_metric_name_key_value", "metric", ["name", "key", "value"])


def _make_tables() -> None:
    op.create_table(
        "part",
        sa.Column("number", sa.Integer, nullable=False),
        sa.Column("section", sa.String(16), nullable=False),
        sa.Column("digest", sa.String(40), nullable=False),
        sa.Column("content", sa.JSON, nullable=False),
        sa.Column("lists", sa.JSON, nullable=True),
        sa.PrimaryKeyConstraint("number", name="pk_part"),
        sa.UniqueConstraint("digest", name="uq_part_digest"),
    )
    op.create_table(
        "field",
        sa.Column("kind", sa.String(16), nullable=False),
        sa.Column("name", sa.Text, nullable=False),
        sa.PrimaryKeyConstraint("kind", "name", name="pk_field"),
    )
    for table, column in (("tag", "name"), ("note", "text")):
        op.create_table(
            table,
            sa.Column("key", sa.String(64), nullable=False),
            sa.Column(column, sa.Text, nullable=False),
            sa.ForeignKeyConstraint(["key"], ["sweep.key"], name=f"fk_{table}_key_sweep", ondelete="CASCADE"),
            sa.PrimaryKeyConstraint(*(("key", "name") if table == "tag" else ("key",)), name=f"pk_{table}"),
        )
    op.create_index("ix_tag_name", "tag", ["name"])


def _take_apart(connection: sa.Connection) -> None:
    numbers: dict[str, int] = {}
    fields: set[tuple[str, str]] = set()
    begin = ""
    following = sa.text("SELECT key, experiment, estimator FROM sweep WHERE key > :begin ORDER BY key LIMIT :most")
    while rows := connection.execute(following, {"begin": begin, "most": AT_ONCE}).all():
        parts: list[dict[str, Any]] = []
        links = [{"of": row.key, **_links(row, numbers, parts, fields)} for row in rows]
        if parts:
            columns = "number, section, digest, content, lists"
            values = ":number, :section, :digest, :content, :lists"
            connection.execute(sa.text(f"INSERT INTO part ({columns}) VALUES ({values})"), parts)
        assigned = ", ".join(f"{name}_part = :{name}" for name in PARTS)
        connection.execute(sa.text(f"UPDATE sweep SET {assigned} WHERE key = :of"), links)
        begin = rows[-1].key
    fields |= {("metric", name) for name in connection.scalars(sa.text("SELECT DISTINCT name FROM metric"))}
    labels = connection.scalars(sa.text("SELECT DISTINCT labels FROM run_sweep"))
    fields |= {("label", str(name)) for text in labels for name in _read(text)}
    for kind in ("plant", "friction", "controller", "excitation", "estimator"):
        words = connection.scalars(sa.text(f"SELECT DISTINCT {kind}_name FROM sweep WHERE {kind}_name IS NOT NULL"))
        fields |= {("word", name) for name in words}
    rows_of_fields = [{"kind": kind, "name": name} for kind, name in sorted(fields)]
    if rows_of_fields:
        connection.execute(sa.text("INSERT INTO field (kind, name) VALUES (:kind, :name)"), rows_of_fields)


def _links(row: Any, numbers: dict[str, int], parts: list[dict[str, Any]], fields: set[tuple[str, str]]) -> Any:
    """Return the number of each part of a sweep; parts that are new are added to `parts`."""
    links: dict[str, int | None] = dict.fromkeys(PARTS)
    for section, data in _parts(_read(row.experiment), _read(row.estimator)):
        text = json.dumps(data, separators=(",", ":"))
        digest = hashlib.blake2b(f"{section}\n{text}".encode(), digest_size=20).hexdigest()
        if digest not in numbers:
            numbers[digest] = len(numbers) + 1
            lists: list[Any] = []
            content = _without_lists(data, [], lists)
            fields.update(("parameter", path) for path in _paths("" if section == "rest" else section, content))
            texts = {"content": json.dumps(content, separators=(",", ":")), "lists": None}
            if lists:
                texts["lists"] = json.dumps(lists, separators=(",", ":"))
            parts.append({"number": numbers[digest], "section": section, "digest": digest, **texts})
        links[section] = numbers[digest]
    return links


def _read(value: Any) -> Any:
    return json.loads(value) if isinstance(value, str) else value


def _parts(experiment: dict[str, Any], estimator: Any) -> Iterator[tuple[str, Any]]:
    yield "rest", {key: value for key, value in experiment.items() if key not in SECTIONS}
    yield from ((name, experiment[name]) for name in SECTIONS if name in experiment)
    yield "estimator", estimator


def _without_lists(data: Any, place: list[Any], lists: list[Any]) -> Any:
    if isinstance(data, list):
        if len(data) > LONGEST:
            lists.append([place, data])
            return None
        return [_without_lists(value, [*place, index], lists) for index, value in enumerate(data)]
    if isinstance(data, dict):
        return {key: _without_lists(value, [*place, key], lists) for key, value in data.items()}
    return data


def _paths(prefix: str, data: Any) -> Iterator[str]:
    if not isinstance(data, dict | list):
        yield prefix
        return
    for key, value in data.items() if isinstance(data, dict) else enumerate(data):
        yield from _paths(f"{prefix}.{key}" if prefix else str(key), value)


def _rank(connection: sa.Connection) -> None:
    """Tell apart a sweep's latest run (0), earlier ones (1), and repetitions within a run (2)."""
    repeated = "SELECT 1 FROM run_sweep AS o WHERE o.key = run_sweep.key AND o.run = run_sweep.run"
    later = "SELECT 1 FROM run_sweep AS o WHERE o.key = run_sweep.key AND o.run > run_sweep.run"
    for number, which in ((1, later), (2, f"{repeated} AND o.position < run_sweep.position")):
        connection.execute(sa.text(f"UPDATE run_sweep SET standing = {number} WHERE EXISTS ({which})"))
