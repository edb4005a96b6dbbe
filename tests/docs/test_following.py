"""What the pages tell people to type, typed."""

import re
from itertools import dropwhile
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from tests.docs.conftest import MAKE_RUN, ROOT, Follow, blocks, commands
from tests.records.strangers_files import check_strangers, write_strangers

NEAR = {"1 Hz": 3.0}
"""How far the README's numbers may be off [dB] where the scale hides the motion; elsewhere half of what they show."""


def multisine(periods: int, samples: int) -> np.ndarray:
    lines = np.arange(1, samples // 4)
    angle = 2 * np.pi * np.outer(np.arange(samples), lines) / samples
    wave = np.cos(angle + np.random.default_rng(1).uniform(0, 2 * np.pi, lines.size)).sum(axis=1)
    return np.tile(wave, periods)


def test_the_readme(follow: Follow, tmp_path: Path) -> None:
    u = multisine(4, 2500)
    rows = np.column_stack([u, 0.5 * np.roll(u, 3)])
    np.savetxt(tmp_path / "bench.csv", rows, delimiter=",", header="current,angle", comments="")
    printed = follow("README.md")
    assert (tmp_path / "fig12.pdf").stat().st_size > 1000
    assert (tmp_path / "fig12.html").read_text("utf-8").count("<table") == 2, "results and inputs"
    assert (tmp_path / "studies/bench.toml").exists()
    shown = next(block.text for block in blocks("README.md") if block.language == "text")
    compare_tables(shown.splitlines(), printed[MAKE_RUN].splitlines())


def compare_tables(shown: list[str], printed: list[str]) -> None:
    """Compare two tables but for their keys, and but for rounding."""
    assert shown[:2] == printed[:2]
    titles = [title for title in shown[1].split("  ") if title and title.strip() != "message"]
    for expected, found in zip(shown[2:6], printed[2:6], strict=True):
        numbers = len(titles)
        assert " ".join(found.split()[numbers:]).startswith(" ".join(expected.split()[numbers:]).rstrip("…"))
        pairs = zip(titles, expected.split()[:numbers], found.split()[:numbers], strict=True)
        for title, one, other in list(pairs)[1:]:
            if title.strip().endswith(" Hz"):
                assert float(one) == pytest.approx(float(other), abs=NEAR.get(title.strip(), 0.01)), title
            else:
                assert one == other
    assert shown[-2].partition("failed")[0] == printed[-2].partition("failed")[0]
    assert shown[-1] == printed[-1]


@pytest.mark.thorough
def test_the_page_on_python(follow: Follow, tmp_path: Path) -> None:
    follow("docs/python.md")
    assert (tmp_path / "quick.pdf").stat().st_size > 1000
    assert (tmp_path / "studies/amplitudes.toml").exists()


@pytest.mark.thorough
def test_the_page_on_studies(follow: Follow) -> None:
    printed = follow("docs/studies.md")
    first = printed["fraexp run drive wrong"]
    assert first.count(" complete: ") == 2
    assert " diverged " not in first
    assert " complete: " in printed["fraexp run chain"]
    assert "80 reused" in printed["fraexp run tolerances --set monte_carlo.count=60"]


@pytest.mark.thorough
def test_the_page_on_figures_and_reports(follow: Follow, tmp_path: Path) -> None:
    follow("docs/figures-and-reports.md")
    assert (tmp_path / "report.html").exists()


@pytest.mark.thorough
def test_the_tutorial(follow: Follow) -> None:
    printed = follow("docs/tutorial.md")
    for shown in [block.text for block in blocks("docs/tutorial.md") if block.text.startswith("error against")]:
        tables = [table.partition("\n\n")[0] for table in printed.values() if table.startswith("error against")]
        assert any(same_numbers(shown, table) for table in tables), shown
    for study in ("paper/fig08_identified", "autonomous"):
        assert re.search(r"run \d+ complete: .*, 0 failed", printed[f"fraexp run {study}"])
    assert all(number in printed["fraexp run autonomous"] for number in ("17.8999 ± 0.001", "17.902 ± 0.01", "38.80"))


def same_numbers(shown: str, printed: str) -> bool:
    """Compare two tables of errors in dB but for keys and rounding."""
    rows = [[line.split() for line in table.splitlines()[2:]] for table in (shown, printed)]
    if [len(row) for row in rows[0]] != [len(row) for row in rows[1]]:
        return False
    pairs = [pair for one, other in zip(*rows, strict=True) for pair in zip(one[1:], other[1:], strict=True)]
    return all(one == other or float(one) == pytest.approx(float(other), rel=0.01, abs=0.02) for one, other in pairs)


@pytest.mark.thorough
def test_the_page_on_records(follow: Follow, tmp_path: Path) -> None:
    u = multisine(4, 2500)
    columns = {"iq_adx": u, "theta_mx": 0.5 * np.roll(u, 3), "theta_my": -0.1 * np.roll(u, 5)}
    scipy.io.savemat(tmp_path / "bench.mat", columns)
    write_strangers(tmp_path)
    printed = follow("docs/records.md")
    listed = next(block.text for block in blocks("docs/records.md") if block.language == "console")
    assert printed["fraexp import drive.mat"] == listed
    check_strangers(tmp_path)
    assert "run 1 complete: 2 sweeps, 2 computed" in next(iter(printed.values()))
    assert "run 2 complete: 2 sweeps, 2 computed" in printed["fraexp run bench"]
    assert "effective_input" in printed["fraexp run record"]


@pytest.mark.thorough
def test_the_page_on_contacts(follow: Follow) -> None:
    printed = follow("docs/contacts.md")
    for study in ("drive", "tables"):
        assert re.search(r"run \d complete: \d+ sweeps?, \d+ computed", printed[f"fraexp run {study}"])


@pytest.mark.thorough
def test_the_page_on_writing_plugins(follow: Follow, tmp_path: Path) -> None:
    u = multisine(3, 100)
    np.column_stack([u, np.roll(u, 2)]).tofile(tmp_path / "bench.raw")
    printed = follow("docs/writing-a-plugin.md")
    assert printed["fraexp plugins element"].startswith("friction element  version 1")
    assert "third harmonic" in printed["fraexp run own_machine own_multisine"]
    assert "  expected  odd " in printed["fraexp check one_way"]
    assert (tmp_path / "fraexp-other-law/fraexp_other_law.py").is_file()


@pytest.mark.thorough
def test_the_page_on_the_command_line(follow: Follow, tmp_path: Path) -> None:
    follow("docs/command-line.md")
    assert '"response"' not in (tmp_path / "quick.json").read_text("utf-8")
    assert '"response"' in (tmp_path / "run.json").read_text("utf-8")


@pytest.mark.thorough
def test_a_record_is_refused_in_the_words_of_its_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    texts = [block.text for block in blocks("docs/records.md") if block.language == "text"]
    head, *sentences = dropwhile(lambda text: not text.startswith("#"), texts)
    record = ROOT / "studies/records/table_stepped_sine.csv"
    assert record.read_text("utf-8").startswith(head)
    changes = (["y=positio [um]"], ["y=position [um]", "--sample-rate", "1900", "--time", "time"])
    for change, expected in zip(changes, sentences[0].splitlines()[: len(changes)], strict=True):
        assert main(["import", str(record), "--channel", "u=thrust", "--channel", *change]) == ExitCode.USAGE
        assert capsys.readouterr().err.rstrip().endswith(expected)
    assert list(tmp_path.iterdir()) == []


def test_shell_blocks_are_understood() -> None:
    found = [line for block in blocks("README.md") if block.language == "sh" for line in commands(block)]
    assert found[0] == MAKE_RUN
    assert all(line.startswith("fraexp ") for line in found)
    assert not any("#" in line for line in found)


@pytest.mark.thorough
def test_the_page_on_measuring(follow: Follow, tmp_path: Path) -> None:
    printed = follow("docs/measuring.md")
    assert "12 points, about" in printed["fraexp measure simulated_axis --dry-run"]
    assert " complete: 2 sweeps, 2 computed" in printed["fraexp measure simulated_axis"]
    assert (tmp_path / "axis.csv").exists()
    assert (tmp_path / "plugins/my_axis.py").exists()


@pytest.mark.thorough
def test_the_page_on_the_controller(follow: Follow, tmp_path: Path) -> None:
    printed = follow("docs/controller.md")
    assert "modulus margin" in printed["fraexp show axis_gains"]
    assert (tmp_path / "axis_gains.png").stat().st_size > 1000
    assert "FB_axis_feedback" in (tmp_path / "axis.st").read_text("utf-8")
    assert "axis_feedback_step" in (tmp_path / "axis.c").read_text("utf-8")
