"""What a server can do that a file cannot: refuse, be shared by hosts, need a password; and the commands on one."""

import signal
from urllib.parse import quote

import pytest

from fraexp.cli.main import main
from fraexp.data.sweep import Sweep
from fraexp.errors import StoreError
from fraexp.store import Store, masked_url
from fraexp.store.backends.postgresql import WRITE_LOCK_ID
from tests.postgresql import running
from tests.refusals import refused
from tests.waiting import HANG_TIMEOUT_S

pytestmark = pytest.mark.thorough
SECRET = "s3/cr@t word"
FEW = ("--set", "excitation.points=3", "--set", "excitation.min_frequency=20")


@pytest.fixture
def base(server):
    return server.new()


@pytest.fixture
def guarded(server):
    """A database whose user needs a password."""
    if not server.sql("SELECT 1 FROM pg_roles WHERE rolname = 'guarded'"):
        server.sql(f"CREATE ROLE guarded LOGIN PASSWORD '{SECRET}'")
        server.sql("CREATE DATABASE guarded OWNER guarded")
    return server.url("guarded", f"guarded:{quote(SECRET, safe='')}")


def check_refused(url: str, *names: str, **options) -> None:
    with refused(StoreError, *names) as caught:
        Store.open(url, timeout=0.5, **options)
    assert SECRET not in str(caught.value)
    assert "wrong-secret" not in str(caught.value)


def test_what_keeps_us_out_is_one_line_without_the_password(server, guarded):
    check_refused("postgresql://u:wrong-secret@127.0.0.1:1/d", "u:***@127.0.0.1:1/d", "port")
    check_refused(server.url("guarded", "guarded:wrong-secret"), "user and password")
    check_refused(server.url("guarded", "guarded"), "~/.pgpass")
    check_refused(server.url("absent"), "absent", "createdb")
    check_refused(server.url(user="stranger"), "stranger")
    check_refused("postgresql://u:wrong-secret@127.0.0.1", "database", "postgresql://")
    check_refused("postgresql://u:wrong-secret@127.0.0.1:port/d", "URL", "postgresql://")
    check_refused("oracle://u:wrong-secret@h/d", "oracle://u:***@h/d")


@pytest.mark.parametrize(
    "url, told",
    [
        ("postgresql://u:a@b:c/d@h:5/b", "postgresql://u:***@h:5/b"),
        ("postgresql://u@h/b", "postgresql://u@h/b"),
        ("postgresql://h/b?user=u&password=p%20q&x=1", "postgresql://h/b?user=u&password=***&x=1"),
        ("see postgresql://u:x@h/b now", "see postgresql://u:***@h/b now"),
        ("results.db", "results.db"),
    ],
)
def test_a_password_is_not_shown(url, told):
    assert masked_url(url) == told


def test_an_empty_database_becomes_ours_and_another_programs_does_not(server, base):
    check_refused(base, "fraexp run STUDY")
    check_refused(base, "fraexp run STUDY", read_only=True)
    assert not Store.exists(base)
    Store.open(base, create=True).close()
    assert Store.exists(base)
    foreign = server.new()
    schema = foreign.rpartition("%3D")[2]
    server.sql(f"CREATE TABLE {schema}.photos (name text)")
    check_refused(foreign, "'photos'", create=True)


def test_a_reader_cannot_write_and_a_user_without_rights_is_told(server, base):
    Store.open(base, create=True).close()
    with Store.open(base, read_only=True) as reader, refused(StoreError, "reading only"):
        reader.begin_run("s", "f", "c", {}, [])
    schema = base.rpartition("%3D")[2]
    if not server.sql("SELECT 1 FROM pg_roles WHERE rolname = 'looker'"):
        server.sql("CREATE ROLE looker LOGIN")
    server.sql(f"GRANT USAGE ON SCHEMA {schema} TO looker")
    server.sql(f"GRANT SELECT ON ALL TABLES IN SCHEMA {schema} TO looker")
    looking = base.replace("tester@", "looker@")
    with Store.open(looking) as store, refused(StoreError, "user"):
        store.begin_run("s", "f", "c", {}, [])
    with Store.open(looking, read_only=True) as store:
        assert store.runs() == []


def test_a_writer_that_does_not_end_is_told_and_does_not_stop_the_heart(server, base):
    import psycopg

    with Store.open(base, create=True, timeout=0.3) as store:
        run = store.begin_run("s", "f", "c", {}, [])
        with psycopg.connect(server.url()) as other:
            other.execute(f"SELECT pg_advisory_xact_lock({WRITE_LOCK_ID})")
            store.beat(run)
            with refused(StoreError, "another run"):
                store.begin_run("s", "f", "c", {}, [])
        assert store.begin_run("s", "f", "c", {}, []) > run


def test_another_schema_is_left_alone(base, server):
    Store.open(base, create=True).close()
    server.sql(f"UPDATE {base.rpartition('%3D')[2]}.fraexp_schema SET number = 99")
    check_refused(base, "schema 99", create=True)


def test_a_store_survives_a_restart_of_the_server(sweep):
    with running() as server:
        url = server.new()
        with Store.open(url, create=True, timeout=HANG_TIMEOUT_S) as store:
            store.begin_run("s", "f", "c", {}, [sweep()])
            server.sql("SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE application_name = 'fraexp'")
            assert store.begin_run("s", "f", "c", {}, [sweep()]) == 2
            server.process.send_signal(signal.SIGINT)
            server.process.wait(HANG_TIMEOUT_S)
            with refused(StoreError, "server"):
                store.runs()


def test_the_commands_work_on_a_server_and_keep_its_password(server, guarded, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    told = ""
    for arguments in (
        ("run", "quick", *FEW, "--dry-run"),
        ("run", "quick", *FEW, "--executor", "serial"),
        ("run", "quick", *FEW, "--json"),
        ("list",),
        ("list", "estimator=conventional", "excitation.amplitude>=75N", "--sort", "-elapsed"),
        ("show", "1"),
        ("show", "1", "--json"),
        ("compare", "1", "2"),
        ("plot", "1", "-o", "figure.png"),
        ("tag", "1", "baseline"),
        ("list", "tag:baseline", "--json"),
        ("doctor", "--json"),
        ("merge", guarded, "--db", "copy.db"),
        ("merge", guarded, "--db", "copy.db", "--json"),
        ("list", "--db", f"{guarded}x"),
    ):
        db = () if "--db" in arguments else ("--db", guarded)
        code, said = main([*arguments, *db]), "".join(capsys.readouterr())
        assert code == (3 if arguments[-1].endswith("x") else 0), (arguments, said)
        told += said
    assert (tmp_path / "figure.png").stat().st_size > 1000
    dump = (tmp_path / "copy.db").read_bytes().decode("latin-1")
    for text in (told, dump, str(server.sql("SELECT command, provenance FROM run", "guarded"))):
        assert SECRET not in text
        assert quote(SECRET, safe="") not in text
    with Store.open(str(tmp_path / "copy.db"), read_only=True) as copy, Store.open(guarded, read_only=True) as store:
        assert [run.state for run in copy.runs()] == [run.state for run in store.runs()] == ["complete", "complete"]
        row, _ = store.page("estimator=conventional state:reused", "-excitation.amplitude").rows
        assert repr(copy.result(row.key)) == repr(store.result(row.key))
        assert isinstance(copy.find(row.key).experiment, dict)
        assert Sweep(copy.find(row.key).experiment, copy.find(row.key).estimator).key == row.key
