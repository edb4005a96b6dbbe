"""Progress of a run and its expected time, in words and as a bar."""

from fraexp.execution.events import TimeLeft
from fraexp.store import MAX_RUNNING_SHOWN, RunSummary
from fraexp.views.words import duration_text, plural

FULL, EMPTY = "█", "░"
MIN_BAR = 10
"""Fewest cells of a bar that is made to fit."""


def finished_count(run: RunSummary) -> int:
    """Return the number of finished sweeps of a run."""
    return run.computed + run.reused + run.failed


def done_count(run: RunSummary) -> float:
    """Return the number of finished sweeps plus the finished fractions of running ones."""
    running = sum(run.progress.running.values()) if run.progress and run.state == "running" else 0.0
    told = run.reused + run.progress.done if run.progress and run.state == "running" else 0.0
    return min(max(finished_count(run) + running, told), float(run.total))


def done_fraction(run: RunSummary) -> float:
    """Return the finished fraction of a run."""
    return done_count(run) / run.total if run.total else 1.0


def bar_text(part: float, width: int) -> str:
    """Return a progress bar; it is full only when all is done."""
    full = width if part >= 1 else min(int(part * width), width - 1)
    return FULL * full + EMPTY * (width - full)


def time_text(time: TimeLeft, what: str = "") -> str:
    """Return the expected time of a plan, or of what is ``left`` of a run, and from how many sweeps it follows."""
    word = f" {what}" if what else ""
    if time.seconds is None:
        return f"time{word} unknown"
    bound = "at least" if time.unlike else "about"
    return f"{bound} {duration_text(time.seconds)}{word}, from {plural(time.like, 'like sweep')}"


def progress_text(run: RunSummary, width: int = 20, room: int | None = None) -> str:
    """Return a bar with percentage and counts; while the run lasts, with the time left.

    The bar has `width` cells, but fewer, and MIN_BAR at least, if `room` cells do not suffice for all; what then still
    does not fit is cut off.
    """
    part, count = done_fraction(run), finished_count(run)
    parts = [f"{count} of {plural(run.total, 'sweep')}"]
    if run.state == "running" and (progress := run.progress):
        left = TimeLeft(progress.seconds_left, progress.like, progress.unlike)
        parts += [time_text(left, "left")] if count < run.total else []
        parts += [progress.doing] if progress.doing else []
        if running := len(progress.running):
            parts.append(f"{running} or more in progress" if running >= MAX_RUNNING_SHOWN else f"{running} in progress")
        if progress.workers:
            parts.append(plural(progress.workers, "worker"))
    percent = 100 if count >= run.total else min(int(100 * part), 99)
    text = f" {percent:3d} %  {', '.join(parts)}"
    bar = width if room is None else max(MIN_BAR, min(width, room - len(text)))
    line = f"{bar_text(part if count < run.total else 1.0, bar)}{text}"
    return line if room is None or len(line) <= room else f"{line[: room - 1]}…"


def counts_text(run: RunSummary) -> str:
    """Return how many sweeps were computed and reused, how many failed or are unusable, are left, or were deleted."""
    pending = run.total - finished_count(run)
    left = f", {pending} to do" if pending else ""
    unusable = f", {run.unusable} without a usable result" if run.unusable else ""
    deleted = f", {run.deleted} deleted" if run.deleted else ""
    return f"{run.computed} computed, {run.reused} reused, {run.failed} failed{unusable}{left}{deleted}"
