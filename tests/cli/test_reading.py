import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.data.results import Outcome, Result
from fraexp.data.sweep import Sweep
from fraexp.store import Store
from fraexp.views.words import short_key
from tests.cli.conftest import fill, response_of

PublishedNumber = Callable[..., tuple[str, str]]


@pytest.fixture
def printed(workspace: Path, capsys: pytest.CaptureFixture[str]) -> PublishedNumber:
    def run(*arguments: str) -> tuple[str, str]:
        assert main([*arguments, "--workspace", str(workspace)]) == ExitCode.OK
        output = capsys.readouterr()
        return output.out, output.err

    return run


def document(printed: PublishedNumber, *arguments: str) -> Any:
    def refuse(constant: str) -> None:
        raise ValueError(f"{constant} is no JSON")

    return json.loads(printed(*arguments, "--json")[0], parse_constant=refuse)


def test_runs_are_listed(printed: PublishedNumber) -> None:
    header, row = printed("list")[0].splitlines()
    assert " ".join(header.split()) == "run study state sweeps computed reused failed unusable started took"
    assert row.split()[:7] == ["1", "bench", "partial", "5", "4", "0", "1"]
    (run,) = document(printed, "list")["runs"]
    assert (run["number"], run["state"], run["total"]) == (1, "partial", 5)


def test_a_run_shows_its_sweeps_and_remedies(printed: PublishedNumber, sweeps: list[Sweep]) -> None:
    out, err = printed("show", "1")
    assert "code     fraexp 0.1.0 (c0ffeec0ffee with local changes)" in out
    first = next(line for line in out.splitlines() if line.startswith(short_key(sweeps[0].key)))
    # 0.1 m/N at 1 Hz is 40 dB re 1 mm/N, falling by 40 dB per decade; 1 Hz itself had not settled: no such column.
    assert first.split()[1:8] == ["scale", "computed", "ok", "37/40", "-0.12", "-23.72", "-35.52"]
    assert "settled  10.1 Hz  39.2 Hz  77.3 Hz  gain [m/N]" in out
    assert "ZeroDivisionError: float division by zero" in out
    assert "1 not settled: raise excitation.settling_timeout" in err
    assert "1 diverged: the loop is unstable" in err


def test_a_name_from_a_file_cannot_command_the_terminal(printed: PublishedNumber, sweeps: list[Sweep]) -> None:
    for line in (["show", "1"], ["show", short_key(sweeps[1].key)], ["compare", "1"]):
        out, err = printed(*line)
        assert "\x1b" not in out + err
        assert r"laser\x1b[31m" in out


def test_a_sweep_shows_parameters_sources_metrics_and_points(printed: PublishedNumber, sweeps: list[Sweep]) -> None:
    out, err = printed("show", sweeps[0].key)
    assert "record.channels.y.column  scale" in out
    assert "record.lines              [0, ..., 19] (20 values)" in out
    assert "estimator:h1  fraexp 0.1.0, source 0123456789ab" in out
    assert "gain   0.1 m/N" in out
    points = out.partition("response y/u\n")[2].splitlines()
    assert points[0].startswith("frequency [Hz]  magnitude [dB re 1 mm/N]  phase [deg]")
    assert len(points) == 1 + 12
    assert err == "28 more frequencies; --points shows all\n"
    everything = printed("show", short_key(sweeps[0].key), "--points")[0].partition("response y/u\n")[2]
    assert len(everything.splitlines()) == 1 + 40


def test_a_sweep_as_json_has_its_numbers(printed: PublishedNumber, sweeps: list[Sweep]) -> None:
    found = document(printed, "show", sweeps[1].key[:14])
    assert (found["key"], found["outcome"]) == (sweeps[1].key, "not_settled")
    assert found["remedy"].startswith("raise excitation.settling_timeout")
    assert found["labels"] == {"record.output": "laser\x1b[31m"}
    assert found["response"]["real"][0] == pytest.approx(-0.2)
    assert len(found["response"]["frequency"]) == 40
    assert document(printed, "show", sweeps[0].key)["metrics"][1] == {"name": "delay", "value": None, "unit": "s"}


def test_a_run_as_json_has_points_only_if_asked(printed: PublishedNumber) -> None:
    assert "response" not in document(printed, "show", "1")["sweeps"][0]
    assert len(document(printed, "show", "1", "--points")["sweeps"][0]["response"]["real"]) == 40


def test_compare_shows_only_what_differs(printed: PublishedNumber, sweeps: list[Sweep]) -> None:
    keys = [short_key(sweep.key) for sweep in sweeps[:2]]
    out = printed("compare", *keys)[0]
    table, _, responses = out.partition("\n\n")
    rows = [line.split() for line in table.splitlines()]
    assert rows[0] == ["difference", *keys]
    assert ["record.channels.y.column", "scale", "laser"] in rows
    assert ["gain", "[m/N]", "0.1", "0.2"] in rows
    assert "record.hash" not in table
    assert "6.0206" in responses


def test_compare_as_json_has_the_difference_in_decibel(printed: PublishedNumber, sweeps: list[Sweep]) -> None:
    found = document(printed, "compare", sweeps[0].key, sweeps[1].key, sweeps[2].key)
    assert found["parameters"]["record.channels.y.column"] == ["scale", "laser", None]
    difference = found["responses"][0]["difference"]
    assert difference["magnitude_max"] == pytest.approx(6.0206, abs=1e-4)
    assert difference["phase_max"] == pytest.approx(0, abs=1e-9)
    assert (difference["interpolated"], difference["points"]) == (False, 37)
    assert found["responses"][1]["difference"] is None


def test_a_plot_is_drawn_once(printed: PublishedNumber, sweeps: list[Sweep], tmp_path: Path) -> None:
    target = tmp_path / "figure.svg"
    line = ["plot", sweeps[0].key, sweeps[1].key, sweeps[4].key, "-o", str(target)]
    assert printed(*line) == (f"{target}\n", "1 sweep without a result left out\n")
    drawn = target.stat().st_mtime_ns
    assert "up to date" in printed(*line)[1]
    assert target.stat().st_mtime_ns == drawn
    printed(*line, "--title", "Another")
    assert target.stat().st_mtime_ns != drawn


def test_a_study_stands_for_its_newest_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sweeps = fill(tmp_path / "results.db")
    with Store.open(str(tmp_path / "results.db")) as store:
        for study, keys in (("bench", [sweeps[0].key]), ("other", []), ("bench", [])):  # the last two are lost at once
            store.reuse(store.begin_run(study, f"{study}.toml", f"fraexp run {study}", {}, sweeps[:1]), keys)

    def shown(*line: str, err: str = "") -> str:
        assert main([*line, "--workspace", str(tmp_path)]) == ExitCode.OK
        printed = capsys.readouterr()
        assert err in printed.err
        return printed.out

    passed_over = "run 4 of bench has no results yet; run 2, the newest with results, is taken\n"
    assert shown("show", "bench", err=passed_over) == shown("show", "2") != shown("show", "1")
    assert shown("show", "other") == shown("show", "3")
    assert shown("compare", "1") == shown("compare", "1", "bench", err=passed_over)


def test_a_stored_run_is_drawn_without_the_plugin_of_its_plant(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    experiment = {"source": "loop", "plant": {"name": "gone", "version": 1}, "friction": {"name": "rolling"}}
    sweep, target = Sweep(experiment, {"name": "conventional", "version": 1}, {}), tmp_path / "figure.png"
    with Store.open(str(tmp_path / "results.db"), create=True) as store:
        run = store.begin_run("mine", "mine.toml", "fraexp run mine", {}, [sweep])
        store.save(run, [(sweep, Result(Outcome.OK, (), response_of(0.1)), {})])
        store.end_run(run, "complete")
    (tmp_path / "plugins").mkdir()
    (tmp_path / "plugins/gone.py").write_text("1/0\n")
    assert main(["plot", "mine", "-o", str(target), "--workspace", str(tmp_path)]) == ExitCode.OK
    left_out = capsys.readouterr().err
    assert left_out.startswith("the plant's own response is left out: no plant is called 'gone'; ")
    assert left_out.endswith("ZeroDivisionError: division by zero (gone.py, line 1)\n")
    assert target.is_file()


def test_one_sweep_is_not_compared_and_one_without_a_result_not_plotted(
    workspace: Path, sweeps: list[Sweep], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for line, sentence in (
        (["compare", sweeps[0].key, short_key(sweeps[0].key)], "found one sweep; expected at least two"),
        (["plot", sweeps[4].key, "-o", str(tmp_path / "a.png")], "nothing to plot in 1 sweep"),
    ):
        assert main([*line, "--workspace", str(workspace)]) == ExitCode.USAGE
        assert sentence in capsys.readouterr().err


@pytest.mark.thorough
def test_responses_of_two_units_are_two_figures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    speed = Sweep({"source": "record"}, {"name": "h1", "output": "v"}, {"estimator.output": "v"})
    position = Sweep({"source": "record"}, {"name": "h1", "output": "y"}, {"estimator.output": "y"})
    units = ((position, "m/N"), (speed, "m/s/N"))

    def save(gain: float, elapsed: float) -> None:
        results = [Result(Outcome.OK, response=replace(response_of(gain), unit=u), elapsed=elapsed) for _, u in units]
        with Store.open(str(tmp_path / "results.db"), create=True) as store:
            run = store.begin_run("bench", "bench.toml", "", {}, [position, speed])
            store.save(run, [(sweep, of, {}) for (sweep, _), of in zip(units, results, strict=True)])
            store.end_run(run, "complete")

    save(0.1, elapsed=1.0)
    target = tmp_path / "figure.png"
    line = ["plot", "1", "-o", str(target), "--workspace", str(tmp_path)]
    assert main(line) == ExitCode.OK
    second = tmp_path / "figure-2.png"
    assert capsys.readouterr().out == f"{target}\n{second}\n"
    assert target.read_bytes() != second.read_bytes()
    assert main(line) == ExitCode.OK
    assert capsys.readouterr().err == "the figures are up to date\n"
    save(0.1, elapsed=2.0)
    assert main(line) == ExitCode.OK
    assert capsys.readouterr().err == "the figures are up to date\n", "they are computed again without a change"
    save(0.2, elapsed=2.0)
    assert main(line) == ExitCode.OK
    assert capsys.readouterr().out == f"{target}\n{second}\n"
    assert main(["show", short_key(speed.key), "--workspace", str(tmp_path)]) == ExitCode.OK
    titles = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("frequency [Hz]"))
    assert {"input", "output", "distortion"} <= set(titles.split())
    assert "[m]" not in titles, "which part of m/s/N is whose is not known"
