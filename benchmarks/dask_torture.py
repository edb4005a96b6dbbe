"""Kill, pause and restart the scheduler and the workers of a Dask cluster at random, and check every result.

    python benchmarks/dask_torture.py             12 histories of 5 disturbances, and the time that Ctrl-C takes
    python benchmarks/dask_torture.py --reduced   1 history of 3, without Ctrl-C
    python benchmarks/dask_torture.py ctrl-c      Ctrl-C only

In each history ``fraexp run`` computes 48 short sweeps on a cluster of two workers, real processes all of them, into a
database of its own. At random moments the scheduler or a worker is killed (SIGKILL), asked to end (SIGTERM) or hangs
with its connections open (SIGSTOP), or a worker with other code joins. What has died comes back after a random time,
what hangs goes on or dies; some schedulers stay away, or silent, for longer than the run waits (30 s here). Each run
must complete by itself, or end with one line that says why and complete when it is run again. Then there must be every
result, computed once; a sound database; no lease; no run that seems to go on; and bit for bit the numbers of a run in
one process. What happens between the moments is up to the machine. Then Ctrl-C is pressed in each state in which a run
waits, and must be obeyed within a second of the process's own time. Linux only.
"""

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
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from disturbed_runs import audit, rows, run_in_peace, start_run
from harness import ROOT, Bench, run

sys.path.insert(0, str(ROOT))
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
            return start_on(self.cluster, self.folder, self.database, stream), told

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


def start_on(cluster: Cluster, folder: Path, database: Path, told: Any) -> "subprocess.Popen[bytes]":
    """Start a run on a cluster."""
    environment = {**os.environ, "FRAEXP_DASK_TIMEOUT": f"{RUN_TIMEOUT_S:g}"}
    return start_run(folder, f"dask:{cluster.address}", database, told, environment)


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
    return run_in_peace(folder, "serial")


def interruption(folder: Path, state: str) -> tuple[float, float, int]:
    """Press Ctrl-C in a state; return the time until the process has ended, its own part of it, and its exit code."""
    with (
        tempfile.TemporaryDirectory() as spare,
        Cluster(Path(spare)) as cluster,
        Path(os.devnull).open("wb") as nowhere,
    ):
        worker = cluster.start_worker("one")
        process = start_on(cluster, folder, Path(spare) / "interrupted.db", nowhere)
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


def histories(bench: Bench) -> None:
    """Disturbances, how runs ended, what they said, and findings."""
    count, blows = bench.options.histories, 3 if bench.reduced else 5
    tally = Tally()
    with tempfile.TemporaryDirectory() as spare:
        folder = Path(bench.options.keep or spare).absolute()
        reference = prepare(folder)
        for number in range(count):
            (folder / "cluster" / str(number)).mkdir()
            with Cluster(folder / "cluster" / str(number)) as cluster:
                history = History(folder, cluster, blows, f"{bench.seed} {number}", tally)
                history.go()
                found = [*audit(history.database, reference, SWEEPS)]
                found += rows(history.database, "SELECT 'a run seems to go on' FROM run WHERE state = 'running'")
                tally.findings += [f"{history.name}: {finding}" for finding in found]
    bench.row(f"{count} runs of {SWEEPS} sweeps on Dask", f"{tally.given.total()} disturbances")
    for title, counter in (("disturbed by", tally.given), ("ended", tally.ends)):
        for what, times in sorted(counter.items()):
            bench.row(f"{title}: {what}", f"{times:4}")
    for finding in tally.findings:
        bench.row("finding", finding, is_met=False)


def ctrl_c(bench: Bench) -> None:
    """Time until a run has ended, and its own part of it."""
    with tempfile.TemporaryDirectory() as folder:
        prepare(Path(folder))
        for state in [] if bench.reduced else STATES:
            taken, own, code = interruption(Path(folder), state)
            is_met = code == 130 and min(taken, own) <= OBEYED_S
            bench.row(state, f"{taken:5.2f} s, {own:4.2f} s of its own; exit code {code}", is_met, taken=taken)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell has what runs in the background ignore Ctrl-C
    run(__doc__, histories, ctrl_c, histories=(12, 1), keep="")
