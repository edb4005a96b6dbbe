"""Kill, pause and restart the scheduler and the workers of a Dask cluster at random, and check every result.

    python benchmarks/dask_torture.py             12 histories of 5 disturbances, and the time that Ctrl-C takes
    python benchmarks/dask_torture.py --quick     1 history of 3, without Ctrl-C

In each history ``fraexp run`` computes 48 short sweeps on a cluster of two workers, real processes all of them, into a
database of its own. At random moments the scheduler or a worker is killed (SIGKILL), asked to end (SIGTERM) or hangs
with its connections open (SIGSTOP), or a worker with other code joins. What has died comes back after a random time,
what hangs goes on or dies; some schedulers stay away, or silent, for longer than the run waits (30 s here). Each run
must complete by itself, or end with one line that says why and complete when it is run again. Then there must be every
result, computed once; a sound database; no lease; no run that seems to go on; and bit for bit the numbers of a run in
one process. The moments are drawn from ``--seed``; what happens between them is up to the machine. Then Ctrl-C is
pressed in each state in which a run waits, and must be obeyed within a second of the process's own time. Linux only.
Exit code 1 on any finding.
"""

import argparse
import itertools
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import fraexp
from tests.dask_cluster import Cluster
from tests.waiting import wait_until

PLUGIN = '''
import time
from pathlib import Path

from fraexp.api import Estimator, Metric, Outcome, Result, param


class Unhurried(Estimator, name="unhurried", version=1):
    """Takes its time, without computing."""

    seconds: float = param("s", "time that it takes", 0.0)

    def estimate(self, signals):
        """Return the greatest friction force."""
        Path("began").touch()
        time.sleep(self.seconds)
        peak = float(signals.segments[0].channels["friction"].max())
        return Result(Outcome.OK, metrics=(Metric("peak", peak, "N"),))
'''
STUDY = """
title = "Short sweeps"
[loop]
sample_time = 500e-6
[friction]
name = "dahl"
stiffness = 3.9e5
coulomb_force = 17.9
[excitation]
name = "displacement_sine"
frequency = 10.0
[[case]]
label = "unhurried"
estimator = {{ name = "unhurried", seconds = {seconds} }}
[[case]]
label = "hysteresis"
estimator = {{ name = "hysteresis" }}
[grid]
"excitation.amplitude" = {values}
"""
SWEEPS = 48
RUN_TIMEOUT_S = 30.0
"""Time for which the tortured runs wait for a scheduler, or for workers."""
HANG_TIMEOUT_S = 300.0
"""Time after the last repair in which a run must have ended, on a machine that is busy."""
LONG_SHARE = 0.2
"""Share of the scheduler's absences that last longer than the run waits."""
EARLY_SHARE = 0.2
"""Share of the histories that are disturbed while the run starts."""
INCOMPLETE = 1
KINDS = ("kill worker", "pause worker", "end worker", "kill scheduler", "pause scheduler", "wrong worker")
ENDINGS = ("was silent for", "was gone for", "had no worker for", "can compute this study", "no Dask scheduler answers")
"""What a run says that gives up."""
QUESTIONS = (
    "SELECT key, outcome, message, numerics FROM sweep ORDER BY key",
    *(f"SELECT * FROM {table} ORDER BY 1, 2, 3" for table in ("metric", "curve", "curve_column", "fit")),
)
STATES: dict[str, tuple[str, ...]] = {
    "all well": (),
    "scheduler silent": ("pause scheduler",),
    "scheduler gone": ("kill scheduler",),
    "worker silent": ("pause worker",),
    "no workers": ("kill worker",),
    "all silent": ("pause scheduler", "pause worker"),
}
OBEYED_S = 1.0
"""Time in which Ctrl-C must be obeyed; on a busy machine, of the process's own time."""


@dataclass
class Tally:
    """What happened in all histories."""

    given: Counter[str] = field(default_factory=Counter)
    ends: Counter[str] = field(default_factory=Counter)
    heard: Counter[str] = field(default_factory=Counter)
    findings: list[str] = field(default_factory=list)


class History:
    """One run on a cluster that is disturbed."""

    def __init__(self, folder: Path, cluster: Cluster, blows: int, seed: str, tally: Tally) -> None:
        self.folder, self.cluster, self.tally, self.name = folder, cluster, tally, seed
        self.draw = random.Random(seed)
        self.blows = [self.draw.choice(KINDS) for _ in range(blows)]
        self.workers: dict[str, subprocess.Popen[bytes]] = {}
        self.repairs: list[tuple[float, Callable[[], None]]] = []
        self.number = itertools.count()
        self.database = folder / f"{seed.replace(' ', '-')}.db"

    def go(self) -> None:
        """Run, disturb and repair until the run has ended; run again if it gave up; check the database."""
        self.restore()
        process, told = self.start()
        if self.draw.random() > EARLY_SHARE:
            while process.poll() is None and not self.has_begun():
                time.sleep(0.05)
        for blow in self.blows:
            self.attend(process, time.monotonic() + self.draw.uniform(0.5, 8.0))
            if process.poll() is None:
                self.strike(blow)
        self.attend(process, time.monotonic() + HANG_TIMEOUT_S)
        if process.poll() is None:
            self.tally.findings.append(f"{self.name}: the run hangs: {told.read_text()[-300:]!r}")
            process.kill()
        self.note_end(process.wait(), told.read_text())
        self.restore()
        process, told = self.start()  # which finds all computed, or computes the rest
        if process.wait() != 0:
            self.tally.findings.append(f"{self.name}: run again, it ends with {told.read_text()[-300:]!r}")

    def start(self) -> tuple["subprocess.Popen[bytes]", Path]:
        told = self.folder / f"{self.name.replace(' ', '-')}-{next(self.number)}.txt"
        with told.open("wb") as stream:
            return start_run(self.folder, self.cluster, self.database, stream), told

    def has_begun(self) -> bool:
        """Return whether a result is stored."""
        with suppress(sqlite3.OperationalError):  # there is no database yet
            return bool(rows(self.database, "SELECT 1 FROM sweep WHERE outcome IS NOT NULL LIMIT 1"))
        return False

    def attend(self, process: "subprocess.Popen[bytes]", until: float) -> None:
        """Repair what is due, until a time or until the run has ended."""
        while time.monotonic() < until and process.poll() is None:
            for repair in [repair for repair in self.repairs if repair[0] <= time.monotonic()]:
                self.repairs.remove(repair)
                repair[1]()
            if not self.repairs:
                self.revive()
            time.sleep(0.05)

    def later(self, longest: float, repair: Callable[[], None], least: float = 0.0) -> None:
        self.repairs.append((time.monotonic() + self.draw.uniform(least, longest), repair))

    def revive(self) -> None:
        """Start what is dead, as a batch system would: workers end with their scheduler."""
        if self.cluster.scheduler.poll() is not None:
            self.cluster.launch_scheduler()
        for name in ("one", "two"):
            if name not in self.workers or self.workers[name].poll() is not None:
                self.workers[name] = self.cluster.launch_worker(name)

    def restore(self) -> None:
        """Bring everything back."""
        for process in [self.cluster.scheduler, *self.workers.values()]:
            with suppress(ProcessLookupError):
                self.cluster.resume(process)
        self.repairs.clear()
        self.revive()

    def strike(self, blow: str) -> None:
        """Disturb the cluster, and plan the repair."""
        self.tally.given[blow] += 1
        is_long = self.draw.random() < LONG_SHARE
        away = (RUN_TIMEOUT_S + 6.0, RUN_TIMEOUT_S + 5.0) if is_long else (20.0, 0.5)
        name = self.draw.choice(sorted(self.workers))
        worker, scheduler = self.workers[name], self.cluster.scheduler
        if blow == "wrong worker":
            stranger = self.cluster.launch_worker("stranger", environment={"PYTHONPATH": str(self.folder / "site")})
            self.later(30.0, lambda: self.cluster.kill(stranger), 10.0)
        elif blow == "pause scheduler":
            self.cluster.pause(scheduler)
            self.later(away[0], lambda: self.cluster.resume(scheduler), away[1])
        elif blow == "kill scheduler":
            self.cluster.kill(scheduler)
            self.later(away[0], self.revive, away[1])
        elif blow == "pause worker":
            self.cluster.pause(worker)
            again = self.cluster.resume if self.draw.random() < 0.6 else self.cluster.kill
            self.later(40.0, lambda: again(worker), 2.0)
        else:
            worker.send_signal(signal.SIGKILL if blow == "kill worker" else signal.SIGTERM)
            self.later(10.0, self.revive)

    def note_end(self, code: int, told: str) -> None:
        """Note how a run ended, which must be in good order."""
        for words in ("silent for", "is gone", "no workers", "answers again", "is left out", "sent to others"):
            self.tally.heard[words] += words in told
        given_up = [words for words in ENDINGS if words in told.splitlines()[-1]] if told else []
        failed = " failed: its Dask worker" in told
        if code == 0:
            self.tally.ends["completed by itself"] += 1
        elif code == INCOMPLETE and failed and not given_up:
            self.tally.ends["a sweep had lost its workers three times; completed when run again"] += 1
        elif given_up:
            self.tally.ends[f"ended: {given_up[0]} …; completed when run again"] += 1
        else:
            self.tally.findings.append(f"{self.name}: exit code {code}: {told[-300:]!r}")
        if "Traceback" in told or "internal error" in told:
            self.tally.findings.append(f"{self.name}: {told[-500:]!r}")

    def audit(self, reference: Path) -> Iterator[str]:
        """Yield what is wrong in the database."""
        counts = rows(self.database, "SELECT count(*), count(outcome) FROM sweep")[0]
        if counts != (SWEEPS, SWEEPS):
            yield f"{counts[1]} results of {counts[0]} sweeps"
        times = Counter(key for (key,) in rows(self.database, "SELECT key FROM run_sweep WHERE state = 'computed'"))
        if len(times) != SWEEPS or set(times.values()) != {1}:
            yield f"{len(times)} sweeps are computed, {sum(number > 1 for number in times.values())} more than once"
        if rows(self.database, "PRAGMA integrity_check") != [("ok",)]:
            yield "the database is not sound"
        if rows(self.database, "SELECT count(*) FROM lease") != [(0,)]:
            yield "leases are left"
        if rows(self.database, "SELECT count(*) FROM run WHERE state = 'running'") != [(0,)]:
            yield "a run seems to go on"
        for question in QUESTIONS:
            if rows(self.database, question) != rows(reference, question):
                yield f"{question}: not as in a run in one process"


def rows(database: Path, question: str) -> list[Any]:
    with closing(sqlite3.connect(f"{database.as_uri()}?mode=ro", uri=True, timeout=20)) as connection:
        return connection.execute(question).fetchall()


def start_run(folder: Path, cluster: Cluster, database: Path, told: Any) -> "subprocess.Popen[bytes]":
    """Start a run on the cluster."""
    command = [
        sys.executable, "-m", "fraexp", "run", "torture", f"--executor=dask:{cluster.address}", f"--db={database}",
    ]  # fmt: skip
    environment = {**os.environ, "FRAEXP_DASK_TIMEOUT": f"{RUN_TIMEOUT_S:g}"}
    return subprocess.Popen(
        command, cwd=folder, env=environment, stdin=subprocess.DEVNULL, stdout=told, stderr=told, start_new_session=True
    )


def prepare(folder: Path) -> Path:
    """Write the workspace and other code for the wrong workers; return the database of a run in one process."""
    for part in ("studies", "plugins", "cluster"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    values = [round(1e-4 * (1 + n / 24), 9) for n in range(SWEEPS // 2)]
    (folder / "plugins" / "unhurried.py").write_text(PLUGIN)
    (folder / "studies" / "torture.toml").write_text(STUDY.format(values=values, seconds=1.0))
    site, package = folder / "site", Path(fraexp.__file__).parent
    shutil.copytree(package, site / "fraexp", ignore=shutil.ignore_patterns("__pycache__"))
    with (site / "fraexp" / "execution" / "job.py").open("a") as source:
        source.write("# changed\n")
    database = folder / "reference.db"
    command = [sys.executable, "-m", "fraexp", "run", "torture", "--executor=serial", f"--db={database}"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"the run in one process fails: {done.stderr}")
    return database


def interruption(folder: Path, state: str) -> tuple[float, float, int]:
    """Press Ctrl-C in a state; return the time until the process has ended, its own part of it, and its exit code."""
    with (
        tempfile.TemporaryDirectory() as spare,
        Cluster(Path(spare)) as cluster,
        Path(os.devnull).open("wb") as nowhere,
    ):
        worker = cluster.start_worker("one")
        process = start_run(folder, cluster, Path(spare) / "interrupted.db", nowhere)
        wait_until((Path(spare) / "began").exists)
        for blow in STATES[state]:
            victim = cluster.scheduler if "scheduler" in blow else worker
            (cluster.pause if "pause" in blow else cluster.kill)(victim)
        time.sleep(7.0 if STATES[state] else 0.5)  # until the run waits
        before, began = cpu_seconds(process.pid), time.monotonic()
        process.send_signal(signal.SIGINT)
        used = before
        while process.poll() is None and time.monotonic() - began < HANG_TIMEOUT_S:
            with suppress(OSError, ValueError, IndexError):
                used = max(cpu_seconds(process.pid), used)
            time.sleep(0.005)
        return time.monotonic() - began, used - before, process.poll() or 0


def cpu_seconds(pid: int) -> float:
    """Return the processor time of a process [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one short history")
    parser.add_argument("--histories", type=int, help="number of histories; 0 for Ctrl-C only")
    parser.add_argument("--seed", type=int, default=1, help="of the random moments")
    parser.add_argument("--keep", type=Path, help="folder to work in, which stays")
    given = parser.parse_args()
    count, blows = (1, 3) if given.quick else (12, 5)
    count = count if given.histories is None else given.histories
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell has what runs in the background ignore Ctrl-C
    tally, began = Tally(), time.monotonic()
    with tempfile.TemporaryDirectory() as spare:
        folder = (given.keep or Path(spare)).absolute()
        reference = prepare(folder)
        for number in range(count):
            (folder / "cluster" / str(number)).mkdir()
            with Cluster(folder / "cluster" / str(number)) as cluster:
                history = History(folder, cluster, blows, f"{given.seed} {number}", tally)
                history.go()
                tally.findings += [f"{history.name}: {finding}" for finding in history.audit(reference)]
        print(f"seed {given.seed}: {count} runs of {SWEEPS} sweeps on Dask, {tally.given.total()} disturbances")
        for title, counter in (("disturbed by", tally.given), ("ended", tally.ends), ("told", tally.heard)):
            for what, times in sorted(counter.items()):
                print(f"  {title:<13}{times:>4}  {what}")
        if not given.quick:
            for state in STATES:
                taken, own, code = interruption(folder, state)
                print(f"  Ctrl-C, {state:<17}{taken:5.2f} s, {own:4.2f} s of its own; exit code {code}")
                if code != 130 or min(taken, own) > OBEYED_S:
                    tally.findings.append(f"Ctrl-C, {state}: {taken:.2f} s, exit code {code}")
    print(f"in {time.monotonic() - began:.0f} s; {len(tally.findings)} findings")
    for finding in tally.findings:
        print(f"  {finding}")
    return int(bool(tally.findings))


if __name__ == "__main__":
    sys.exit(main())
