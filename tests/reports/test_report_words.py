"""What a report says in words, and how it becomes a PDF."""

import shutil
from datetime import UTC, datetime
from pathlib import Path

import pytest

from fraexp.data.results import Outcome
from fraexp.errors import FraexpError
from fraexp.reports import pdf_printer
from fraexp.reports.figure_titles import run_title
from fraexp.reports.html_report import check_target
from fraexp.reports.pdf_printer import find_browser, print_page
from fraexp.reports.report_words import verdict_text
from fraexp.store import RunSummary, StoredSweep
from fraexp.store.liveness import Process

NOW = datetime(2026, 1, 1, tzinfo=UTC)


def run(state: str = "complete") -> RunSummary:
    return RunSummary(
        number=1, study="s", study_file="s.toml", command="fraexp run s", started=NOW, ended=NOW, provenance={},
        state=state, total=3, computed=3, reused=0, failed=0, process=Process("", "", 0, ""), heartbeat=NOW,
        silence=0.0, progress=None,
    )  # fmt: skip


def sweeps(*outcomes: Outcome | None) -> list[StoredSweep]:
    return [StoredSweep(f"fx1-{n}", {}, {}, {}, of, "", 1.0, NOW, "computed") for n, of in enumerate(outcomes)]


def test_the_verdict_is_in_words() -> None:
    assert verdict_text(run(), sweeps(Outcome.OK, Outcome.OK), []) == "All 2 sweeps are sound."
    mixed = sweeps(Outcome.OK, Outcome.NOT_SETTLED, None)
    assert verdict_text(run(), mixed, []) == "1 of 3 sweeps are sound, 1 not settled, 1 without a result."
    assert verdict_text(run("partial"), sweeps(Outcome.DIVERGED), []).startswith("The run is partial. The sweep is not")


@pytest.mark.parametrize(
    ("command", "title"),
    [
        ("fraexp run s", "Two amplitudes"),
        ("fraexp run s --set=excitation.amplitude=20", "s with excitation.amplitude = 20"),
        ("fraexp run s --set a=1 --set 'b=[1, 2]'", "s with a = 1, b = [1, 2]"),
        ("another 'program", "Two amplitudes"),
    ],
)
def test_a_title_says_what_the_run_has_changed(command: str, title: str) -> None:
    assert run_title("s", "Two amplitudes", command) == title


def test_without_a_browser_the_remedy_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(shutil, "which", lambda _: None)
    with pytest.raises(FraexpError, match=r"a PDF needs Chromium, Chrome or Edge .* write an .html file"):
        check_target(tmp_path / "report.pdf")


def test_a_browser_that_fails_leaves_no_file(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    broken = tmp_path / "browser"
    broken.write_text("#!/bin/sh\necho no display >&2\nexit 3\n", encoding="utf-8")
    broken.chmod(0o755)
    monkeypatch.setattr(pdf_printer, "find_browser", lambda: str(broken))
    with pytest.raises(FraexpError, match="could not print the PDF: no display"):
        print_page("<p>", tmp_path / "report.pdf")
    assert not (tmp_path / "report.pdf").exists()


@pytest.mark.thorough
def test_a_page_is_printed(tmp_path: Path) -> None:
    try:
        find_browser()
    except FraexpError:
        pytest.skip("there is no browser that prints")
    print_page("<!DOCTYPE html><title>Loops</title><p>Loops</p>", tmp_path / "report.pdf")
    content = (tmp_path / "report.pdf").read_bytes()
    assert content.startswith(b"%PDF")
    assert content.rstrip().endswith(b"%%EOF")
    assert b"/Type /Page" in content
