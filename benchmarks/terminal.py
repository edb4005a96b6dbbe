"""Measure the waiting times in the terminal UI, and what watching costs in run time and memory.

    python benchmarks/terminal.py            medians of several runs, each in a real pseudo-terminal
    python benchmarks/terminal.py --reduced  of fewer runs

Start to first paint; time from a key to the repaint with 100,000 sweeps in the table; memory over an hour of looking at
the database, without the waiting; and how much two of them slow a run down that they watch. Bounds are given in
brackets, and the exit code is 1 if one is missed. `benchmarks/tui.py` measures the curves.
"""

import argparse
import asyncio
import os
import pty
import resource
import select
import signal
import statistics
import struct
import subprocess
import sys
import tempfile
import termios
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from fcntl import ioctl
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("FRAEXP_TUI_SETTINGS", os.devnull)

from store import make
from textual.pilot import Pilot
from textual.worker import WorkerCancelled

from fraexp.tui.app import POLL_INTERVAL_S, FraexpApp
from fraexp.tui.page import Page

FRAEXP = [sys.executable, "-m", "fraexp"]
HOUR = 3600
PATIENCE = 60.0
KEYS = {
    "down": (b"\x1b[B", b"\x1b["),
    "page down": (b"\x1b[6~", b"rows 35-68 "),
    "up": (b"\x1b[A", b"\x1b["),
    "space": (b" ", b"\x1b["),
    "another page down": (b"\x1b[6~", b"rows 69-102 "),
    "last page": (b"G", b"rows 99,967-100,000 of"),
    "first page": (b"g", b"rows 1-34 "),
}
"""What a key sends, and what is drawn then; of one that moves the cursor, anything."""
STUDY = """
title = "Many short sweeps"
machine = "linear_motor_table"
excitation = { name = "stepped_sine", amplitude = 75.0, points = 1, min_frequency = 100.0, max_frequency = 101.0 }
estimator = { name = "conventional" }

[grid]
"excitation.amplitude" = [AMPLITUDES]
"""


def row(what: str, value: float, unit: str, bound: float) -> bool:
    """Print a figure with its bound; return whether the bound is missed."""
    missed = not value <= bound
    print(f"{what:<72s}{value:9.3f} {unit} ({bound:g})" + (" MISSED" if missed else ""), flush=True)
    return missed


@contextmanager
def shown(folder: Path, rows: int = 40, columns: int = 120) -> Iterator[int]:
    """Run ``fraexp tui`` in a pseudo-terminal; yield the end that reads what it draws and takes keys."""
    master, slave = pty.openpty()
    ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
    environment = os.environ | {"TERM": "xterm-256color", "COLORTERM": "truecolor"}
    process = subprocess.Popen(
        [*FRAEXP, "tui", f"--workspace={folder}"], stdin=slave, stdout=slave, stderr=slave, env=environment,
        start_new_session=True,
    )  # fmt: skip
    os.close(slave)
    try:
        yield master
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
        os.close(master)


def wait_for(master: int, text: bytes) -> None:
    """Read what is drawn until a text is among it."""
    seen, end = b"", time.monotonic() + PATIENCE
    while text not in seen:
        if not select.select([master], [], [], max(end - time.monotonic(), 0))[0]:
            raise SystemExit(f"{text!r} was not drawn within {PATIENCE:g} s")
        seen += os.read(master, 65536)


def drain(master: int) -> None:
    """Take away what is drawn, so that whoever draws need not wait."""
    while select.select([master], [], [], 0)[0]:
        os.read(master, 65536)


def first_paint(folder: Path, runs: int) -> tuple[float, float]:
    """Return the median times [s] from the start of ``fraexp tui`` to its first frame, and to the list of studies."""
    frames, lists = [], []
    for _ in range(runs + 1):  # each a fresh process
        began = time.perf_counter()
        with shown(folder) as master:
            wait_for(master, b"Studies")
            frames.append(time.perf_counter() - began)
            wait_for(master, b"quick")
            lists.append(time.perf_counter() - began)
    return statistics.median(frames[1:]), statistics.median(lists[1:])


def in_pilot(folder: Path, steps: Callable[[FraexpApp, Pilot[None]], "asyncio.Future[float]"]) -> float:
    """Drive an application without a terminal, and return what the steps return."""

    async def drive() -> float:
        app = FraexpApp(folder)
        async with app.run_test(size=(120, 40)) as pilot:
            while app.current_mode != "studies" or not app.screen.is_mounted:
                await pilot.pause(0.02)
            return await steps(app, pilot)

    return asyncio.run(drive())


def key_times(folder: Path, rounds: int) -> dict[str, float]:
    """Return the median time [s] from a key to the repaint in the table of all sweeps, by key, and over all keys."""
    times: dict[str, list[float]] = {key: [] for key in KEYS}
    with shown(folder) as master:
        wait_for(master, b"Studies")
        time.sleep(2.0)
        os.write(master, b"w")
        wait_for(master, b" of 100,000")
        time.sleep(2.0)
        for _ in range(rounds):
            for name, (key, drawn) in KEYS.items():
                drain(master)
                began = time.perf_counter()
                os.write(master, key)
                wait_for(master, drawn)
                times[name].append(time.perf_counter() - began)
                time.sleep(0.25)
    every = sorted(value for values in times.values() for value in values)
    found = {name: statistics.median(values) for name, values in times.items()}
    return found | {"median of all": statistics.median(every), "95 % of all": statistics.quantiles(every, n=20)[-1]}


async def growth(app: FraexpApp, pilot: Pilot[None]) -> float:
    """Return the growth of memory [MB] over the polls of an hour, each of which reads the page again."""
    await pilot.press("r")

    async def looks(count: int) -> None:
        for _ in range(count):
            await app.poll_database()
            if isinstance(app.screen, Page):
                app.screen.reload()
                with suppress(WorkerCancelled):  # by the next look, as in life
                    await app.workers.wait_for_complete()

    await looks(500)
    before = memory()
    await looks(round(HOUR / POLL_INTERVAL_S))
    return memory() - before


def memory() -> float:
    """Return the memory of this process [MB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6


def run_time(folder: Path, watchers: int) -> float:
    """Return the time [s] of a run while so many terminals show it."""
    command = [*FRAEXP, "run", "many", f"--workspace={folder}", "--rerun=all", "--executor=serial"]
    with ExitStack() as stack:
        masters = [stack.enter_context(shown(folder)) for _ in range(watchers)]
        for master in masters:
            wait_for(master, b"Studies")
            os.write(master, b"r")
            wait_for(master, b"fraexp list")
        began = time.perf_counter()
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        opened = False
        while process.poll() is None:
            time.sleep(0.02)
            for master in masters:
                drain(master)
                if not opened and time.perf_counter() - began > 2.0:
                    os.write(master, b"\r")
            opened = opened or time.perf_counter() - began > 2.0
        return time.perf_counter() - began


def slowdown(folder: Path, pairs: int, sweeps: int) -> float:
    """Return the ratio of the times of a run with two terminals that show it to those without, pair by pair."""
    amplitudes = ", ".join(f"{50 + 0.001 * number:.3f}" for number in range(sweeps))
    (folder / "studies").mkdir()
    (folder / "studies" / "many.toml").write_text(STUDY.replace("AMPLITUDES", amplitudes))
    run_time(folder, 0)
    return statistics.median(run_time(folder, 2) / run_time(folder, 0) for _ in range(pairs))


def main() -> int:
    """Print all figures; return 1 if a bound is missed."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--reduced", action="store_true", help="fewer runs")
    few = options.parse_args().reduced
    missed = 0
    with tempfile.TemporaryDirectory() as name:
        empty, full, busy = (Path(name) / part for part in ("empty", "full", "busy"))
        for folder in (empty, full, busy):
            folder.mkdir()
        make(str(full / "results.db"))
        for folder, what in (empty, "no database"), (full, "100,000 sweeps"):
            frame, listed = first_paint(folder, 3 if few else 7)
            missed += row(f"fraexp tui with {what}, start to first paint, fresh process", frame, "s", 1.0)
            missed += row(f"fraexp tui with {what}, start to the list of studies", listed, "s", 2.0)
        for key, value in key_times(full, 4 if few else 10).items():
            missed += row(f"key to repaint, 100,000 sweeps in the table: {key}", value, "s", 0.1)
        ratio = slowdown(busy, 3 if few else 7, 1000 if few else 3000)
        missed += row("a run watched by two terminals over an unwatched one", ratio, "", 1.05)
        missed += row("growth of memory over the polls of an hour", in_pilot(busy, growth), "MB", 5.0)
    print(f"{missed} missed")
    return min(missed, 1)


if __name__ == "__main__":
    sys.exit(main())
