"""The first minute as the README tells it, in a real terminal: launch the quick study, watch it, compare its sweeps."""

import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from fraexp.measurement.measured_points import MeasurementFiles
from fraexp.store import Store
from tests.waiting import HANG_TIMEOUT_S

ROOT = Path(__file__).parents[2]
TMUX = shutil.which("tmux")
pytestmark = [pytest.mark.thorough, pytest.mark.skipif(TMUX is None, reason="there is no tmux on this machine")]


class Terminal(NamedTuple):
    """A terminal in which somebody types."""

    server: str

    def tmux(self, *arguments: str) -> str:
        command = [str(TMUX), "-L", self.server, *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=HANG_TIMEOUT_S).stdout

    def type(self, *keys: str) -> None:
        self.tmux("send-keys", "-t", "fraexp", *keys)

    @property
    def text(self) -> str:
        return self.tmux("capture-pane", "-p", "-t", "fraexp")

    def shows(self, *texts: str) -> str:
        return self.until(lambda shown: all(text in shown for text in texts))

    def until(self, holds: Callable[[str], bool]) -> str:
        end = time.monotonic() + HANG_TIMEOUT_S
        while not holds(shown := self.text):
            assert time.monotonic() < end, shown
            time.sleep(0.1)
        return shown


@pytest.fixture
def terminal(tmp_path: Path) -> Iterator[Terminal]:
    width, height = "80", "24"
    found = Terminal(f"fraexp-{os.getpid()}-{tmp_path.name}")  # not the server of the test before, which still ends
    place = f"{sys.executable} -m fraexp tui --workspace={tmp_path}"
    environment = ["-e", "FRAEXP_TUI_THEME=", "-e", "LANG=C.UTF-8", "-e", "LC_ALL=C.UTF-8"]
    checkout = [f"-ePYTHONPATH={os.environ['PYTHONPATH']}"] if "PYTHONPATH" in os.environ else []
    start = ["-f", os.devnull, "new-session", "-d", "-s", "fraexp", "-x", width, "-y", height, *environment, *checkout]
    found.tmux(*start, f"{place}; echo left with $?; cat")
    yield found
    found.tmux("kill-server")


def test_the_first_minute_is_as_the_readme_tells(terminal: Terminal, tmp_path: Path) -> None:
    terminal.shows("quick", "Enter opens 'quick'")
    terminal.type("Enter")
    terminal.shows("4 sweeps: 0 reused, 4 to compute")
    terminal.type("Enter")
    terminal.shows("complete", "4 computed")
    terminal.type("c")
    terminal.shows("conventional", "effective_input", "12 N", "75 N", "dB")
    terminal.until(lambda shown: sum("⠁" <= letter <= "⣿" for letter in shown) > 50)  # of which curves are drawn
    terminal.type("d")
    terminal.shows("fraexp plot", "against P(jω)")
    terminal.type("q")
    terminal.shows("left with 0")
    with Store.open(str(tmp_path / "results.db"), read_only=True) as store:
        assert [run.state for run in store.runs()] == ["complete"]
        assert store.runs()[0].computed == 4


def test_a_measurement_is_watched_and_stopped_by_a_key(terminal: Terminal, tmp_path: Path) -> None:
    axis = (ROOT / "studies/simulated_axis.toml").read_text("utf-8")
    studies = tmp_path / "studies"
    studies.mkdir()
    in_real_time = axis.replace('{ name = "simulated" }', '{ name = "simulated", speed = 1 }')
    (studies / "slow_axis.toml").write_text(in_real_time, "utf-8")
    terminal.shows("quick", "Enter opens 'quick'")
    terminal.type("/", *"slow_axis", "Enter", "m")
    terminal.shows("12 points, about", "of 20 mm", "150 Hz")
    terminal.type("Enter")
    terminal.shows("will move", "y yes")
    terminal.type("y")
    terminal.until(lambda shown: re.search(r"last +[2-9]/12|[3-9] of 12 points", shown) is not None)
    terminal.until(lambda shown: sum("⠁" <= letter <= "⣿" for letter in shown) > 50)
    terminal.type("x")
    terminal.shows("R continues")
    terminal.type("q")
    terminal.shows("left with 0")
    assert 2 <= len(MeasurementFiles(tmp_path / "measurements", "slow_axis").points()) < 12
