"""Give `fraexp check` and `fraexp run` friction laws that do harm, and look at how each ends.

    python benchmarks/hostile_laws.py                              all of them, about half an hour
    python benchmarks/hostile_laws.py --law nan raises             some of them
    python benchmarks/hostile_laws.py --reduced                    each fifth
    python benchmarks/hostile_laws.py --command run                without the checks, or only them

Each law is dropped into a workspace of its own, checked, and run on the paper's machine in a worker process. Each
command must end by itself, with an exit code that says so, one line that names the law (with its line, its check or its
file) and nothing stored as ok; it must never be silent for a minute.
"""

import json
import queue
import re
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import NamedTuple

from harness import ROOT, Bench, run

sys.path.insert(0, str(ROOT))
from tests.testing.harmful_laws import LAWS

MAX_SILENCE_S = 60.0
"""Greatest time without a line of output [s], on a processor that is not shared."""
GIVE_UP_S = 300.0
"""Time after which a command is ended, and counts as one that hangs [s]."""

STUDY = """
machine = "linear_motor_table"
friction = {{ name = "{name}" }}
excitation = {{ name = "stepped_sine", amplitude = 40.0, points = 3, min_frequency = 20, max_frequency = 200 }}
estimator = {{ name = "conventional" }}
"""


class Ending(NamedTuple):
    """How a command ended."""

    code: int | None
    """Exit code; None if it was given up."""
    output: str
    seconds: float
    silence: float
    """Longest time without a line [s]."""


def execute(folder: Path, *arguments: str) -> Ending:
    """Run a command in a folder, and return how it ended."""
    began = last = time.monotonic()
    silence, lines, text = 0.0, queue.SimpleQueue[str | None](), []
    with subprocess.Popen(
        [sys.executable, "-m", "fraexp", *arguments], cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, text=True, errors="replace",
    ) as process:  # fmt: skip

        def read() -> None:
            for line in process.stdout or ():
                lines.put(line)
            lines.put(None)

        threading.Thread(target=read, daemon=True).start()
        while True:
            try:
                line = lines.get(timeout=max(GIVE_UP_S - (time.monotonic() - began), 0.0))
            except queue.Empty:
                process.kill()
                return Ending(None, "".join(text), time.monotonic() - began, time.monotonic() - last)
            silence, last = max(silence, time.monotonic() - last), time.monotonic()
            if line is None:
                break
            text.append(line)
    return Ending(process.returncode, "".join(text), time.monotonic() - began, silence)


def stored_as_ok(folder: Path) -> int:
    """Return how many sweeps of a workspace are stored as ok."""
    if not (folder / "results.db").exists():
        return 0
    command = [sys.executable, "-m", "fraexp", "list", "outcome=ok", "--json"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    return len(json.loads(done.stdout)["sweeps"]) if done.returncode == 0 else -1


def named_line(name: str, output: str) -> str:
    """Return the line that names the law, and says where and what; empty if there is none."""
    place = re.compile(rf"\({name}\.py, line \d+\)|{name}\.py|check '\w+'|state_size")
    lines = [line.strip() for line in output.splitlines() if name in line and place.search(line)]
    said = [
        line
        for line in lines
        if re.search(r"expected|fails|failed: |wrote|read |writes|cannot|not a finite|ended", line)
    ]
    return said[0] if said else ""


def faults(name: str, kind: str, ending: Ending, folder: Path) -> list[str]:
    """Return what is wrong with an ending."""
    found = []
    if ending.code is None:
        found.append("HANGS")
    elif ending.code <= 0 or ending.code == 70:
        found.append(f"EXIT {ending.code}")
    if "Traceback (most recent call last)" in ending.output:
        found.append("TRACEBACK")
    if ending.silence > MAX_SILENCE_S:
        found.append(f"SILENT {ending.silence:.0f} s")
    if not named_line(name, ending.output):
        found.append("UNNAMED")
    if kind == "run" and (stored := stored_as_ok(folder)):
        found.append(f"{stored} STORED AS OK")
    return found


def attacks(bench: Bench) -> None:
    """How a check and a run of each law end."""
    for name in bench.options.law or list(LAWS)[:: 5 if bench.reduced else 1]:
        with tempfile.TemporaryDirectory() as folder:
            _attack(bench, name, Path(folder))


def _attack(bench: Bench, name: str, folder: Path) -> None:
    study = STUDY.format(name=name)
    if name.endswith("_5000"):
        study = study.replace("points = 3", "points = 3, min_record_time = 30")
    for part, file, text in (("plugins", f"{name}.py", LAWS[name].source(name)), ("studies", "hostile.toml", study)):
        (folder / part).mkdir()
        (folder / part / file).write_text(text, encoding="utf-8")
    commands = {"check": ["check", name], "run": ["run", "hostile", "--executor", "processes:1"]}
    for kind in bench.options.command:
        ending = execute(folder, *commands[kind])
        wrong = faults(name, kind, ending, folder)
        line = named_line(name, ending.output) or (ending.output.strip().splitlines() or ["nothing said"])[-1]
        bench.row(f"{name}, {kind}", f"{ending.seconds:6.1f} s {' '.join(wrong):<12s} {line[:220]}", not wrong)


if __name__ == "__main__":
    run(__doc__, attacks, law=[], command=["check", "run"])
