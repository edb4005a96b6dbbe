"""What is known of a measurement by its reports: how it stands, what is played, and what was found so far."""

import shlex
import threading
import time
from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from fraexp.data.results import FrequencyResponse
from fraexp.tui.services.measurement_feed import (
    BeginReport,
    EndReport,
    LabelledResponse,
    NoticeReport,
    PlanReport,
    PlansReport,
    PointReport,
    ProgressReport,
    Report,
    StageReport,
)

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
            case PlansReport(plans, is_autonomous):
                self.plans, self.is_autonomous, self.state = plans, is_autonomous, "planned"
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
