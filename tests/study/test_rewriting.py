"""Studies rewritten with the names of today: nothing else in them changes, comments included."""

import tomllib
import warnings
from pathlib import Path

import pytest

from fraexp.cli.main import main
from fraexp.components.registry import Registry
from fraexp.errors import FormerNameWarning
from fraexp.study.rewriting import rewrite
from fraexp.study.study_file import load

STUDY = """# A study of last year
title = "old"   # a title
machine = "linear_motor_table"
loop.stroke  =  0.5   # dotted

[excitation]
name = "stepped_sine"  # kept
amplitude = 12
frequencies = [
    20, # low
    40,
]

[estimator]
name = 'proposed'

[[case]]
label = "plain"
estimator = { name = "conventional", remove_delay=true }

[grid]
"loop.input_lags" = [[1e-4], [2e-4]]

[random]
count = 2
draw = [
    { paths = "loop.stroke", relative = 0.1 }, # a comment
    { paths = ["plant.frequencies.0"], deviation = "0.1 Hz", distribution = "uniform" },
]
"""
TODAY = (
    STUDY.replace("loop.stroke", "loop.divergence_limit")
    .replace("'proposed'", '"effective_input"')
    .replace("remove_delay", "refer_to_plant")
    .replace("input_lags", "input_time_constants")
    .replace("[random]", "[monte_carlo]")
    .replace("deviation =", "half_width =")
)


def test_only_names_change(tmp_path: Path, registry: Registry) -> None:
    file = tmp_path / "old.toml"
    file.write_text(STUDY, encoding="utf-8")
    with pytest.warns(FormerNameWarning):
        before = load("old", file, tmp_path, registry)
    assert set(rewrite(file, tmp_path, registry)) >= {"[random]", "loop.stroke", "loop.input_lags"}
    assert file.read_text(encoding="utf-8") == TODAY
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert load("old", file, tmp_path, registry).sweeps == before.sweeps
    assert rewrite(file, tmp_path, registry) == {}


def test_the_command_rewrites_all_studies_of_a_workspace(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], registry: Registry
) -> None:
    folder = tmp_path / "studies"
    folder.mkdir()
    for name, text in {"old": STUDY, "new": TODAY, "broken": "title ="}.items():
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")
    assert main(["migrate", "--studies", "--workspace", str(tmp_path)]) == 2
    out, err = capsys.readouterr()
    assert "[random] -> [monte_carlo]" in out
    assert "1 study file rewritten, 1 up to date, 1 unusable" in out
    assert "broken.toml: is no valid TOML" in err
    assert tomllib.loads((folder / "old.toml").read_text(encoding="utf-8")) == tomllib.loads(TODAY)
    assert (folder / "broken.toml").read_text(encoding="utf-8") == "title ="
    assert not (tmp_path / "results.db").exists()


def test_line_endings_and_the_mark_of_the_encoding_stay(tmp_path: Path, registry: Registry) -> None:
    file = tmp_path / "windows.toml"
    file.write_bytes(b"\xef\xbb\xbf" + STUDY.replace("\n", "\r\n").encode())
    assert rewrite(file, tmp_path, registry)
    written = file.read_bytes()
    assert written.startswith(b"\xef\xbb\xbf#")
    assert written.count(b"\n") == written.count(b"\r\n") == STUDY.count("\n")
    assert [one.name for one in tmp_path.iterdir()] == ["windows.toml"]
