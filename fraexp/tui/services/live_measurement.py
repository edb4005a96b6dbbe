"""A measurement as the terminal UI sees it: a process that plays, and the state of it that the process tells."""

import os
import pickle
import shlex
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import IO, Any

from fraexp.data.results import FrequencyResponse
from fraexp.measurement.consent import Consent
from fraexp.workspace.workspace_service import WorkspaceService

LabelledResponse = tuple[str, FrequencyResponse]
"""What an estimator found so far, over frequency, with its name."""


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
class PlanSummary:
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
class PlayedPoint:
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


MOVING_STATES = ("measuring", "stopping")
"""States in which the machine may move."""
END_STATES = ("complete", "stopped", "failed", "process lost")
"""States after which nothing is told any more."""


@dataclass(eq=False)
class TrackedMeasurement:
    """What is known of a measurement; one thread updates it, another reads.

    Whoever shows it compares `version` with the one that was shown last.
    """

    study: str
    overrides: Sequence[str] = ()
    state: str = "planning"
    message: str = ""
    """What ended it, in words."""
    is_end_shown: bool = False
    """Whether the user knows that it has ended."""
    result_study: str = ""
    """The study that analyses the record; empty as long as the measurement is not complete."""
    is_autonomous: bool = False
    """Whether each of its stages is planned by what the one before shows: then nothing is predicted."""
    is_fresh: bool = False
    """Whether it discards what an earlier measurement has stored."""
    plans: tuple[PlanSummary, ...] = ()
    """The plans of all experiments of the study."""
    consents: tuple[Consent, ...] = ()
    """What the user has to allow before the machine is connected."""
    stage: str = ""
    """Which stage of how many an autonomous measurement is in; empty of any other one."""
    stage_begin: float = 0.0
    """Part of all stages that was done before."""
    stage_share: float = 1.0
    """Part of all stages that its points are."""
    rest: str = ""
    """Why the axis rests; empty while it moves."""
    rest_seconds: float = 0.0
    """Time that it is expected to rest [s]; 0 if it is not known."""
    rest_since: float = 0.0
    """When it began to rest, on the clock of time.monotonic, which all processes share [s]."""
    plan: PlanSummary | None = None
    """The plan of the experiment that is measured, by the limits of study and machine together."""
    played: PlayedPoint | None = None
    """The point that is being played; None between two points."""
    greatest: tuple[float, ...] = ()
    """The greatest motion and force so far; empty before."""
    done: int = 0
    total: int = 0
    seconds_left: float = 0.0
    """Machine time that the other points are expected to take [s]."""
    last_point: str = ""
    notices: tuple[str, ...] = ()
    """What was repeated or lost."""
    responses: tuple[LabelledResponse, ...] = ()
    """What each estimator has found so far."""
    version: int = 0
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def update(self, **changes: Any) -> None:
        """Take note of changes; after the end there are none."""
        with self._lock:
            if not self.has_ended:
                vars(self).update(changes, version=self.version + 1)

    def change_state(self, before: str, after: str) -> bool:
        """Go from one state to another; return whether it was in the first."""
        with self._lock:
            if self.state != before:
                return False
            self.state, self.version = after, self.version + 1
            return True

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
        return self.stage_begin + self.stage_share * (self.done / self.total if self.total else 0.0)

    @property
    def count_text(self) -> str:
        """How far it is in two or three words; empty while nothing is planned."""
        return self.stage or (f"{self.done}/{self.total}" if self.total else "")

    @property
    def is_moving(self) -> bool:
        """Whether the machine may move."""
        return self.state in MOVING_STATES

    @property
    def has_ended(self) -> bool:
        """Whether nothing more will be told."""
        return self.state in END_STATES


def send_changes(stream: IO[bytes], **changes: Any) -> None:
    """Tell changes of the state; if nobody reads any more, the pipe of orders ends the measurement, not this one."""
    with suppress(OSError):
        pickle.dump(changes, stream)
        stream.flush()


def read_changes(stream: IO[bytes]) -> Mapping[str, Any] | None:
    """Return the next changes; None at the end of the stream, also in the middle of some."""
    try:
        changes: Mapping[str, Any] = pickle.load(stream)
    except (EOFError, pickle.UnpicklingError, OSError, ValueError):
        return None
    return changes


WORKER = "fraexp.tui.services.measurement_worker"
"""Module of the measuring process."""


class LiveMeasurement(TrackedMeasurement):
    """A study that is planned, then measured, in a process whose orders come over a pipe.

    The process stops the machine as soon as the pipe is closed: by `stop`, or because this process has died.
    """

    def __init__(self, workspace: WorkspaceService, study: str, overrides: Sequence[str] = ()) -> None:
        super().__init__(study, list(overrides))
        command = [sys.executable, "-m", WORKER, str(workspace.folder.absolute()), study, *overrides]
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
        pipe = self._process.stdin
        if self.change_state("planned", "measuring") and pipe is not None:
            self.is_fresh = fresh
            with suppress(OSError):  # it tells how it has ended
                pipe.write(b"fresh\n" if fresh else b"begin\n")
                pipe.flush()

    def stop(self) -> None:
        """Let the excitation fall within its ramp, and end; measured points are kept."""
        self.change_state("measuring", "stopping")
        self._close_pipe()

    def kill(self) -> None:
        """Kill the process at once; the machine stops by its own watchdog."""
        self._process.kill()
        self._close_pipe()

    def discard(self) -> None:
        """End a measurement that has not begun."""
        if not self.is_moving:
            self.kill()

    def join(self, timeout: float) -> bool:
        """Wait for the end, and return whether it has come."""
        self._thread.join(timeout)
        return not self._thread.is_alive()

    def _read(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as stream:
            while (changes := read_changes(stream)) is not None:
                self.update(**changes)
        self._close_pipe()
        code = self._process.wait()
        text = f"the measuring process ended with code {code}; the machine stops by its watchdog"
        self.update(state="process lost", message=text, played=None)

    def _close_pipe(self) -> None:
        with suppress(OSError):
            if self._process.stdin is not None:
                self._process.stdin.close()
