"""A PostgreSQL server of the tests' own: on a loopback port, in a temporary folder, gone when they are over."""

import os
import pwd
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.waiting import HANG_TIMEOUT_S

ACCESS = "host all guarded 127.0.0.1/32 scram-sha-256\nhost all all 127.0.0.1/32 trust\n"
SETTINGS = {"fsync": "off", "max_connections": "50", "unix_socket_directories": "", "listen_addresses": "127.0.0.1"}


def program(name: str) -> str | None:
    """Return where a program of PostgreSQL is, which Debian keeps off the path."""
    kept = sorted(Path("/usr/lib/postgresql").glob(f"*/bin/{name}"))
    return shutil.which(name) or (str(kept[-1]) if kept else None)


class Server:
    """A running server."""

    def __init__(self, port: int, start: "Callable[[], subprocess.Popen[bytes]]", log: Path) -> None:
        self.port, self.process = port, start()
        self._start, self._log = start, log
        self._made = 0
        wait_for_server(self, log)

    def stop(self) -> None:
        """End the server as quickly as it can."""
        self.process.send_signal(signal.SIGQUIT)
        self.process.wait(HANG_TIMEOUT_S)

    def start(self) -> None:
        """Start the server again on the same port."""
        self.process = self._start()
        wait_for_server(self, self._log)

    def cut_connections(self) -> int:
        """End all connections of others, and return their number."""
        others = "pid <> pg_backend_pid() AND backend_type = 'client backend'"
        return len(self.sql(f"SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE {others}"))

    def url(self, database: str = "postgres", user: str = "tester") -> str:
        """Return the URL of a database."""
        return f"postgresql://{user}@127.0.0.1:{self.port}/{database}"

    def sql(self, statement: str, database: str = "postgres") -> list[tuple]:
        """Run a statement of the server's owner."""
        import psycopg

        with psycopg.connect(self.url(database), autocommit=True) as connection:
            done = connection.execute(statement)
            return done.fetchall() if done.description else []

    def new(self) -> str:
        """Make an empty schema, which serves as a database and is quicker to make, and return its URL."""
        self._made += 1
        self.sql(f"CREATE SCHEMA s{self._made}")
        return f"{self.url()}?options=-csearch_path%3Ds{self._made}"


@contextmanager
def running() -> Iterator[Server]:
    """Start a server; skip the test where there is none."""
    pytest.importorskip("psycopg", reason="needs psycopg: pip install 'psycopg[binary]'")
    initdb, postgres = program("initdb"), program("postgres")
    if not (initdb and postgres):
        pytest.skip("needs a PostgreSQL server to start: initdb and postgres (Debian: postgresql)")
    folder = Path(tempfile.mkdtemp(prefix="fraexp-postgresql-"))
    other: dict = {"cwd": folder}
    if os.geteuid() == 0:  # as which the server does not run
        nobody = pwd.getpwnam("nobody")
        os.chown(folder, nobody.pw_uid, nobody.pw_gid)
        other |= {"user": nobody.pw_uid, "group": nobody.pw_gid, "extra_groups": ()}
    data = folder / "data"
    with (folder / "log").open("wb") as log:
        making = [initdb, "-D", str(data), "-U", "tester", "--no-sync", "--auth=trust", "--encoding=UTF8", "--locale=C"]
        subprocess.run(making, check=True, stdout=log, stderr=log, **other)
        (data / "pg_hba.conf").write_text(ACCESS)
        with socket.socket() as found:
            found.bind(("127.0.0.1", 0))
            port = found.getsockname()[1]
        settings = [f"--{name}={value}" for name, value in SETTINGS.items()]
        command = [postgres, "-D", str(data), "-p", str(port), *settings]
        started: list[subprocess.Popen[bytes]] = []

        def start() -> "subprocess.Popen[bytes]":
            started.append(subprocess.Popen(command, stdout=log, stderr=log, **other))
            return started[-1]

        try:
            yield Server(port, start, folder / "log")
        finally:
            for process in started:
                process.send_signal(signal.SIGQUIT)  # its fastest way to end
                process.wait(HANG_TIMEOUT_S)
            shutil.rmtree(folder, ignore_errors=True)


def wait_for_server(server: Server, log: Path) -> None:
    """Return as soon as a server answers."""
    import psycopg

    deadline = time.monotonic() + HANG_TIMEOUT_S
    while True:
        try:
            server.sql("SELECT 1")
            return
        except psycopg.OperationalError:
            if server.process.poll() is not None or time.monotonic() > deadline:
                raise RuntimeError(f"the server did not start: {log.read_text()}") from None
            time.sleep(0.05)
