"""Disturb the databases of runs, and check that each run completes by itself with the bits of an undisturbed one.

    python benchmarks/outages.py             120 sweeps; server restarted 10 times, connections cut 50 times,
                                             SQLite locked for 60 s, a run paused for 75 s, a full disk
    python benchmarks/outages.py --quick     30 sweeps; 2 restarts, 6 cuts, locked for 15 s; no pause

Runs are ``fraexp run`` processes on a PostgreSQL server of the benchmark's own, or on a SQLite file. Each case prints
what was done, and its findings: a run that does not complete by itself, a sweep that is not computed exactly once, a
lease that is left, a result that differs in a bit. The moments are drawn from ``--seed``. Linux only. Exit code 1 on
any finding.
"""

import argparse
import random
import resource
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from fraexp.data.results import Result
from fraexp.store import Store
from tests.postgresql import Server, running

STUDY = """
title = "Short sweeps"
machine = "linear_motor_table"
[[case]]
label = "conventional"
excitation = {{ name = "stepped_sine", points = 60, min_frequency = 0.1, amplitude = 75 }}
estimator = {{ name = "conventional" }}
[grid]
"friction.curve.coulomb_force" = {values}
"""
END_TIMEOUT_S = 900.0
DISK_BYTES = 700_000
PAUSE_S = 75.0
"""Pause of a scheduler, longer than the lease of 60 s."""


@dataclass(frozen=True)
class Bench:
    """A workspace with a study, and the database of an undisturbed run."""

    folder: Path
    sweeps: int
    draw: random.Random

    @property
    def reference(self) -> str:
        return str(self.folder / "reference.db")

    def start(self, database: str, **more: object) -> "subprocess.Popen[str]":
        command = [sys.executable, "-m", "fraexp", "run", "outages", "--executor=processes:1", f"--db={database}"]
        pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
        return subprocess.Popen(command, cwd=self.folder, **pipes, **more)  # type: ignore[call-overload, no-any-return]

    def done(self, database: str) -> int:
        """Return how many sweeps have a result."""
        with Store.open(database, read_only=True) as store:
            return sum(run.computed for run in store.runs())

    def wait_for(self, database: str, count: int, process: "subprocess.Popen[str]") -> bool:
        """Wait until some sweeps are computed; return whether the run still goes on."""
        while process.poll() is None:
            if Store.exists(database) and self.done(database) >= count:
                return True
            time.sleep(0.05)
        return False


def finish(process: "subprocess.Popen[str]", expected: int = 0) -> Iterator[str]:
    """Wait for the end of a run; yield a finding if its exit code is another one."""
    _, said = process.communicate(timeout=END_TIMEOUT_S)
    lines = [line for line in said.splitlines() if "database" in line or "took over" in line]
    print(f"    said {len(lines)} lines about the database" + (f", such as: {lines[0][-150:]}" if lines else ""))
    if process.returncode != expected:
        yield f"exit code {process.returncode}, expected {expected}: {said[-400:]}"


def audit(bench: Bench, database: str) -> Iterator[str]:
    """Yield what is wrong in a database at the end."""
    with Store.open(bench.reference, read_only=True) as peace, Store.open(database, read_only=True) as store:
        keys = peace.keys()
        states = Counter(
            sweep.key for run in store.runs() for sweep in store.sweeps(run.number) if sweep.state == "computed"
        )
        if states != Counter(keys):
            yield f"{len(states)} of {len(keys)} sweeps are computed, {sum(states.values())} times in all"
        if leases := store.leases():
            yield f"leases are left: {leases}"
        open_runs = [run.number for run in store.runs() if run.state == "running"]
        if open_runs:
            yield f"runs seem to go on: {open_runs}"
        expected, found = peace.results(keys), store.results(keys)
        differing = [key for key in keys if key not in found or bits(found[key]) != bits(expected[key])]
        if differing:
            yield f"{len(differing)} results differ from those of an undisturbed run"


def bits(result: Result) -> list[object]:
    """Return all numbers of a result, bit for bit."""
    arrays = [column for curve in result.curves for column in curve.columns.values()]
    if result.response:
        arrays += [value for value in vars(result.response).values() if isinstance(value, np.ndarray)]
    metrics = [(metric.name, np.float64(metric.value).tobytes()) for metric in result.metrics]
    return [result.outcome, result.message, metrics, [array.tobytes() for array in arrays]]


def restarted(bench: Bench, server: Server, times: int) -> Iterator[str]:
    """Restart a server during a run: down for up to five seconds each time."""
    database, count = server.new(), 0
    process = bench.start(database)
    while count < times and bench.wait_for(database, (count + 1) * bench.sweeps // (times + 2), process):
        server.stop()
        time.sleep(bench.draw.uniform(0, 5))
        server.start()
        count += 1
    print(f"    server restarted {count} times")
    if count < times:
        yield f"the run ended after {count} restarts"
    yield from finish(process)
    yield from audit(bench, database)


def cut(bench: Bench, server: Server, times: int) -> Iterator[str]:
    """Cut the connections of two runs at random moments."""
    database, count = server.new(), 0
    processes = [bench.start(database) for _ in range(2)]
    bench.wait_for(database, 1, processes[0])
    while count < times and any(process.poll() is None for process in processes):
        count += server.cut_connections()
        time.sleep(bench.draw.uniform(0, 0.4))
    print(f"    {count} connections cut")
    if count < times:
        yield f"the runs ended after {count} cuts"
    for process in processes:
        yield from finish(process)
    yield from audit(bench, database)


def locked(bench: Bench, seconds: float) -> Iterator[str]:
    """Lock a SQLite file during a run."""
    database = bench.folder / "locked.db"
    process = bench.start(str(database))
    bench.wait_for(str(database), bench.sweeps // 3, process)
    with closing(sqlite3.connect(database, isolation_level=None, timeout=30)) as connection:
        connection.execute("BEGIN IMMEDIATE")
        time.sleep(seconds)
        connection.execute("ROLLBACK")
    print(f"    locked for {seconds:.0f} s")
    yield from finish(process)
    yield from audit(bench, str(database))


def paused(bench: Bench) -> Iterator[str]:
    """Pause the scheduler of one of two runs for longer than its lease."""
    database = str(bench.folder / "paused.db")
    sleeper = bench.start(database)
    bench.wait_for(database, bench.sweeps // 4, sleeper)
    sleeper.send_signal(signal.SIGSTOP)
    other = bench.start(database)
    time.sleep(PAUSE_S)
    with Store.open(database, read_only=True) as store:
        print(f"    paused for {PAUSE_S:.0f} s; silent for {max(run.silence for run in store.runs()):.0f} s")
    sleeper.send_signal(signal.SIGCONT)
    for process in (sleeper, other):
        yield from finish(process)
    yield from audit(bench, database)


def full(bench: Bench) -> Iterator[str]:
    """Run out of disk space, then run again with enough of it."""
    database = str(bench.folder / "full.db")
    limits = (DISK_BYTES, DISK_BYTES)
    process = bench.start(database, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, limits))
    _, said = process.communicate(timeout=END_TIMEOUT_S)
    print(f"    exit code {process.returncode}: {said.splitlines()[-1][-200:]}")
    if process.returncode == 0:
        yield "the disk was not full; compute more sweeps"
    if "Traceback" in said:
        yield f"a traceback: {said[-400:]}"
    yield from finish(bench.start(database))
    yield from audit(bench, database)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--case", action="append", help="restarted, cut, locked, paused or full; by default all")
    arguments = parser.parse_args()
    sweeps, restarts, cuts, seconds = (30, 2, 6, 15.0) if arguments.quick else (120, 10, 50, 60.0)
    found = 0
    with tempfile.TemporaryDirectory(prefix="fraexp-outages-") as name, running() as server:
        folder = Path(name)
        (folder / "studies").mkdir()
        values = [float(value) for value in np.linspace(10.0, 20.0, sweeps)]
        (folder / "studies" / "outages.toml").write_text(STUDY.format(values=values))
        bench = Bench(folder, sweeps, random.Random(arguments.seed))
        for finding in finish(bench.start(bench.reference)):
            raise SystemExit(f"the undisturbed run fails: {finding}")
        cases: dict[str, Callable[[], Iterator[str]]] = {
            "restarted": lambda: restarted(bench, server, restarts),
            "cut": lambda: cut(bench, server, cuts),
            "locked": lambda: locked(bench, seconds),
            "paused": lambda: paused(bench),
            "full": lambda: full(bench),
        }
        chosen = arguments.case or [case for case in cases if not (arguments.quick and case == "paused")]
        for case in chosen:
            print(f"{case}:", flush=True)
            findings = list(cases[case]())
            found += len(findings)
            print(*(f"    {finding}" for finding in findings or ["complete, each sweep once, bits equal"]), sep="\n")
    print(f"{found} findings")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
