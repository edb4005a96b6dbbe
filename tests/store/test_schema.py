import shutil
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest
from sqlalchemy.dialects import postgresql
from sqlalchemy.schema import CreateTable

from fraexp.data.results import Outcome
from fraexp.errors import StoreError
from fraexp.store import Store
from fraexp.store.backends.sqlite import SqliteFile
from fraexp.store.migrations import FOLDER, HISTORY
from fraexp.store.schema import Schema, check_readable, prepare_database
from fraexp.store.tables import metadata
from tests.ready_schema import MIGRATE

ASSETS = Path(__file__).parent / "assets"
ROOT = Path(__file__).parents[2]
PRAGMAS = ("application_id", "user_version", "journal_mode", "page_size", "auto_vacuum", "encoding")

NEXT = """
import sqlalchemy as sa
from alembic import op

revision = "next"
down_revision = "{head}"

def upgrade():
    with op.batch_alter_table("run", recreate="always") as table:
        table.add_column(sa.Column("note", sa.Text, nullable=False, server_default="none"))
    {more}
"""


@pytest.fixture
def next_schema(tmp_path):
    def with_more(more: str = "pass") -> Schema:
        folder = tmp_path / "revisions"
        folder.mkdir()
        (folder / "next.py").write_text(NEXT.format(head=HISTORY[-1], more=more))
        return Schema((*HISTORY, "next"), (FOLDER / "versions", folder))

    return with_more


def columns(path: Path, table: str) -> list[str]:
    with closing(sqlite3.connect(path)) as connection:
        return [row[1] for row in connection.execute(f"PRAGMA table_info({table})")]


@pytest.fixture
def migrated(tmp_path, monkeypatch):
    """A new database that the migrations have made."""
    with monkeypatch.context() as patch:
        patch.setattr(Schema, "upgrade", MIGRATE)
        Store.open(str(tmp_path / "migrated.db"), create=True).close()
    return tmp_path / "migrated.db"


def test_the_revisions_make_the_tables_that_the_code_uses(migrated):
    from alembic.autogenerate import compare_metadata
    from alembic.migration import MigrationContext

    engine = SqliteFile(migrated, 1.0).reader()
    with engine.connect() as connection:
        assert compare_metadata(MigrationContext.configure(connection), metadata) == []
    engine.dispose()


def test_the_databases_of_other_tests_are_those_that_the_migrations_make(migrated, tmp_path):
    def contents(path):
        with closing(sqlite3.connect(path)) as connection:
            pragmas = [connection.execute(f"PRAGMA {name}").fetchone() for name in PRAGMAS]
            return sorted(connection.iterdump()), pragmas

    for number in range(2):
        Store.open(str(tmp_path / f"{number}.db"), create=True).close()
        assert contents(tmp_path / f"{number}.db") == contents(migrated)


def test_the_history_names_every_revision():
    from alembic.script import ScriptDirectory

    found = [item.revision for item in ScriptDirectory(str(FOLDER)).walk_revisions()]
    assert tuple(reversed(found)) == HISTORY


def test_the_tables_can_be_made_in_postgresql():
    dialect = postgresql.dialect()
    texts = {table.name: str(CreateTable(table).compile(dialect=dialect)) for table in metadata.sorted_tables}
    assert "response BYTEA NOT NULL" in texts["frequency_response"]
    assert "started TIMESTAMP WITH TIME ZONE NOT NULL" in texts["run"]


@pytest.mark.parametrize("asset", sorted(ASSETS.glob("schema-*.db")), ids=lambda item: item.name)
def test_a_database_of_every_schema_still_opens(asset, path):
    shutil.copy(asset, path)
    with Store.open(str(path)) as store:
        run = store.run(1)
        assert (run.state, run.total, run.computed, run.failed) == ("complete", 2, 1, 1)
        done, failed = store.sweeps(1)
        response = store.result(done.key).response
        assert response is not None
        assert response.unit == "m/N"
        assert abs(response.response[1] - (0.001 - 0.002j)) < 1e-15
        assert done.sources["friction:rolling"].distribution == "fraexp 0.1.0"
        assert (failed.state, failed.outcome, failed.message) == ("failed", None, "killed its worker twice")
        assert store.stored_states([done.key])[done.key].outcome is Outcome.OK


def test_there_is_an_asset_of_every_schema():
    assert [item.stem for item in sorted(ASSETS.glob("schema-*.db"))] == [f"schema-{name}" for name in HISTORY]


def test_an_older_database_is_copied_and_brought_up_to_date(store, begin, sweep, result, path, next_schema):
    run = begin([sweep()])
    store.save(run, [(sweep(), result(), {})])
    store.close()
    prepare_database(SqliteFile(path, 1.0), False, next_schema())
    assert "note" in columns(path, "run")
    copy = path.with_name(f"results.db.bak-{HISTORY[-1]}")
    assert sorted(item.name for item in path.parent.iterdir() if item.is_file()) == [path.name, copy.name]
    with Store.open(str(copy)) as older:
        assert older.result(sweep().key).message == "all well"
    with closing(sqlite3.connect(path)) as connection:  # what refers to the rebuilt table is still there
        assert connection.execute("SELECT count(*) FROM run_sweep JOIN frequency_response USING (key)").fetchone() == (
            1,
        )


def test_a_migration_that_fails_changes_nothing(store, begin, sweep, path, next_schema):
    begin([sweep()])
    store.close()
    broken = next_schema("op.execute('INSERT INTO nowhere VALUES (1)')")
    with pytest.raises(StoreError, match="no such table: nowhere"):
        prepare_database(SqliteFile(path, 1.0), False, broken)
    assert "note" not in columns(path, "run")
    with Store.open(str(path)) as again:
        assert again.run(1).total == 1


def test_a_migration_that_leaves_rows_without_what_they_refer_to_changes_nothing(
    store, begin, sweep, path, next_schema
):
    begin([sweep()])
    store.close()
    with pytest.raises(StoreError, match="the migration breaks references between rows"):
        prepare_database(SqliteFile(path, 1.0), False, next_schema("op.execute('DELETE FROM sweep')"))
    with Store.open(str(path)) as again:
        assert len(again.sweeps(1)) == 1


def test_a_reader_does_not_migrate(store, path, next_schema):
    store.close()
    before = path.read_bytes()
    with pytest.raises(
        StoreError, match=f"its schema {HISTORY[-1]} is older than next; fraexp migrate --db {path} brings it up"
    ):
        check_readable(SqliteFile(path, 1.0), next_schema())
    assert path.read_bytes() == before


def test_several_processes_may_make_the_database_at_once(url):
    code = (
        "import sys; from fraexp.store import Store; Store.open(sys.argv[1], create=True).begin_run('', '', '', {}, [])"
    )
    command = [sys.executable, "-c", code, url]
    racers = [subprocess.Popen(command, cwd=ROOT) for _ in range(2)]
    assert [racer.wait() for racer in racers] == [0, 0]
    with Store.open(url) as store:
        assert [run.number for run in store.runs()] == [2, 1]


def test_opening_a_current_database_imports_nothing_slow(store, path):
    code = """
import sys
from fraexp.store import Store
with Store.open(sys.argv[1]) as store:
    store.runs()
print([name for name in ("alembic", "numba", "matplotlib", "scipy", "pydantic") if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", code, str(path)], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
