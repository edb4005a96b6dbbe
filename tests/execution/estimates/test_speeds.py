"""What is kept about the speed of a machine."""

import json
import math
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import pytest

from fraexp.execution.estimates.speeds import MIN_WEIGHT, Speeds, read_speeds, save_ratios, speeds_file
from fraexp.kernels.cache_folder import CACHE_FOLDER_VARIABLE, cache_folder


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(CACHE_FOLDER_VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_the_cache_folder_is_the_users_unless_another_is_named(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert cache_folder() == cache
    monkeypatch.delenv(CACHE_FOLDER_VARIABLE)
    assert cache_folder().name == "fraexp"


def test_nothing_is_known_of_a_new_machine() -> None:
    assert read_speeds() == Speeds()
    assert read_speeds().ratio("loop/rolling/lanes") == 1.0


def test_a_measured_law_tells_how_fast_the_machine_is_at_others() -> None:
    speeds = Speeds().updated({"loop/rolling/lanes": [3.0], "settling/stepped_sine/rolling": [50.0]})
    assert speeds.ratio("loop/rolling/lanes") == pytest.approx(3.0)
    assert speeds.ratio("loop/dahl/lanes") == speeds.ratio("estimate/effective_input") == pytest.approx(3.0)
    assert speeds.ratio("settling/chirp/dahl") == 1.0, "how long one loop settles says nothing about another one"
    assert speeds.ratio("parallel") == 1.0, "nor about how work is divided"
    assert speeds.ratio("compile/loop") == pytest.approx(3.0)
    assert Speeds().updated({"compile/loop": [9.0]}).ratio("loop/dahl/lanes") == 1.0


def test_a_large_amount_may_be_slower_than_a_small_one() -> None:
    speeds = Speeds().updated({"drive/rolling/lanes": [1.0], "drive/rolling/lanes@0": [2.0]})
    assert speeds.ratio("drive/rolling/lanes@0") == pytest.approx(2.0)
    assert speeds.ratio("drive/rolling/lanes@-2") == pytest.approx(1.0)
    assert speeds.ratio("drive/dahl/lanes@0") == pytest.approx(1.0), "the median is that of the kinds"


def test_a_run_counts_as_one_and_an_outlier_in_it_as_nothing() -> None:
    speeds = Speeds().updated({"estimate/effective_input": [2.0, 2.0, 2.0, 90.0]})
    assert speeds.ratio("estimate/effective_input") == pytest.approx(2.0)


def test_what_changes_on_a_machine_is_learned_in_a_few_runs() -> None:
    speeds = Speeds()
    for _ in range(10):
        speeds = speeds.updated({"estimate/effective_input": [1.0]})
    for _ in range(10):
        speeds = speeds.updated({"estimate/effective_input": [4.0]})
    assert math.log(speeds.ratio("estimate/effective_input")) == pytest.approx(
        math.log(4.0) * (1 - (1 - MIN_WEIGHT) ** 10), rel=1e-9
    )


@pytest.mark.parametrize("ratio", [0.0, -1.0, math.nan, math.inf, 1e9])
def test_a_stopped_clock_teaches_nothing(ratio: float) -> None:
    assert Speeds().updated({"estimate/effective_input": [ratio]}) == Speeds()


def test_what_was_learned_is_there_for_the_next_run() -> None:
    save_ratios({"loop/dahl/lanes": [2.0]}, ["loop/dahl/lanes"])
    save_ratios({"estimate/effective_input": [0.5]})
    found = read_speeds()
    assert found.ratio("loop/dahl/lanes") == pytest.approx(2.0, rel=1e-3)
    assert found.ratio("estimate/effective_input") == pytest.approx(0.5, rel=1e-3)
    assert found.kernels == {"loop/dahl/lanes"}


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        "null",
        '{"format": 2}',
        '{"format": 3, "ratios": {"a": [0, 1]}, "kernels": []}',
        '{"format": 2, "ratios": {"a": 3}, "kernels": []}',
        '{"format": 2, "ratios": {"a": ["x", 1]}, "kernels": []}',
        '{"format": 2, "ratios": {"a": [NaN, 1], "b": [1e9, 1], "c": [1, 0]}, "kernels": []}',
        "\xff",
    ],
)
def test_a_damaged_file_is_as_good_as_none(text: str) -> None:
    speeds_file().parent.mkdir()
    speeds_file().write_bytes(text.encode("latin-1"))
    assert read_speeds() == Speeds()
    save_ratios({"estimate/effective_input": [2.0]})
    assert read_speeds().ratio("estimate/effective_input") == pytest.approx(2.0, rel=1e-3)


def test_a_folder_that_cannot_be_written_is_no_error(cache: Path) -> None:
    cache.write_text("a file where the folder should be")
    save_ratios({"estimate/effective_input": [2.0]})
    assert read_speeds() == Speeds()


def _learn(number: int) -> None:
    for _ in range(20):
        save_ratios({f"estimate/{number}": [2.0]})


def test_several_runs_may_end_at_once(cache: Path) -> None:
    with ProcessPoolExecutor(3, mp_context=get_context("spawn")) as workers:
        list(workers.map(_learn, range(3)))
    assert json.loads(speeds_file().read_text())["format"] == 2
    assert {round(read_speeds().ratio(kind), 2) for kind in read_speeds().ratios} == {2.0}
    assert [file.name for file in cache.iterdir()] == [speeds_file().name], "no half-written file is left"
