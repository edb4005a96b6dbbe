"""Pages as they are read: their blocks in order, and a folder in which to follow them."""

import io
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from tests.waiting import HANG_TIMEOUT_S

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(
    r"(?:^<!-- (?P<mark>file: (?P<file>\S+)|run) -->\n)?^```(?P<language>\w+)\n(?P<text>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)
MAKE_RUN = "fraexp run paper/fig12"
"""What the Makefile's target `run` comes down to; tests/docs/test_pages.py compares."""


OWN_LAW = (
    """fraexp run paper/fig12 --set 'friction={name = "my_dahl", stiffness = "0.4 N/um", coulomb_force = 17.9}'"""
    " --set excitation.points="
)
PLANNED = ("fraexp run paper", "fraexp run methods/comparison")
"""Commands that are only planned: tests/views/test_html_report.py and tests/study/test_study_runs.py run them."""
REDUCED = {
    f"{OWN_LAW}20": f"{OWN_LAW}8 --executor serial",
    "fraexp fit 1": "fraexp fit KEY",
    "fraexp run amplitudes": "fraexp run amplitudes --set excitation.points=4 --executor serial",
    "fraexp run loop": "fraexp run loop --set excitation.points=4 --executor serial",
    "fraexp run quick --json": "fraexp run quick --json --set excitation.points=4 --executor serial",
}
"""Beginnings of commands that are run with fewer points or sweeps; the first one counts.

Up to eight points are computed side by side in one layout: for more of them, the law is compiled for another as well.
"""


@dataclass(frozen=True)
class Block:
    """A fenced block of a page."""

    language: str
    text: str
    file: str | None
    """Where the page tells to put it."""
    run: bool
    """Whether it is a program to run."""


def blocks(page: str) -> list[Block]:
    text = (ROOT / page).read_text("utf-8")
    return [
        Block(found["language"], found["text"], found["file"], found["mark"] == "run") for found in BLOCK.finditer(text)
    ]


def commands(block: Block) -> list[str]:
    """Return the commands of a shell block; setting up and testing are covered elsewhere."""
    joined = block.text.replace("\\\n", " ").splitlines()
    lines = [line.partition(" #")[0].strip() for line in joined]
    lines = [MAKE_RUN if line == "make run" else line for line in lines]
    return [line for line in lines if line and not line.startswith("make ")]


def reduced(command: str) -> str:
    """Return a command with a smaller study, if it is one that takes long; all others run as they are written."""
    if command in PLANNED:
        return f"{command} --dry-run"
    for long, short in REDUCED.items():
        if command == long or command.startswith((f"{long} --", f"{long} >")):
            return command.replace(long, short, 1)
    return command


Follow = Callable[[str], dict[str, str]]


@pytest.fixture
def follow(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Follow:
    """Do what a page says, in its order; returns what each command has printed.

    A shell runs the first command of a page, and those for which it does more than split words. The others, and
    programs, run in this process, which has imported already what each process would import again.
    """
    monkeypatch.chdir(tmp_path)

    def run(page: str) -> dict[str, str]:
        printed: dict[str, str] = {}
        for block in blocks(page):
            if block.file:
                target = tmp_path / block.file
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_text(block.text, encoding="utf-8")
            elif block.run:
                exec(compile(block.text, page, "exec"), {"__name__": "__main__"})
            elif block.language == "sh":
                for line in commands(block):
                    command = reduced(line).replace("KEY", some_key(tmp_path))
                    if printed and not needs_shell(command):
                        printed[line] = call(shlex.split(command)[1:])
                    else:
                        printed[line] = execute(["bash", "-c", command], tmp_path)
        return printed

    return run


def needs_shell(command: str) -> bool:
    """Say whether a command is more than fraexp with its arguments."""
    words = shlex.shlex(command, posix=True, punctuation_chars=True)
    words.whitespace_split = True
    return shlex.split(command)[0] != "fraexp" or any(set(word) <= set("();<>|&") for word in words) or "$" in command


def call(arguments: list[str]) -> str:
    """Run a command in this process, and return what it prints."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = main(arguments)
    assert code == ExitCode.OK, f"{arguments}\n{out.getvalue()}\n{err.getvalue()}"
    return out.getvalue()


def execute(command: list[str], folder: Path) -> str:
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        command,
        cwd=folder,
        env={**os.environ, "PATH": path},
        capture_output=True,
        text=True,
        check=False,
        timeout=HANG_TIMEOUT_S,
    )
    assert done.returncode == 0, f"{command[-1]}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def some_key(folder: Path) -> str:
    """Return the first digits of a sweep's key, in place of KEY."""
    if not (folder / "results.db").exists():
        return "KEY"
    from fraexp.store import Store

    with Store.open(str(folder / "results.db"), read_only=True) as store:
        return store.sweeps(1)[0].key[4:12]
