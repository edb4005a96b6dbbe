"""A real Dask cluster on this machine: scheduler and workers as processes, which tests start and kill."""

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from tests.waiting import wait_until


class Cluster:
    """A scheduler and its workers; a context manager that ends them all."""

    def __init__(self, folder: Path, worker_ttl: str = "5 minutes") -> None:
        self.folder, self.worker_ttl = folder, worker_ttl
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{self.port}"
        self.file = folder / "scheduler.json"
        self.processes: list[subprocess.Popen[bytes]] = []
        self.scheduler = self.start_scheduler()

    def start_scheduler(self) -> subprocess.Popen[bytes]:
        """Start the scheduler, and return it when it listens."""
        self.launch_scheduler()
        wait_until(self._listens)
        return self.scheduler

    def launch_scheduler(self) -> None:
        """Start the scheduler without waiting for it."""
        options = [f"--port={self.port}", "--host=127.0.0.1", "--no-dashboard", f"--scheduler-file={self.file}"]
        ttl = {"DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": self.worker_ttl}
        self.scheduler = self._start("scheduler", options, ttl)

    def start_worker(self, name: str, *options: str, environment: Mapping[str, str] | None = None) -> subprocess.Popen:
        """Start a worker with one thread, without a nanny unless told so, and return it when it is there."""
        process = self.launch_worker(name, *options, environment=environment)
        wait_until(lambda: any(worker["name"].startswith(name) for worker in self.workers().values()))
        return process

    def launch_worker(self, name: str, *options: str, environment: Mapping[str, str] | None = None) -> subprocess.Popen:
        """Start a worker without waiting for it."""
        told = [self.address, "--name", name, "--nthreads=1", "--no-dashboard", *(options or ("--no-nanny",))]
        return self._start("worker", told, environment)

    def _start(self, what: str, options: list[str], environment: Mapping[str, str] | None = None) -> subprocess.Popen:
        told = (self.folder / f"{what}{len(self.processes)}.log").open("wb")
        command = [sys.executable, "-m", "dask", what, *options]
        process = subprocess.Popen(
            command,
            cwd=self.folder,
            stdout=told,
            stderr=told,
            env={**os.environ, **(environment or {})},
            start_new_session=True,  # a group of its own, with the worker that a nanny starts
        )
        told.close()
        self.processes.append(process)
        return process

    def _listens(self) -> bool:
        with socket.socket() as attempt:
            return attempt.connect_ex(("127.0.0.1", self.port)) == 0

    def ask(self, function: Callable[..., Any]) -> Any:
        """Return what a function finds in the scheduler's process."""
        import warnings

        from distributed import Client

        warnings.simplefilter("ignore")  # a test's workers may well be of other versions
        with Client(self.address, set_as_default=False) as client:
            return client.run_on_scheduler(function)

    def workers(self) -> dict[str, Any]:
        """Return what the scheduler says of its workers."""
        return self.ask(lambda dask_scheduler: dask_scheduler.identity()["workers"])

    def tasks(self) -> int:
        """Return how many tasks the scheduler knows."""
        return self.ask(lambda dask_scheduler: len(dask_scheduler.tasks))

    def kill(self, process: subprocess.Popen) -> None:
        """End a process at once, as a crash would."""
        process.send_signal(signal.SIGKILL)
        process.wait()

    def pause(self, process: subprocess.Popen) -> None:
        """Stop a process as if it hung: its connections stay open, and it says nothing."""
        process.send_signal(signal.SIGSTOP)

    def resume(self, process: subprocess.Popen) -> None:
        """Let a stopped process go on."""
        process.send_signal(signal.SIGCONT)

    def __enter__(self) -> "Cluster":
        return self

    def __exit__(self, *_: object) -> None:
        for process in self.processes:  # asked to end, a worker would wait for its scheduler
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def distribution(folder: Path, name: str, version: str, entry_point: str = "") -> dict[str, str]:
    """Write what makes a package of this version appear to be installed; return the environment in which it does."""
    info = folder / f"{name}-{version}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    if entry_point:
        (info / "entry_points.txt").write_text(f"[fraexp]\n{entry_point}\n")
    return {"PYTHONPATH": os.pathsep.join(filter(None, [str(folder), os.environ.get("PYTHONPATH", "")]))}
