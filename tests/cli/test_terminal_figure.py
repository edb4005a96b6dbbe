"""Figures in the terminal."""

from pathlib import Path

import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.data.sweep import Sweep
from fraexp.views.words import short_key


def is_braille(text: str) -> bool:
    return any("\u2801" <= character <= "\u28ff" for character in text)


@pytest.fixture(autouse=True)
def narrow(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "90")
    monkeypatch.setenv("LINES", "30")


def said(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    assert main(list(words)) == ExitCode.OK
    return capsys.readouterr().out


def test_responses_are_drawn_with_their_names_and_units(
    workspace: Path, sweeps: list[Sweep], capsys: pytest.CaptureFixture[str]
) -> None:
    keys = [short_key(of.key) for of in sweeps[:2]]
    text = said(capsys, "plot", *keys, "--terminal", "--workspace", str(workspace))
    assert is_braille(text)
    assert "Magnitude [dB re 1 mm/N]" in text
    assert "Phase [deg]" in text
    names = text.splitlines()[-2:]
    assert ("scale" in names[0], "laser" in names[1]) == (True, True)
    assert "\x1b" not in text, "no colours where there is no terminal; digits distinguish the curves"
    assert ("  1 " in names[0], "  2 " in names[1]) == (True, True)


def test_curves_are_drawn_without_a_response(
    workspace: Path, sweeps: list[Sweep], capsys: pytest.CaptureFixture[str]
) -> None:
    text = said(capsys, "plot", short_key(sweeps[2].key), "--terminal", "--workspace", str(workspace))
    assert is_braille(text)
    assert "Friction force [N] over displacement" in text


def test_a_comparison_draws_the_differences(
    workspace: Path, sweeps: list[Sweep], capsys: pytest.CaptureFixture[str]
) -> None:
    keys = [short_key(of.key) for of in sweeps[:2]]
    text = said(capsys, "plot", *keys, "--kind", "difference", "--terminal", "--workspace", str(workspace))
    assert "Difference from" in text
    assert is_braille(text)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ([], "give --output FILE, or --terminal to draw here"),
        (["--terminal", "--kind", "distribution"], "distribution figures are not drawn in a terminal; write a file"),
        (["--terminal", "--group-by", "nothing"], "group by: 'nothing' is no label"),
    ],
)
def test_what_cannot_be_drawn_is_one_line(
    workspace: Path, capsys: pytest.CaptureFixture[str], options: list[str], told: str
) -> None:
    assert main(["plot", "1", *options, "--workspace", str(workspace)]) == ExitCode.USAGE
    assert told in capsys.readouterr().err
