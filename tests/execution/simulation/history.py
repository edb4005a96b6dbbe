"""A seeded history: schedulers on one database, in simulated time, in which every statement may fail.

The store and the scheduler are the real ones, on a real SQLite file. Simulated are the clocks, the workers, the
processes (greenlets, of which one runs at a time) and the driver of the database, in which faults are injected: a
statement fails, its answer is lost, it takes long, or it is the last one before its process dies; clocks jump,
processes pause beyond their leases, and the database is away for minutes. All of it follows from the seed.
"""

import math
import random
import sqlite3
from collections import Counter
from collections.abc import Generator, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

from greenlet import GreenletExit, getcurrent, greenlet

from fraexp.components.registry import Registry
from fraexp.data.sweep import Sweep
from fraexp.errors import StoreError
from fraexp.execution.computation import RunContext
from fraexp.execution.database_retry import Clock, DatabaseRetry, Found
from fraexp.execution.events import Event, Finished
from fraexp.execution.run_time import RunTime
from fraexp.execution.scheduler import begin_run, compute_recorded
from fraexp.store import Store
from fraexp.store.liveness import HEARTBEAT_TIMEOUT, HOST, Host, Process, is_alive
from fraexp.study.study_file import ResolvedStudy
from tests.execution.simulation.faulty_sqlite import FaultyFile, Moment, ignore, unavailable
from tests.execution.simulation.simulated_workers import SimulatedWorkers

EPOCH = datetime(2026, 1, 1, tzinfo=UTC)
GRID = tuple(Sweep({"source": "drive", "n": n}, {"name": "h1", "version": 1}) for n in range(3))
OPEN_SWEEPS = """SELECT run, state FROM run_sweep WHERE state NOT IN ('computed', 'reused')
    AND run IN (SELECT number FROM run WHERE state = 'complete')"""
MAX_RESTARTS = 2
MAX_SWITCHES = 3000
"""Switches between processes after which a history counts as endless."""
MAX_POLL_S = 30.0
"""Longest poll of a simulated scheduler, on a busy machine [s]."""
FAULTS = ("fail", "lost", "delay", "pause", "crash", "crash after", "clock", "outage")


class Killed(GreenletExit):
    """A simulated process has been killed: it executes nothing any more."""


class Program:
    """A simulated process that runs the study; it is also the clock of its scheduler."""

    def __init__(self, history: "History", slot: int, wake: float, is_calm: bool = False) -> None:
        self.history, self.slot, self.wake, self.is_calm = history, slot, wake, is_calm
        self.pid = len(history.programs) + 1
        self.host = "host" if history.has_one_host else f"host {slot}"
        self.is_dead = False
        self.is_interrupted = False
        self.run: int | None = None
        self.announced: list[str] = []
        """Keys of sweeps that it reported as computed."""
        self.error = ""
        self.has_finished = False
        self.workers = SimulatedWorkers(history.random, self.now)
        self.greenlet = greenlet(self._main)

    def process(self) -> Process:
        return Process(self.host, "boot", self.pid, self.pid)

    def is_alive(self, process: Process, silence: timedelta) -> bool:
        if process.host != self.host:
            return is_alive(process, silence)
        return any(other.pid == process.pid and not other.is_dead for other in self.history.programs)

    def wall_clock(self) -> datetime:
        return EPOCH + timedelta(seconds=self.history.time + self.history.clock_offsets[self.host])

    def now(self) -> float:
        return self.history.time

    def sleep(self, seconds: float) -> None:
        """Let other processes run for a time [s]."""
        self.wake = self.history.time + seconds
        self.history.hub.switch()
        self.check_alive()

    def check_alive(self) -> None:
        if self.is_dead:
            raise Killed

    def die(self) -> None:
        self.is_dead = True
        raise Killed

    def _main(self) -> None:
        try:
            self._run_study()
        except Killed:
            pass
        except StoreError as error:
            if not self.is_interrupted:
                self.error = str(error)
        except Exception as error:  # any other one is a finding
            self.error = f"{type(error).__name__}: {error}"
        self.is_dead = True

    def _run_study(self) -> None:
        history = self.history
        host = Host(self.wall_clock, self.process, self.is_alive)
        store = Store(history.files[self.slot], history.engines[self.slot].execution_options(**{HOST: host}))
        retry = DatabaseRetry(SimulatedClock(self), timeout=math.inf)
        with closing(self._events(store, retry)) as events:
            for event in events:
                if isinstance(event, Finished) and event.state == "computed":
                    self.announced.append(event.sweep.key)
                if not self.is_calm and history.random.random() < history.interruption_rate:
                    self.is_interrupted = True
                    return
        self.has_finished = True

    def _events(self, store: Store, retry: DatabaseRetry) -> Generator[Event, None, None]:
        study = ResolvedStudy("study", Path("study.toml"), "", "", self.history.grid)
        known = yield from retry.call(lambda: store.stored_states([sweep.key for sweep in study.sweeps]))
        missing = [sweep for sweep in study.sweeps if sweep.key not in known]
        self.run = yield from begin_run(study, store, "", {"run_id": str(self.pid)}, retry)
        context = RunContext(self.run, store, Registry(), "", False, RunTime(missing, {}), retry=retry)
        yield from compute_recorded(study, missing, context, self.workers if missing else None)


class SimulatedClock(Clock):
    """The clock of a simulated process, which may be paused or killed whenever it waits."""

    def __init__(self, program: Program) -> None:
        self._program = program
        self._idle_polls = 0

    def now(self) -> float:
        return self._program.now()

    def sleep(self, seconds: float) -> None:
        history = self._program.history
        history.strike(self._program, "wait")
        self._program.sleep(max(seconds, min(history.outage_until - history.time + seconds, MAX_POLL_S)))

    def next_item(self, items: "SimpleQueue[Found]", timeout: float) -> Found:
        self._program.workers.deliver()
        if items.empty():
            self._idle_polls += 1  # a busy machine polls less and less often, which keeps histories short
            self.sleep(min(timeout * 6**self._idle_polls, MAX_POLL_S, self._program.workers.next_answer_after(timeout)))
            self._program.workers.deliver()
        if items.empty():
            raise Empty
        self._idle_polls = 0
        return items.get_nowait()


@dataclass
class History:
    """All processes of one seed, on a database of their own."""

    seed: int
    files: list[FaultyFile]
    engines: list[Any]
    """One for each file: its compiled statements serve all histories."""
    time: float = 0.0
    programs: list[Program] = field(default_factory=list)
    outage_until: float = 0.0
    log: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.random = random.Random(self.seed)
        self.has_one_host = self.random.random() < 0.5
        self.clock_offsets = dict.fromkeys(("host", "host 0", "host 1"), 0.0)
        self.grid = GRID[: self.random.randint(1, len(GRID))]
        self.fault_rate = self.random.choice((0.01, 0.03, 0.1))
        self.faults_left = self.random.randint(0, 8)
        self.faults = self.random.sample(FAULTS, self.random.randint(1, len(FAULTS)))
        self.interruption_rate = self.random.choice((0.0, 0.0, 0.02))
        self.hub = getcurrent()

    def run(self) -> list[str]:
        """Run all processes to their ends, then one more in peace, and return what is wrong."""
        for slot in (0, 1):
            self._start(slot, self.random.uniform(0, 5))
        restarts, switches = MAX_RESTARTS, 0
        while living := [program for program in self.programs if not program.is_dead]:
            program = min(living, key=lambda of: (of.wake, of.pid))
            self.time = max(self.time, program.wake)
            program.greenlet.switch()
            switches += 1
            if switches > MAX_SWITCHES:
                return [*self._kill_all(), "it does not end"]
            if program.is_dead:
                self.close_connections(program.slot)
                if restarts > 0 and not program.has_finished and not program.is_calm:
                    restarts -= 1
                    self._start(program.slot, self.time + self.random.uniform(0, 100))
                elif all(of.is_dead for of in self.programs) and not program.is_calm:
                    self.outage_until = 0.0
                    self._start(0, self.time + 300.0, is_calm=True)
        findings = [f"process {of.pid}: {of.error}" for of in self.programs if of.error]
        return findings + list(self._broken_invariants())

    def close_connections(self, slot: int) -> None:
        """Close the connections of a process that has ended, as the system does."""
        self.files[slot].hook[0] = ignore
        if self.files[slot].connections:
            self.engines[slot].dispose()
            self.files[slot].close_all()

    def _start(self, slot: int, wake: float, is_calm: bool = False) -> None:
        program = Program(self, slot, wake, is_calm)
        self.programs.append(program)
        self.files[slot].hook[0] = lambda moment, text: self.strike(program, moment, text)

    def _kill_all(self) -> list[str]:
        for program in self.programs:
            if not program.is_dead:
                program.is_dead = True
                program.greenlet.throw(Killed)
                self.close_connections(program.slot)
        return []

    def strike(self, program: Program, moment: Moment, text: str = "") -> None:
        """Let a process suffer a fault before or after a statement, or while it waits; raise if the statement fails."""
        program.check_alive()
        if program.is_calm:
            return
        if moment == "before" and self.time < self.outage_until:
            raise unavailable()
        if self.faults_left == 0 or self.random.random() >= self.fault_rate:
            return
        fault = self.random.choice(self.faults)
        if (fault in ("lost", "crash after")) != (moment == "after"):
            return
        if moment == "wait" and fault == "fail":
            return
        self.faults_left -= 1
        self.log.append(f"{self.time:8.1f} s, process {program.pid}: {fault} {moment} {' '.join(text.split())[:60]}")
        match fault:
            case "crash" | "crash after":
                program.die()
            case "fail" | "lost":
                raise unavailable()
            case "delay":
                program.sleep(self.random.uniform(0.01, 20))
            case "pause":
                program.sleep(self.random.uniform(61, 300))
            case "clock":
                self.clock_offsets[program.host] += self.random.uniform(-7200, 7200)
            case "outage":
                self.outage_until = self.time + self.random.uniform(1, 300)

    def _broken_invariants(self) -> Iterator[str]:
        with closing(sqlite3.connect(self.files[0].path)) as connection:
            rows = connection.execute
            stored = Counter(rows("SELECT run, key FROM run_sweep WHERE state = 'computed'"))
            times = Counter(key for _, key in stored)
            for sweep in self.grid:
                if times[sweep.key] != 1:
                    yield f"sweep {sweep.experiment['n']} is computed {times[sweep.key]} times"
            results = dict(rows("SELECT key, value FROM sweep JOIN metric USING (key) WHERE outcome = 'OK'"))
            if results != (expected := {sweep.key: float(sweep.experiment["n"]) for sweep in self.grid}):
                yield f"the results are {list(results.values())}; expected {list(expected.values())}"
            for program in self.programs:
                lost = [key for key in program.announced if (program.run, key) not in stored]
                if lost:
                    yield f"process {program.pid} reported {len(lost)} results that are not stored"
            if leases := rows("SELECT key, run FROM lease").fetchall():
                yield f"leases are left: {leases}"
            if lying := rows(OPEN_SWEEPS).fetchall():
                yield f"runs are complete, but not all their sweeps: {lying}"
        yield from self._wrong_runs()

    def _wrong_runs(self) -> Iterator[str]:
        states = self._run_states()
        # A clock that was wrong may have dated the last heartbeat of a dead run to this moment, or to a later one.
        self.time += 3 * HEARTBEAT_TIMEOUT.total_seconds()
        if any(pair == ("running", "running") for pair in zip(states, self._run_states(), strict=True)):
            yield f"a run seems to go on, newest first: {states}"
        if len(states) > len(self.programs):
            yield f"{len(self.programs)} processes have {len(states)} runs"
        if states[0] != "complete":
            yield f"the last run is {states[0]}"

    def _run_states(self) -> list[str]:
        """Return the states of all runs as the last process sees them, newest first."""
        last = self.programs[-1]
        host = Host(last.wall_clock, last.process, last.is_alive)
        return [run.state for run in Store(self.files[0], self.engines[0].execution_options(**{HOST: host})).runs()]
