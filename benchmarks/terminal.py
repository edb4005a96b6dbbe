"""Measure the waiting times in the terminal UI, and the memory that it takes.

    python benchmarks/terminal.py            medians of several runs, each in a real pseudo-terminal
    python benchmarks/terminal.py --reduced  of fewer runs

start-up  from the start of a fresh process to the first paint, and to the list of studies
keys      from a key to the repaint, with 100,000 sweeps in the table
memory    growth over the polls of an hour, without the waiting

`benchmarks/tui.py` measures the curves, and what watching a run costs.
"""

import asyncio
import os
import pty
import resource
import select
import signal
import struct
import subprocess
import sys
import tempfile
import termios
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from fcntl import ioctl
from pathlib import Path

os.environ.pop("FRAEXP_TUI_THEME", None)

import numpy as np
from harness import Bench, run
from store import make
from textual.worker import WorkerCancelled

from fraexp.tui.app import POLL_INTERVAL_S, FraexpApp
from fraexp.tui.page import Page

HOUR_S, PATIENCE_S = 3600, 60.0
PAINT_S, LIST_S, KEY_S, GROWTH_MB = 1.0, 2.0, 0.1, 5.0
"""Bounds."""
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


@contextmanager
def database() -> Iterator[Path]:
    """Yield a workspace with 100,000 sweeps."""
    with tempfile.TemporaryDirectory() as name:
        make(str(Path(name) / "results.db"))
        yield Path(name)


@contextmanager
def shown(folder: Path, rows: int = 40, columns: int = 120) -> Iterator[int]:
    """Run ``fraexp tui`` in a pseudo-terminal; yield the end that reads what it draws and takes keys."""
    master, slave = pty.openpty()
    ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
    environment = os.environ | {"TERM": "xterm-256color", "COLORTERM": "truecolor"}
    command = [sys.executable, "-m", "fraexp", "tui", f"--workspace={folder}"]
    ends = {"stdin": slave, "stdout": slave, "stderr": slave}
    process = subprocess.Popen(command, **ends, env=environment, start_new_session=True)
    os.close(slave)
    try:
        yield master
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
        os.close(master)


def wait_for(master: int, text: bytes) -> None:
    """Read what is drawn until a text is among it."""
    seen, end = b"", time.monotonic() + PATIENCE_S
    while text not in seen:
        if not select.select([master], [], [], max(end - time.monotonic(), 0))[0]:
            raise SystemExit(f"{text!r} was not drawn within {PATIENCE_S:g} s")
        seen += os.read(master, 65536)


def drain(master: int) -> None:
    """Take away what is drawn, so that whoever draws need not wait."""
    while select.select([master], [], [], 0)[0]:
        os.read(master, 65536)


def start_up(bench: Bench) -> None:
    """Medians, with no database and with 100,000 sweeps."""
    with tempfile.TemporaryDirectory() as empty, database() as full:
        for folder, what in (Path(empty), "no database"), (full, "100,000 sweeps"):
            times = []
            for _ in range(bench.options.runs + 1):  # each a fresh process
                began = time.perf_counter()
                with shown(folder) as master:
                    for text in (b"Studies", b"quick"):
                        wait_for(master, text)
                        times.append(time.perf_counter() - began)
            frame, listed = np.median(np.reshape(times, (-1, 2))[1:], axis=0)
            bench.bounded(f"{what}: first paint", float(frame), PAINT_S, "s")
            bench.bounded(f"{what}: list of studies", float(listed), LIST_S, "s")


def keys(bench: Bench) -> None:
    """Medians of each key, and quantiles of all of them together."""
    times: dict[str, list[float]] = {key: [] for key in KEYS}
    with database() as folder, shown(folder) as master:
        wait_for(master, b"Studies")
        time.sleep(2.0)
        os.write(master, b"w")
        wait_for(master, b" of 100,000")
        time.sleep(2.0)
        for _ in range(bench.options.runs):
            for name, (key, drawn) in KEYS.items():
                drain(master)
                began = time.perf_counter()
                os.write(master, key)
                wait_for(master, drawn)
                times[name].append(time.perf_counter() - began)
                time.sleep(0.25)
    for name, values in times.items():
        bench.bounded(name, float(np.median(values)), KEY_S, "s")
    for quantile in (0.5, 0.95):
        value = float(np.quantile(np.concatenate(list(times.values())), quantile))
        bench.bounded(f"{100 * quantile:g} % of all", value, KEY_S, "s")


def memory(bench: Bench) -> None:
    """Growth over the polls of an hour, each of which reads the page again."""
    with tempfile.TemporaryDirectory() as folder:
        growth = asyncio.run(_growth(Path(folder), round(HOUR_S / POLL_INTERVAL_S / (20 if bench.reduced else 1))))
    bench.bounded("over the polls of an hour", growth, GROWTH_MB, "MB")


async def _growth(folder: Path, polls: int) -> float:
    app = FraexpApp(folder)
    async with app.run_test(size=(120, 40)) as pilot:
        while app.current_mode != "studies" or not app.screen.is_mounted:
            await pilot.pause(0.02)
        await pilot.press("r")
        before = 0.0
        for number in range(500 + polls):
            if number == 500:
                before = _resident()
            await app.poll_database()
            if isinstance(app.screen, Page):
                app.screen.reload()
                with suppress(WorkerCancelled):  # by the next poll, as in life
                    await app.workers.wait_for_complete()
        return _resident() - before


def _resident() -> float:
    """Return the memory of this process [MB]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 1e6


if __name__ == "__main__":
    run(__doc__, start_up, keys, memory, runs=(7, 3))
