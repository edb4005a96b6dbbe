"""Tables on a terminal: nothing is cut, whatever the width."""

import fcntl
import os
import pty
import re
import struct
import subprocess
import sys
import termios
from pathlib import Path

import pytest

from fraexp.data.sweep import Sweep
from fraexp.views.words import short_key


def on_a_terminal(columns: int, *arguments: str) -> str:
    """Return what a command prints on a terminal of that many columns."""
    main, other = pty.openpty()
    fcntl.ioctl(other, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    environment = {key: value for key, value in os.environ.items() if key not in ("COLUMNS", "LINES")}
    command = [sys.executable, "-m", "fraexp", *arguments]
    variables = {**environment, "TERM": "xterm"}
    with subprocess.Popen(command, stdin=other, stdout=other, stderr=subprocess.DEVNULL, env=variables):
        os.close(other)
        printed = b""
        while part := _read(main):
            printed += part
    os.close(main)
    return re.sub(r"\x1b\[[\d;]*m", "", printed.decode())


def _read(terminal: int) -> bytes:
    try:
        return os.read(terminal, 4096)
    except OSError:  # the other side has closed
        return b""


@pytest.mark.parametrize("columns", [80, 40])
@pytest.mark.thorough
def test_a_narrow_terminal_shows_every_digit(columns: int, workspace: Path, sweeps: list[Sweep]) -> None:
    key = short_key(sweeps[0].key)
    common = ("--workspace", str(workspace))
    run = on_a_terminal(columns, "show", "1", *common)
    points = on_a_terminal(columns, "show", key, *common).partition("response y/u")[2]
    compared = on_a_terminal(columns, "compare", "1", *common)
    assert "…" not in run + points + compared
    for word in ("37/40", "-0.12", "-23.72", "-35.52", "diverged", r"laser\x1b[31m", "ZeroDivisionError:"):
        assert word in run
    for word in ("frequency", "magnitude", "distortion", "-52.041", "-180.00", "3e-05"):
        assert word in points
    for word in (*(short_key(sweep.key) for sweep in sweeps), "record.channels.y.column", "6.0206"):
        assert word in compared
    assert [line for line in points.splitlines() if len(line) > columns] == []
