"""No line of the command line is wider than the terminal."""

import re
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rich.cells import cell_len

from fraexp.cli.main import main
from fraexp.cli.output import fit_lines
from fraexp.data.findings import remarks
from fraexp.data.results import Outcome, Result
from fraexp.data.sweep import Sweep
from fraexp.store import Store
from fraexp.views.words import short_key
from tests.cli.conftest import response_of

LONG = "an estimator of the effective control input with a very long name, of the second kind"
COMMANDS = (
    ["list"], ["list", "--sweeps"], ["list", "state:unusable"], ["list", "--studies"], ["show", "1"], ["show", "2"],
    ["show", "KEY"], ["show", "KEY", "--points"], ["compare", "1"], ["compare", "2"],
    ["compare", "1", "--against", "plant"], ["plugins"], ["show", "nothing-of-that-name"],
    ["list", "--sort", "stretched"],
    ["tag", "1", "a tag that is wrong"],
)  # fmt: skip

QUICK = (["list"], ["show", "1"], ["show", "KEY"], ["compare", "2"])


class Terminal:
    """A stream of a terminal that remembers what was printed."""

    encoding = "utf-8"

    def __init__(self) -> None:
        self.text = ""

    def write(self, text: str) -> int:
        self.text += text
        return len(text)

    def flush(self) -> None:
        pass

    def isatty(self) -> bool:
        return True


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run 1: few sweeps with long names and messages. Run 2: 45 sweeps."""
    folder = tmp_path_factory.mktemp("a-workspace-in-a-folder-whose-name-does-not-fit-into-a-line-of-sixty-cells")
    few = [
        Sweep({"source": "record", "record": {"hash": name * 30}}, {"name": "h1"}, {"estimator": name, "力.μ": value})
        for name, value in (("h1", 1.0), (LONG, 2e-9), ("摩擦" * 40, 3.5))
    ]
    many = [Sweep({"source": "record", "gain": gain}, {"name": "h2"}, {"record.gain": gain}) for gain in range(45)]
    with Store.open(str(folder / "results.db"), create=True) as store:
        for name, sweeps in (("few", few), ("a-study-with-a-name-that-has-many-parts/many", many)):
            run = store.begin_run(name, f"studies/{name}.toml", f"fraexp run {name}", {"fraexp": "0.1"}, sweeps)
            told = Result(Outcome.NOT_SETTLED, remarks(f"{LONG}: 3 of 40 frequencies"), response_of(0.1))
            store.save(run, [(sweep, told, {}) for sweep in sweeps])
            store.end_run(run, "partial")
    return folder


def printed(folder: Path, command: Sequence[str], width: int) -> str:
    with Store.open(str(folder / "results.db"), read_only=True) as store:
        key = store.sweeps(1)[0].key[4:12]
    streams, terminal = (sys.stdout, sys.stderr), Terminal()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", str(width))
        patch.chdir(folder)
        sys.stdout = sys.stderr = terminal  # type: ignore[assignment]
        try:
            main([key if word == "KEY" else word for word in command])
        except SystemExit:
            pass
        finally:
            sys.stdout, sys.stderr = streams
    return terminal.text


@pytest.mark.parametrize(
    "command", [pytest.param(of, marks=() if of in QUICK else pytest.mark.thorough, id=" ".join(of)) for of in COMMANDS]
)
@settings(max_examples=3, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(width=st.integers(60, 200))
def test_no_line_is_wider_than_the_terminal(folder: Path, command: Sequence[str], width: int) -> None:
    text = printed(folder, command, width)
    assert text
    assert [line for line in text.splitlines() if cell_len(_plain(line)) > width] == []


@pytest.mark.thorough
@pytest.mark.parametrize("columns", [80, 40])
def test_a_narrow_terminal_shows_every_digit(columns: int, workspace: Path, sweeps: list[Sweep]) -> None:
    run = _plain(printed(workspace, ["show", "1"], columns))
    points = _plain(printed(workspace, ["show", "KEY"], columns)).partition("response y/u")[2]
    compared = _plain(printed(workspace, ["compare", "1"], columns))
    assert "…" not in run + points + compared
    for word in ("37/40", "-0.12", "-23.72", "-35.52", "diverged", r"laser\x1b[31m", "ZeroDivisionError:"):
        assert word in run
    for word in ("frequency", "magnitude", "distortion", "-52.041", "-180.00", "3e-05"):
        assert word in points
    for word in (*(short_key(sweep.key) for sweep in sweeps), "record.channels.y.column", "6.0206"):
        assert word in compared


def _plain(line: str) -> str:
    """Return a line without the sequences that colour it or make it bold."""
    return re.sub(r"\x1b\[[\d;]*m", "", line).rstrip()


@given(st.text(st.characters(exclude_categories=["Cc", "Cs", "Zl", "Zp"]), max_size=200), st.integers(20, 90))
def test_wrapping_keeps_all_but_the_blanks(text: str, width: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", str(width))
        found = fit_lines(text, Terminal(), "    ")  # type: ignore[arg-type]
    assert "".join(found.split()) == "".join(text.split())


def test_elsewhere_lines_stay_whole(capsys: pytest.CaptureFixture[str]) -> None:
    assert fit_lines("word " * 100, sys.stdout) == "word " * 100
