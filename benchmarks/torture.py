"""Kill runs again and again, and check that every result is right.

    python benchmarks/torture.py             500 sweeps, 36 times kill -9 and 9 times SIGTERM, SIGINT or SIGHUP
    python benchmarks/torture.py --reduced   60 sweeps, 6 times kill -9 and once each of SIGTERM and SIGINT

A study of short sweeps, two thirds of a machine in its loop (two estimators share an experiment) and a third of a
driven friction model, is run by ``fraexp run`` processes, each in a process group of its own: at first by one, for
the last third of the kills by two at once on the same database. The scheduler, one of its workers, Python's tracker of
shared resources or the whole group is ended at a random moment: while the process starts, or after a random number of
sweeps. What has died is started again with the same command, until all is computed. Then there must be every result,
computed once; a sound database; no lease; no run that seems to go on; and bit for bit the numbers of a run in peace.
What happens between the moments is up to the machine. Linux only.
"""

import itertools
import json
import os
import random
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import harness
from disturbed_runs import audit, rows, run_in_peace, start_run
from harness import Bench

STUDY = """
title = "Short sweeps of two kinds"
machine = "linear_motor_table"
[[case]]
label = "conventional"
excitation = {{ name = "stepped_sine", points = 60, min_frequency = 0.1, amplitude = 75 }}
estimator = {{ name = "conventional" }}
[[case]]
label = "proposed"
excitation = {{ name = "stepped_sine", points = 60, min_frequency = 0.1, amplitude = 75 }}
estimator = {{ name = "effective_input" }}
[[case]]
label = "hysteresis"
excitation = {{ name = "displacement_sine", frequency = 1.0, amplitude = 100e-6 }}
estimator = {{ name = "hysteresis" }}
[grid]
"friction.curve.coulomb_force" = {values}
"""
HARD = ("scheduler", "worker", "group", "tracker")
"""What is ended by kill -9."""
GENTLE = ("SIGTERM", "SIGINT", "SIGHUP")
"""How the scheduler is asked to end."""
EARLY = 0.25
"""Share of the kills that hit a process while it starts."""
START = 4.0
"""Maximum time of a start [s]."""
FAREWELL = 60.0
"""Seconds in which what was asked to end, or has lost its scheduler, must be gone: the machine may be busy."""


@dataclass
class Run:
    """A ``fraexp run`` process with its group."""

    process: subprocess.Popen[bytes]
    told: Path
    began: float = field(default_factory=time.monotonic)

    @property
    def ended(self) -> bool:
        return self.process.poll() is not None

    def members(self) -> dict[str, list[int]]:
        """Return the processes of the group by what they are."""
        found: dict[str, list[int]] = {"scheduler": [self.process.pid], "worker": [], "server": [], "tracker": []}
        parents: dict[int, int] = {}
        for pid in map(int, filter(str.isdecimal, (entry.name for entry in Path("/proc").iterdir()))):
            try:
                if pid == self.process.pid or os.getpgid(pid) != self.process.pid:
                    continue
                command = Path(f"/proc/{pid}/cmdline").read_bytes()
                parents[pid] = int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
            except OSError:  # it is gone
                continue
            for what, word in (("server", b"forkserver"), ("tracker", b"resource_tracker")):
                if word in command:
                    found[what].append(pid)
        forked = found.pop("server")  # the server of all workers, and its children
        found["worker"] = [pid for pid in forked if parents[pid] in forked]
        return found

    def gone(self, patience: float) -> bool:
        """Return whether the whole group ends within some time [s]."""
        deadline = time.monotonic() + patience
        while time.monotonic() < deadline:
            self.process.poll()
            try:
                os.killpg(self.process.pid, 0)
            except ProcessLookupError:
                return True
            time.sleep(0.05)
        return False


class Torture:
    """A study on its way to completion in spite of everything."""

    def __init__(self, folder: Path, sweeps: int, seed: int, blows: list[str]) -> None:
        self.folder, self.sweeps = folder, sweeps
        self.draw = random.Random(seed)
        self.blows = blows
        self.database = folder / "tortured.db"
        self.findings: list[str] = []
        self.given: Counter[str] = Counter()
        self.starts = 0
        self.ends: dict[int, datetime] = {}
        """When each scheduler was known to be gone."""

    def go(self) -> None:
        """Start, kill and start again until all is computed and no process is left."""
        one, other = self.start(), None
        late = 2 * len(self.blows) // 3
        for number, blow in enumerate(self.blows):
            if number == late:
                other = self.start()
            victim = other if other is not None and self.draw.random() < 0.5 else one
            again = self.strike(victim, blow, len(self.blows) - number)
            self.examine()
            if victim is one:
                one = again
            else:
                other = again
        for run in filter(None, (one, other)):
            self.finish(run)

    def start(self) -> Run:
        self.starts += 1
        told = self.folder / f"told-{self.starts}.txt"
        with told.open("wb") as stream:
            return Run(start_run(self.folder, "processes:2", self.database, stream), told)

    def done(self) -> int:
        """Return how many sweeps have a result."""
        try:
            return int(self.asked("SELECT count(*) FROM sweep WHERE outcome IS NOT NULL")[0][0])
        except sqlite3.OperationalError:  # it is not there yet
            return 0

    def asked(self, question: str) -> list[Any]:
        return rows(self.database, question)

    def strike(self, run: Run, blow: str, left: int) -> Run:
        """Wait for a random moment, kill, and return what is running then."""
        early = self.draw.random() < EARLY
        pause, share, target = self.draw.uniform(0, START), self.draw.uniform(0, 0.15), self.draw.random()
        if early and self.starts > 1 and blow not in ("worker", "tracker"):
            time.sleep(max(run.began + pause - time.monotonic(), 0.0))
        else:
            done = self.done()
            wanted = done + 1 + 0.5 * target * (self.sweeps - done) / (left + 1)
            while not run.ended and self.done() < min(wanted, self.sweeps):
                time.sleep(0.02)
            time.sleep(share)
        return self.hit(run, blow)

    def hit(self, run: Run, blow: str) -> Run:
        """Kill; return what is running then."""
        if run.ended:
            self.ending(run, (0,))
            return self.hit_later(blow)
        number = getattr(signal, blow) if blow in GENTLE else signal.SIGKILL
        members = run.members()
        if blow == "tracker" and members["worker"] and not members["tracker"]:
            blow = "worker"  # whose successor brings the next tracker
        if blow == "group":
            os.killpg(run.process.pid, number)
        else:
            chosen = members["scheduler" if blow in GENTLE else blow]
            if not chosen:  # it has no workers yet, or none any more
                return self.hit_later(blow, run)
            os.kill(self.draw.choice(chosen), number)
        self.given[blow] += 1
        if blow in ("worker", "tracker"):
            return run
        self.ending(run, (130, -number) if blow in GENTLE else (-number,))
        return self.start()

    def hit_later(self, blow: str, run: Run | None = None) -> Run:
        """Kill as soon as there is somebody to be killed; where nothing is left to compute, there are no workers."""
        run = run or self.start()
        if blow in ("worker", "tracker") and self.done() == self.sweeps:
            blow = "scheduler"
        deadline = time.monotonic() + FAREWELL
        what = "scheduler" if blow in ("group", *GENTLE) else blow
        while not run.members()[what] and not run.ended and time.monotonic() < deadline:
            time.sleep(0.01)
        if run.ended or time.monotonic() > deadline:
            self.findings.append(f"no {what} was there to be killed")
            return run if not run.ended else self.start()
        return self.hit(run, blow)

    def ending(self, run: Run, codes: tuple[int, ...]) -> None:
        """See to it that a run ends as it must, with all that it started."""
        if not run.gone(FAREWELL):
            self.findings.append(f"{run.told.name}: processes are left: {run.members()}")
            os.killpg(run.process.pid, signal.SIGKILL)
        code = run.process.wait()
        self.ends[run.process.pid] = datetime.now(UTC)
        told = run.told.read_text(errors="replace")
        if "KeyboardInterrupt" in told and "fraexp" not in told:  # Python itself was still starting
            return
        if code not in codes and not (code == 0 and " complete: " in told):  # it may have been too late to be asked
            self.findings.append(f"{run.told.name}: exit code {code}, expected {codes}: {told[-300:]!r}")
        for word in ("Traceback", "internal error", "Warning", "Error:"):
            if word in told:
                self.findings.append(f"{run.told.name}: {word} in what it says: {told[-300:]!r}")
        if code == 130:
            states = self.states(run.process.pid)
            if "running" in states:
                self.findings.append(f"{run.told.name}: was asked to end, and left its run as running")

    def states(self, pid: int) -> list[str]:
        try:
            return [state for (state,) in self.asked(f"SELECT state FROM run WHERE pid = {pid}")]
        except sqlite3.OperationalError:
            return []

    def examine(self) -> None:
        """Look at the database after a death."""
        try:
            found = self.asked("PRAGMA integrity_check")
            lying = self.lying() if self.asked("SELECT 1 FROM run WHERE state = 'running'") else set()
            lying = lying & self.lying() if lying else lying  # one may have begun and ended while they were listed
        except sqlite3.OperationalError:  # nothing has been made yet
            return
        if found != [("ok",)]:
            self.findings.append(f"after {dict(self.given)}: {found}")
        self.findings += [f"after {dict(self.given)}: run {number} seems to go on" for number in lying]

    def lying(self) -> set[int]:
        """Return the runs that are listed as running though their process is gone."""
        living = self.numbers()
        listed = {run["number"] for run in self.listed() if run["state"] == "running"}
        return listed - living - self.numbers()

    def numbers(self) -> set[int]:
        """Return the runs whose process lives."""
        rows = self.asked("SELECT number, pid FROM run WHERE state = 'running'")
        return {number for number, pid in rows if pid not in self.ends and Path(f"/proc/{pid}").exists()}

    def listed(self) -> list[dict[str, Any]]:
        """Return the runs as ``fraexp list`` prints them."""
        command = [sys.executable, "-m", "fraexp", "list", "--json", f"--db={self.database}"]
        done = subprocess.run(command, cwd=self.folder, capture_output=True, text=True, check=False)
        if done.returncode:
            self.findings.append(f"fraexp list: {done.stderr}")
            return []
        runs: list[dict[str, Any]] = json.loads(done.stdout)["runs"]
        return runs

    def finish(self, run: Run) -> None:
        """Let a run end by itself."""
        run.process.wait()
        self.ending(run, (0,))


def late_results(torture: Torture) -> Iterator[str]:
    """Yield results that are not from the time of the run that computed them."""
    question = """SELECT sweep.created, run.started, run.ended, run.pid FROM run_sweep
        JOIN sweep USING (key) JOIN run ON run.number = run_sweep.run WHERE run_sweep.state = 'computed'"""
    late = 0
    for created, started, ended, pid in torture.asked(question):
        end = datetime.fromisoformat(ended).replace(tzinfo=UTC) if ended else torture.ends[pid]
        late += not started <= created or datetime.fromisoformat(created).replace(tzinfo=UTC) > end
    if late:
        yield f"{late} results are not from the time of the run that computed them"


def wrong_states(torture: Torture) -> Iterator[str]:
    """Yield runs whose state is not what became of their sweeps."""
    open_states = """SELECT run, count(*) FROM run_sweep JOIN run ON run.number = run
        WHERE run.state = 'complete' AND run_sweep.state NOT IN ('computed', 'reused') GROUP BY run"""
    for number, sweeps in torture.asked(open_states):
        yield f"run {number} is complete, but {sweeps} of its sweeps are not"
    for run in torture.listed():
        if run["state"] not in ("complete", "interrupted"):
            yield f"run {run['number']} is listed as {run['state']}"


def blows(hard: int, gentle: int, seed: int) -> list[str]:
    """Return kinds of kills, each about as often as the others, in random order: workers while there are some."""
    draw = random.Random(f"{seed}, blows")
    chosen = [*itertools.islice(itertools.cycle(HARD), hard), *itertools.islice(itertools.cycle(GENTLE), gentle)]
    places = {
        index: draw.random() * (0.35 if kind in ("worker", "tracker") else 1) for index, kind in enumerate(chosen)
    }
    return [chosen[index] for index in sorted(places, key=places.__getitem__)]


def kills(bench: Bench) -> None:
    """Kills of each kind, and findings."""
    sweeps, hard, gentle = (60, 6, 2) if bench.reduced else (501, 36, 9)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell has what runs in the background ignore Ctrl-C
    with tempfile.TemporaryDirectory() as spare:
        folder = Path(bench.options.keep or spare).absolute()
        (folder / "studies").mkdir(parents=True, exist_ok=True)
        values = [round(12 + 12 * n / (sweeps // 3), 6) for n in range(sweeps // 3)]
        (folder / "studies" / "torture.toml").write_text(STUDY.format(values=values), encoding="utf-8")
        reference = run_in_peace(folder, "processes:2")
        torture = Torture(folder, sweeps, bench.seed, blows(hard, gentle, bench.seed))
        torture.go()
        findings = [*torture.findings, *late_results(torture), *wrong_states(torture)]
        findings += audit(torture.database, reference, sweeps)
    killed = sum(torture.given[kind] for kind in HARD)
    text = ", ".join(f"{kind} {torture.given[kind]}" for kind in (*HARD, *GENTLE))
    what = f"{sweeps} sweeps, {torture.starts} starts, {killed} times kill -9"
    bench.row(what, text, killed == hard)
    for finding in findings:
        bench.row("finding", finding, is_met=False)


if __name__ == "__main__":
    harness.run(__doc__, kills, keep="")
