"""A measurement as the terminal UI sees it: a process that plays and reports, and all that it has reported so far."""

import os
import pickle
import shlex
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from typing import IO, Any

import numpy as np

from fraexp.data.results import FrequencyResponse
from fraexp.measurement.consent import Consent
from fraexp.workspace.workspace_service import WorkspaceService

LabelledResponse = tuple[str, FrequencyResponse]
"""What an estimator found at one point, with its name."""


@dataclass(frozen=True)
class LimitedMotion:
    """A quantity that has a limit, such as the stroke."""

    name: str
    unit: str
    limit: float
    predicted: float
    """What the plan asks for, by its greatest point [unit]."""
    place: int
    """Its place in a demand."""


@dataclass(frozen=True)
class PlanReport:
    """The plan of an experiment, within its limits."""

    label: str
    machine: str
    motions: tuple[LimitedMotion, ...]
    margin: float
    """Part of each limit that predicted motion leaves free."""
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    """Texts of each point, in the order in which they are played."""
    seconds: float
    """Machine time that the points are expected to take that are not kept [s]."""
    total: str
    """Number of points, how many of them are kept, and the machine time of the others, in words."""
    frequency_range: tuple[float, float]
    """Lowest and highest frequency [Hz]."""
    band: float | None
    """Half-width of the 95 % band that each point is to reach [dB]."""
    kept: int
    """Points that an earlier, interrupted measurement has stored."""
    is_other_stored: bool
    """Whether a measurement of another machine, excitation or setting is stored, which must be discarded."""
    total_afresh: str = ""
    """The same as `total` if nothing is kept."""
    drive: str = ""
    """What the user must know of a drive that cannot be switched off."""


@dataclass(frozen=True)
class PlansReport:
    """The plans of all experiments of a study; nothing has been played."""

    plans: tuple[PlanReport, ...]
    is_autonomous: bool = False
    """Whether stages take the place of points: then nothing is predicted."""
    consents: tuple[Consent, ...] = ()
    """What the user has to allow before the machine is connected."""


@dataclass(frozen=True)
class BeginReport:
    """A machine is connected, and an experiment begins."""

    plan: PlanReport
    """The plan by the limits of study and machine together."""
    points: int
    kept: int = 0
    """Points of an earlier measurement, which are not played again."""


@dataclass(frozen=True)
class ProgressReport:
    """The point that is being played."""

    frequency: str
    at: float
    """Its lowest frequency [Hz]."""
    peak: str
    """Peak of the excitation, with its unit."""
    seconds: float
    """Machine time of the play so far [s]."""
    is_settled: bool
    periods: int
    band: float | None
    """Half-width of the 95 % band so far [dB]."""
    demand: tuple[float, ...]
    """The greatest motion and force of the play so far."""
    predicted: tuple[float, ...]
    """The same, as predicted for all of it."""


@dataclass(frozen=True)
class PointReport:
    """A point that has been measured, now or before an interruption."""

    text: str
    done: int
    seconds_left: float
    responses: tuple[LabelledResponse, ...]


@dataclass(frozen=True)
class StageReport:
    """A stage of an autonomous measurement begins, or a level of it, or the evaluation after it."""

    name: str
    """Which of how many, in words."""
    begin: float
    """Part of all stages that is done."""
    share: float
    """Part of all stages that its points are."""
    rest: str = ""
    """Why the axis rests; empty while it moves."""
    rest_seconds: float = 0.0
    """Time that it is expected to rest [s]; 0 if it is not known."""


@dataclass(frozen=True)
class NoticeReport:
    """What was repeated or lost."""

    text: str


@dataclass(frozen=True)
class EndReport:
    """How it ended: ``complete``, ``stopped`` or ``failed``."""

    state: str
    text: str = ""
    study: str = ""
    """The study that analyses the record, if there is one."""


Report = PlansReport | BeginReport | ProgressReport | PointReport | StageReport | NoticeReport | EndReport


class ReportWriter:
    """The end of a pipe into which the measuring process writes its reports."""

    def __init__(self, stream: IO[bytes]) -> None:
        self._stream = stream

    def send(self, report: Report) -> None:
        """Send a report; if nobody reads any more, the pipe of orders ends the measurement, not this one."""
        with suppress(OSError):
            pickle.dump(report, self._stream)
            self._stream.flush()


def read_report(stream: IO[bytes]) -> Report | None:
    """Return the next report; None at the end of the stream, also in the middle of a report."""
    try:
        return pickle.load(stream)
    except (EOFError, pickle.UnpicklingError, OSError, ValueError):
        return None


MOVING_STATES = ("measuring", "stopping")
"""States in which the machine may move."""
END_STATES = ("complete", "stopped", "failed", "process lost")
"""States after which nothing is reported any more."""


class ReportedMeasurement:
    """A measurement as its reports tell; one thread adds them, another reads.

    Whoever shows it compares `version` with the one that was shown last.
    """

    def __init__(self, study: str, overrides: Sequence[str] = ()) -> None:
        self.study, self.overrides = study, list(overrides)
        self.state = "planning"
        self.message = ""
        """What ended it, in words."""
        self.is_end_shown = False
        """Whether the user knows that it has ended."""
        self.result_study = ""
        """The study that analyses the record; empty as long as the measurement is not complete."""
        self.is_autonomous = False
        """Whether each of its stages is planned by what the one before shows."""
        self.is_fresh = False
        """Whether it discards what an earlier measurement has stored."""
        self.stage: StageReport | None = None
        """The stage of an autonomous measurement; None of any other one."""
        self.rest_since = 0.0
        """When the axis began to rest for an evaluation, on the clock of time.monotonic [s]."""
        self.plans: tuple[PlanReport, ...] = ()
        self.consents: tuple[Consent, ...] = ()
        """What the user has to allow before the machine is connected."""
        self.plan: PlanReport | None = None
        """The plan of the experiment that is being measured."""
        self.progress: ProgressReport | None = None
        """The point that is being played; None between two points."""
        self.greatest: tuple[float, ...] = ()
        """The greatest motion and force that were reported; empty before."""
        self.done, self.total, self.seconds_left = 0, 0, 0.0
        self.last_point = ""
        self.notices: list[str] = []
        self.version = 0
        self.response_version = 0
        """Counts the points with a response."""
        self._responses: dict[str, list[FrequencyResponse]] = {}
        self._lock = threading.Lock()

    @property
    def command(self) -> str:
        """The command line that measures the same."""
        options = ["--autonomous"] * self.is_autonomous + ["--fresh"] * self.is_fresh
        return shlex.join(["fraexp", "measure", *options, self.study, *(f"--set={text}" for text in self.overrides)])

    @property
    def done_fraction(self) -> float:
        """How much of it is done, of all stages if there are some."""
        if self.state == "complete":
            return 1.0
        part = self.done / self.total if self.total else 0.0
        return self.stage.begin + self.stage.share * part if self.stage else part

    @property
    def count_text(self) -> str:
        """How far it is in two or three words; empty while nothing is planned."""
        return self.stage.name if self.stage else f"{self.done}/{self.total}" if self.total else ""

    @property
    def is_moving(self) -> bool:
        """Whether the machine may move."""
        return self.state in MOVING_STATES

    @property
    def has_ended(self) -> bool:
        """Whether nothing more will be reported."""
        return self.state in END_STATES

    def change_state(self, before: str, after: str) -> bool:
        """Go from one state to another; return whether it was in the first."""
        with self._lock:
            if self.state != before:
                return False
            self.state, self.version = after, self.version + 1
            return True

    def add(self, report: Report) -> None:
        """Take note of a report."""
        with self._lock:
            self._take(report)
            self.version += 1

    def responses(self) -> list[LabelledResponse]:
        """Return what each estimator has found so far, over frequency."""
        with self._lock:
            parts = {label: list(found) for label, found in self._responses.items()}
        return [(label, join_responses(found)) for label, found in parts.items()]

    def _take(self, report: Report) -> None:
        match report:
            case PlansReport(plans, is_autonomous, consents):
                self.plans, self.is_autonomous, self.consents, self.state = plans, is_autonomous, consents, "planned"
            case BeginReport(plan, points, kept):
                self.plan, self.progress = plan, None
                self.done, self.total, self.seconds_left = kept, points, plan.seconds
            case ProgressReport():
                self.progress = report
                self.greatest = tuple(map(max, report.demand, self.greatest or report.demand))
            case PointReport(text, done, seconds_left, responses):
                self.done, self.seconds_left, self.last_point, self.progress = done, seconds_left, text, None
                for label, response in responses:
                    self._responses.setdefault(label, []).append(response)
                self.response_version += bool(responses)
            case StageReport():
                self.stage, self.rest_since = report, time.monotonic()
                self.progress, self.done, self.total, self.seconds_left = None, 0, 0, 0.0
            case NoticeReport(text):
                self.notices.append(text)
            case EndReport(state, text, study) if not self.has_ended:
                self.state, self.message, self.result_study, self.progress = state, text, study, None


def join_responses(parts: Sequence[FrequencyResponse]) -> FrequencyResponse:
    """Return the points of several responses of one estimator as one, by increasing frequency."""
    order = np.argsort(np.concatenate([part.frequency for part in parts]), kind="stable")
    joined: dict[str, Any] = {}
    for field in fields(FrequencyResponse):
        values = [getattr(part, field.name) for part in parts]
        if any(value is None for value in values):
            joined[field.name] = None
        else:
            joined[field.name] = np.concatenate(values)[order] if isinstance(values[0], np.ndarray) else values[0]
    return FrequencyResponse(**joined)


WORKER = "fraexp.tui.services.measurement_worker"
"""Module of the measuring process, which imports all that simulates and estimates: the UI must not."""


class LiveMeasurement(ReportedMeasurement):
    """A study that is planned, then measured, in a process whose orders come over a pipe.

    The process stops the machine as soon as the pipe is closed: by `stop`, or because this process has died.
    A thread takes its reports.
    """

    def __init__(self, workspace: WorkspaceService, study: str, overrides: Sequence[str] = ()) -> None:
        super().__init__(study, overrides)
        command = [sys.executable, "-m", WORKER, str(workspace.folder.absolute()), study, *self.overrides]
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | workspace.location_environment(),
            start_new_session=True,  # signals of the terminal are for the UI, whose end closes the pipe
        )
        self._thread = threading.Thread(target=self._read, name="measurement", daemon=True)
        self._thread.start()

    def begin(self, fresh: bool = False) -> None:
        """Let it measure; `fresh`, without what an earlier measurement has stored."""
        if self.change_state("planned", "measuring"):
            self.is_fresh = fresh
            self._order("fresh\n" if fresh else "begin\n")

    def stop(self) -> None:
        """Let the excitation fall within its ramp, and end; measured points are kept."""
        self.change_state("measuring", "stopping")
        self._close_pipe(self._process.stdin)

    def kill(self) -> None:
        """Kill the process at once; the machine stops by its own watchdog."""
        self._process.kill()
        self._close_pipe(self._process.stdin)

    def discard(self) -> None:
        """End a measurement that has not begun."""
        if not self.is_moving:
            self.kill()

    def join(self, timeout: float) -> bool:
        """Wait for the end, and return whether it has come."""
        self._thread.join(timeout)
        return not self._thread.is_alive()

    def _order(self, text: str) -> None:
        pipe = self._process.stdin
        assert pipe is not None
        with suppress(OSError):  # its reports say how it has ended
            pipe.write(text.encode())
            pipe.flush()

    def _read(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as stream:
            while (report := read_report(stream)) is not None:
                self.add(report)
        self._close_pipe(self._process.stdin)
        code = self._process.wait()
        if not self.has_ended:
            text = f"the measuring process ended with code {code}; the machine stops by its watchdog"
            self.add(EndReport("process lost", text))

    @staticmethod
    def _close_pipe(pipe: IO[bytes] | None) -> None:
        with suppress(OSError):
            if pipe is not None:
                pipe.close()
