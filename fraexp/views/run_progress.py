"""How far a run has come, in words and as a bar."""

from fraexp.store import MOST_TOLD, RunSummary
from fraexp.views.pace import rate_text
from fraexp.views.words import duration, plural

FULL, EMPTY = "█", "░"


def finished(run: RunSummary) -> int:
    """Return how many sweeps of a run have come to their end."""
    return run.computed + run.reused + run.failed


def done(run: RunSummary) -> float:
    """Return how many sweeps are done; of those that are running their share."""
    running = sum(run.progress.running.values()) if run.progress and run.state == "running" else 0.0
    told = run.reused + run.progress.done if run.progress and run.state == "running" else 0.0
    return min(max(finished(run) + running, told), float(run.total))


def share(run: RunSummary) -> float:
    """Return what part of a run is done."""
    return done(run) / run.total if run.total else 1.0


def bar(part: float, width: int) -> str:
    """Return a bar of a width that is full to a part; it is only full when all is done."""
    full = width if part >= 1 else min(int(part * width), width - 1)
    return FULL * full + EMPTY * (width - full)


def progress_text(run: RunSummary, rate: float | None, width: int = 20) -> str:
    """Return a bar with percentage and counts; while it runs, with speed and time left."""
    part, count = share(run), finished(run)
    parts = [f"{count} of {plural(run.total, 'sweep')}"]
    if run.state == "running":
        if run.progress and run.progress.doing:
            parts.append(run.progress.doing)
        if run.progress and run.progress.running:
            running = len(run.progress.running)
            parts.append(f"{running} or more under way" if running >= MOST_TOLD else f"{running} under way")
        if rate:
            parts += [rate_text(rate), f"about {duration((run.total - done(run)) / rate)} left"]
        if run.progress:
            parts.append(plural(run.progress.workers, "worker"))
    percent = 100 if count >= run.total else min(int(100 * part), 99)
    return f"{bar(part if count < run.total else 1.0, width)} {percent:3d} %  {', '.join(parts)}"


def counts_text(run: RunSummary) -> str:
    """Return what has become of the sweeps so far."""
    pending = run.total - finished(run)
    left = f", {pending} to do" if pending else ""
    return f"{run.computed} computed, {run.reused} reused, {run.failed} failed{left}"
