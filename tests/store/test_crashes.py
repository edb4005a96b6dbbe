"""Runs whose disk, folder, clock or neighbours fail them: one line, an exit code, and nothing stored is lost."""

import json
import os
import resource
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import psutil
import pytest

from fraexp.cli.exits import ExitCode
from fraexp.errors import StoreError
from fraexp.store import Store
from fraexp.store.backends.sqlite import SqliteFile
from fraexp.store.tables import SCHEMA_NUMBER
from tests.refusals import refused
from tests.trouble import study
from tests.waiting import HANG_TIMEOUT_S, wait_until

pytestmark = [
    pytest.mark.thorough,
    pytest.mark.skipif(sys.platform != "linux", reason="needs the limits and mounts of Linux"),
]
ROOT = Path(__file__).parents[2]
PLUGIN = '''
import time
import numpy as np
from fraexp.api import Curve, Estimator, Outcome, Result


class Bulky(Estimator, name="bulky", version=1):
    """Takes a moment, and gives a curve that takes room."""

    def estimate(self, signals):
        """Return noise that follows from the signals."""
        time.sleep(0.02)
        peak = float(np.max(signals.segments[0].channels["displacement"]))
        noise = np.random.default_rng(round(peak * 1e9)).normal(size=4000)
        return Result(Outcome.OK, curves=(Curve("noise", {"y": noise}, {"y": "m"}),))
'''
SWEEPS = 60
CONSOLE = "from fraexp.cli.main import console; console()"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A workspace with a study of sweeps of 32 kB each."""
    (tmp_path / "plugins").mkdir()
    (tmp_path / "plugins" / "bulky.py").write_text(PLUGIN, encoding="utf-8")
    (tmp_path / "studies").mkdir()
    told = study(SWEEPS).replace('"trivial"', '"bulky"')
    (tmp_path / "studies" / "bulky.toml").write_text(told, encoding="utf-8")
    return tmp_path


def command(*arguments: str, before: str = "") -> list[str]:
    """Return a command line of fraexp; `before` is what its process does first."""
    return [sys.executable, "-c", f"{before}\n{CONSOLE}", *arguments]


def environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": f"{ROOT}:{ROOT / 'plugins'}"}


def fraexp(folder: Path, *arguments: str, before: str = "", **more: Any) -> subprocess.CompletedProcess[str]:
    line = command(*arguments, before=before)
    pipes = {"capture_output": True, "text": True, "timeout": HANG_TIMEOUT_S}
    return subprocess.run(line, cwd=folder, env=environment(), check=False, **pipes, **more)


def stored(path: Path) -> int:
    """Return how many results there are."""
    if not path.exists():
        return 0
    with closing(sqlite3.connect(f"{path.as_uri()}?mode=ro", uri=True, timeout=20)) as connection:
        return int(connection.execute("SELECT count(*) FROM sweep WHERE outcome IS NOT NULL").fetchone()[0])


@contextmanager
def under_way(folder: Path, *arguments: str, before: str = "") -> Iterator["subprocess.Popen[str]"]:
    """Start a run and wait until it has stored something."""
    line = command("run", "bulky", "--executor=processes:1", *arguments, before=before)
    process = subprocess.Popen(line, cwd=folder, env=environment(), stderr=subprocess.PIPE, text=True)
    try:
        wait_until(lambda: stored(folder / "results.db") > 0 or process.poll() is not None)
        assert process.poll() is None
        yield process
    finally:
        process.kill()
        process.communicate()  # closes the pipe


def told(text: str) -> str:
    """Return the one line in which a run says why it has ended."""
    assert "Traceback" not in text
    lines = [line for line in text.splitlines() if line.startswith("fraexp: ")]
    assert len(lines) == 1, text
    return lines[0]


def goes_on(folder: Path, path: Path) -> None:
    """Check that a database is sound, tells the truth, and that the same command completes it."""
    with Store.open(str(path), read_only=True) as store:
        assert store.health() == "sound"
        assert {run.state for run in store.runs()} <= {"interrupted", "partial"}
    kept = stored(path)
    done = fraexp(folder, "run", "bulky", "--json", f"--db={path}")
    assert done.returncode == ExitCode.OK, done.stderr
    run = json.loads(done.stdout)["runs"][0]
    assert (run["state"], run["reused"], run["computed"]) == ("complete", kept, SWEEPS - kept)
    complete_once(path)


def complete_once(path: Path) -> None:
    with closing(sqlite3.connect(path)) as connection:
        assert connection.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        assert connection.execute("PRAGMA foreign_key_check").fetchall() == []
        assert connection.execute("SELECT count(*) FROM lease").fetchone() == (0,)
        times = connection.execute("SELECT count(*) FROM run_sweep WHERE state = 'computed' GROUP BY key").fetchall()
    assert times == [(1,)] * SWEEPS


@contextmanager
def immutable(*paths: Path) -> Iterator[None]:
    """Take the right to write to files and folders from everybody, root and those that have opened them included."""
    changed = (
        subprocess.run(["chattr", "+i", *paths], capture_output=True, check=False) if shutil.which("chattr") else None
    )
    try:
        if changed is None or changed.returncode:
            pytest.skip("needs root, and a file system with chattr +i")
        yield
    finally:
        if changed is not None:
            subprocess.run(["chattr", "-i", *paths], capture_output=True, check=False)


def test_a_limit_on_the_size_of_files_ends_a_run_and_the_next_goes_on(folder):
    limit = 1_000_000
    ended = fraexp(folder, "run", "bulky", preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)))
    assert ended.returncode == ExitCode.STORE
    assert "the disk is full or fails" in told(ended.stderr)
    assert 0 < stored(folder / "results.db") < SWEEPS
    goes_on(folder, folder / "results.db")


def test_a_full_disk_ends_a_run_and_the_next_goes_on_where_there_is_room(folder):
    (folder / "small").mkdir()
    (folder / "saved").mkdir()
    line = " ".join(f"'{part}'" for part in (sys.executable, "-m", "fraexp", "run", "bulky", "--db=small/results.db"))
    script = (
        f"mount -t tmpfs -o size=1500k none small || exit 99\n{line}\ncode=$?\ncp small/results.db* saved\nexit $code"
    )
    ended = subprocess.run(
        ["unshare", "-m", "sh", "-c", script],
        cwd=folder,
        env=environment(),
        capture_output=True,
        text=True,
        check=False,
    )
    if ended.returncode == 99 or "unshare" in ended.stderr:
        pytest.skip("needs the right to mount a small file system")
    assert ended.returncode == ExitCode.STORE, ended.stderr
    assert "the disk is full" in told(ended.stderr)
    (folder / "saved" / "results.db-shm").unlink(missing_ok=True)
    assert 0 < stored(folder / "saved" / "results.db") < SWEEPS
    goes_on(folder, folder / "saved" / "results.db")


def test_a_database_that_becomes_read_only_ends_a_run_and_the_next_goes_on(folder):
    path = folder / "results.db"
    with under_way(folder) as process:
        with immutable(path, Path(f"{path}-wal")):
            _, text = process.communicate(timeout=HANG_TIMEOUT_S)
        assert process.returncode == ExitCode.STORE
        assert told(text)
    goes_on(folder, path)


def test_a_log_folder_without_the_right_to_write_is_told(folder):
    (folder / ".fraexp").touch()  # a file where the folder should be: nobody can write there
    ended = fraexp(folder, "run", "bulky", "--detach")
    assert ended.returncode == ExitCode.USAGE
    assert "the run cannot be started" in told(ended.stderr)
    assert not (folder / "results.db").exists()


IMPATIENT = "from fraexp.store import Store; Store.open.__func__.__kwdefaults__['timeout'] = 1.0"


def test_a_database_that_somebody_locks_for_too_long_ends_a_run_and_the_next_goes_on(folder):
    path = folder / "results.db"
    with under_way(folder, "--database-timeout=3s", before=IMPATIENT) as process:
        with closing(sqlite3.connect(path, isolation_level=None, timeout=HANG_TIMEOUT_S)) as other:
            other.execute("BEGIN IMMEDIATE")
            _, text = process.communicate(timeout=HANG_TIMEOUT_S)
            other.execute("ROLLBACK")
        assert process.returncode == ExitCode.STORE
        assert "the database is locked by another process that writes; wait until it has ended" in told(text)
    goes_on(folder, path)


JUMPING = """
import datetime as module, itertools
import fraexp.store.liveness as liveness

class Jumping(module.datetime):
    jumps = itertools.cycle([0, 86400, -86400, 3600, -90, 90, -7200])

    @classmethod
    def now(cls, zone=None):
        return module.datetime.now(zone) + module.timedelta(seconds=next(cls.jumps))

liveness.datetime = Jumping
"""


def test_two_runs_whose_clock_jumps_compute_the_same_as_one_in_peace(folder):
    line = command("run", "bulky", "--executor=processes:1", before=JUMPING)
    pipes = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
    both = [subprocess.Popen(line, cwd=folder, env=environment(), **pipes) for _ in range(2)]
    for process in both:
        _, text = process.communicate(timeout=HANG_TIMEOUT_S)
        assert process.returncode == ExitCode.OK, text
    for run in json.loads(fraexp(folder, "list", "--json", before=JUMPING).stdout)["runs"]:
        assert run["state"] == "complete"
        assert run["ended"] >= run["started"]
    assert fraexp(folder, "run", "bulky", "--db=peace.db").returncode == ExitCode.OK
    results = []
    for path in (folder / "results.db", folder / "peace.db"):
        with closing(sqlite3.connect(path)) as connection:
            assert connection.execute("SELECT count(*) FROM lease").fetchone() == (0,)
            results.append(connection.execute("SELECT * FROM curve_column ORDER BY key").fetchall())
    assert len(results[0]) == SWEEPS
    assert results[0] == results[1]


def mount_code(folder: Path, system: str) -> str:
    """Return Python code after which a folder lies on a file system of a given type."""
    mounts = [("/", "ext4"), (str(folder.resolve()), system)]
    return (
        "import psutil; from types import SimpleNamespace as Mount; "
        f"psutil.disk_partitions = lambda all: [Mount(mountpoint=at, fstype=of) for at, of in {mounts!r}]"
    )


def mount(monkeypatch: pytest.MonkeyPatch, folder: Path, system: str) -> None:
    """Have a folder lie on a file system of a given type."""
    monkeypatch.setattr(psutil, "disk_partitions", psutil.disk_partitions)  # which is put back at the end
    exec(mount_code(folder, system), {})  # one name space, where the lambda finds its names


def test_on_a_network_file_system_a_run_says_so_and_writes_without_a_log(folder):
    done = fraexp(folder, "run", "bulky", "--executor=processes:1", before=mount_code(folder, "nfs4"))
    assert done.returncode == ExitCode.OK, done.stderr
    (line,) = [line for line in done.stderr.splitlines() if "network" in line]
    assert "results.db: it lies on a network file system (nfs4)" in line
    assert "put it on a local disk with --db, or use a server" in line
    with closing(sqlite3.connect(folder / "results.db")) as connection:
        assert connection.execute("PRAGMA journal_mode").fetchone() == ("delete",)
    assert not list(folder.glob("results.db-*"))
    complete_once(folder / "results.db")


def test_a_database_that_moves_to_a_network_file_system_and_back_changes_its_way(store, path, monkeypatch, tmp_path):
    store.close()
    modes = []
    for system in ("ext4", "nfs4", "ext4", "cifs", "fuse.sshfs"):
        mount(monkeypatch, tmp_path, system)
        with Store.open(str(path)) as writer:
            writer.begin_run("s", "f", "c", {}, [])
            with Store.open(str(path), read_only=True) as reader, refused(StoreError, path, "reading only"):
                reader.begin_run("s", "f", "c", {}, [])
        with closing(sqlite3.connect(path)) as connection:
            modes += connection.execute("PRAGMA journal_mode").fetchone()
    assert modes == ["wal", "delete", "wal", "delete", "delete"]
    assert len(Store.open(str(path)).runs()) == 5


HALF_DONE = """
import sqlite3, sys
connection = sqlite3.connect(sys.argv[1], isolation_level=None)
connection.execute("PRAGMA cache_size = 1")  # so that pages reach the file before the end
connection.execute("BEGIN IMMEDIATE")
connection.execute("UPDATE fraexp_schema SET number = 99")
connection.execute("UPDATE run SET command = hex(zeroblob(2000000)), study = 'half-done'")
print("ready", flush=True)
sys.stdin.read()
"""


@pytest.mark.parametrize("options", [{}, {"read_only": True}])
def test_what_a_killed_writer_left_half_done_with_a_journal_is_undone(path, monkeypatch, tmp_path, program, options):
    mount(monkeypatch, tmp_path, "nfs4")
    with Store.open(str(path), create=True) as store:
        store.begin_run("s", "f", "c", {}, [])
    with program(HALF_DONE, path) as process:
        assert Path(f"{path}-journal").stat().st_size > 512
        process.kill()
        process.wait()
    with Store.open(str(path), **options) as store:
        assert [run.study for run in store.runs()] == ["s"]
        assert store.health() == "sound"
    assert SqliteFile(path, 1.0).schema_number() == SCHEMA_NUMBER
