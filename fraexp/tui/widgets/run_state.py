"""The state of a run above its sweeps: progress, rate and time left, the latest failures with their remedies."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from textual.content import Content
from textual.widgets import Static

from fraexp.data.results import Outcome
from fraexp.data.terminal_text import printable
from fraexp.store import ListedSweep, RunSummary
from fraexp.tui.page import shorten
from fraexp.tui.services.themes import state_sign
from fraexp.views.fields import elapsed_text, run_duration_text, run_state_text
from fraexp.views.listing import state_text, time_text
from fraexp.views.run_progress import counts_text, progress_text
from fraexp.views.words import short_key

if TYPE_CHECKING:
    from fraexp.tui.app import FraexpApp

MAX_SHOWN_REASONS = 2
"""Maximum number of reasons of failures shown above the table, which has all failures."""
FAILURE_SIGN = "✗"
MAX_READ_FAILURES = 40
"""Maximum number of the latest failures whose reasons are read."""
MAX_BAR = 40
"""Most cells of the bar of progress."""
PADDING = 2
"""Cells beside its texts."""


class RunState(Static):
    """The state of a run; while it runs, `show` is called again and again."""

    DEFAULT_CSS = "RunState { height: auto; padding: 0 1; }"
    app: "FraexpApp"

    def __init__(self, text: str) -> None:
        super().__init__(text, id="state")
        self._shown: list[str | tuple[str, str]] = []
        self._failures: list[str] = []
        self._failure_count = 0

    async def read_failures(self, run: RunSummary) -> None:
        """Read the latest failures with their messages and remedies, if more have come; FraexpError if that fails."""
        count = run.failed + run.unusable
        if count == self._failure_count:
            return
        page = await self.app.backend.read(
            lambda store: store.page("state:unusable", "-position", 0, MAX_READ_FAILURES, run.number)
        )
        self._failures = _failure_lines(page.rows, page.total)
        self._failure_count = count

    def show(self, run: RunSummary, is_stopping: bool) -> None:
        """Show the progress and the last failures."""
        parts = self._parts(run, is_stopping)
        if parts != self._shown:
            text, before = Content.assemble(*parts), Content.assemble(*self._shown)
            self.update(text, layout=len(text.split()) != len(before.split()))  # a layout draws the whole screen
            self._shown = parts

    def show_start_failure(self, text: str) -> None:
        """Show how a process ended that has begun no run."""
        self.update(Content(text))

    def _parts(self, run: RunSummary, is_stopping: bool) -> list[str | tuple[str, str]]:
        state = "stopping" if is_stopping and run.state == "running" else run_state_text(run)
        sign, colour = state_sign(state)
        took = f", took {run_duration_text(run)}" if run.ended else ""
        since = f"since {time_text(run.started)}, {elapsed_text(run)}"
        parts: list[str | tuple[str, str]] = [
            (f"{sign} {state}", f"bold ${colour}"),
            f"  {time_text(run.started)}{took}" if run.ended else f"  {since}",
            f"  {counts_text(run)}\n",
            progress_text(run, MAX_BAR, self.screen.size.width - PADDING),
        ]
        for line in self._failures:
            parts.append((f"\n{printable(line)}", "$error" if line.startswith(FAILURE_SIGN) else ""))
        if run.ended and run.computed + run.reused:
            parts.append(("\nc shows its figure", "$text-muted"))
        if run.state == "interrupted":
            parts.append(f"\n{_interruption_text(run, is_stopping)}")
        return parts


def _interruption_text(run: RunSummary, is_stopping: bool) -> str:
    """Return how a run was interrupted: one that was asked to stop has stored its end."""
    if run.ended or is_stopping:
        return "It was stopped; finished sweeps are kept. R continues the run."
    return "Its process ended before all sweeps were finished. R continues the run."


def _failure_lines(rows: Sequence[ListedSweep], total: int) -> list[str]:
    """Return what failed and why, and the remedy, once for all of the latest failures of one reason."""
    reasons: dict[tuple[str, str], list[ListedSweep]] = {}
    for row in rows:
        remedy = (row.outcome or Outcome.ERROR).remedy(row.message)
        reasons.setdefault((state_text(row), remedy), []).append(row)
    shown = list(reasons.items())[:MAX_SHOWN_REASONS]
    lines = []
    for (state, remedy), failed in shown:
        latest = failed[0]
        several = f"{len(failed)}{' or more' if total > len(rows) else ''} {state}, the last"
        head = f"{several} {short_key(latest.key)}" if len(failed) > 1 else f"{short_key(latest.key)} {state}"
        lines.append(shorten(f"{FAILURE_SIGN} {head}: {latest.message}".removesuffix(": ")))
        lines += [shorten(f"  → {remedy}")] if remedy else []
    more = total - sum(len(failed) for _, failed in shown)
    return [*lines, f"  {f'{more} more' if more else 'all'}: / state:unusable"] if total > 1 else lines
