import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from fraexp.data.results import Outcome, Result
from fraexp.errors import FraexpError
from fraexp.figures.drawing import draw_figure, save_figure
from fraexp.figures.elements.grouping import ShownResult
from fraexp.figures.elements.stamp import is_current, stamp_digest
from tests.examples import some
from tests.figures.curves import make_loop, make_response
from tests.refusals import refused

STARTS = {".png": b"\x89PNG\r\n\x1a\n", ".svg": b"<?xml", ".pdf": b"%PDF"}


@pytest.fixture
def result() -> Result:
    return Result(Outcome.OK, response=make_response(np.geomspace(1, 200, 20), np.ones(20)))


@pytest.mark.parametrize("suffix", some(STARTS, ".png"))
def test_a_file_is_whole_stamped_and_the_same_every_time(suffix: str, tmp_path: Path, result: Result) -> None:
    first, second = tmp_path / f"new folder/one{suffix}", tmp_path / f"two{suffix}"
    for path in (first, second):
        save_figure(draw_figure([ShownResult("conventional", result)]), path, ["fx1-a", "title"])
    assert first.read_bytes() == second.read_bytes()
    assert first.read_bytes().startswith(STARTS[suffix])
    assert is_current(first, stamp_digest(["fx1-a", "title"]))
    assert not is_current(first, stamp_digest(["fx1-b", "title"]))
    assert [path.name for path in first.parent.iterdir()] == [first.name], "no temporary file is left"


def test_a_file_that_is_cut_off_or_missing_is_not_current(tmp_path: Path, result: Result) -> None:
    path = tmp_path / "figure.png"
    save_figure(draw_figure([ShownResult("a", result)]), path, ["k"])
    path.write_bytes(path.read_bytes()[:-20])
    assert not is_current(path, stamp_digest(["k"]))
    assert not is_current(tmp_path / "missing.png", stamp_digest(["k"]))


def test_an_unknown_suffix_is_refused(tmp_path: Path, result: Result) -> None:
    with refused(FraexpError, "figure.bmp", "'.bmp'", ".png, .svg, .pdf"):
        save_figure(draw_figure([ShownResult("a", result)]), tmp_path / "figure.bmp", [])


def test_a_place_that_cannot_be_written_is_one_line(tmp_path: Path, result: Result) -> None:
    (tmp_path / "file").touch()
    with refused(FraexpError, "file/figure.png"):
        save_figure(draw_figure([ShownResult("a", result)]), tmp_path / "file/figure.png", [])


def test_the_figure_fits_the_results(result: Result) -> None:
    driven = Result(Outcome.OK, curves=(make_loop(1e-5),))
    assert len(draw_figure([ShownResult("a", result)]).axes) == 2
    assert [axes.get_ylabel() for axes in draw_figure([ShownResult("a", driven)]).axes] == ["Friction force [N]"]
    with refused(FraexpError, "figure"):
        draw_figure([ShownResult("a", Result(Outcome.DIVERGED))])


@pytest.mark.parametrize("kind", ["", "bode", "errors", "amplitude_map", "levels", "hysteresis", "curves"])
def test_what_has_nothing_to_draw_is_one_line(kind: str) -> None:
    empty = Result(Outcome.DIVERGED, response=make_response([], []))
    with refused(FraexpError):
        draw_figure([ShownResult("a", empty, truth=np.empty(0), amplitude=1.0)] * 2, kind=kind)


@pytest.mark.parametrize("kind", some(["errors", "amplitude_map", "levels", "bode"], "errors"))
def test_points_where_nothing_moved_are_left_out(kind: str, tmp_path: Path) -> None:
    values = np.array([np.nan, -1e-3, -1e-4])
    response = make_response([1, 2, 3], values, settled=[False, True, True], deviation=[1e-6, 1e-6, 1e-2])
    plant = np.full(3, -1e-3 + 0j)
    shown = [
        ShownResult(str(amplitude), Result(Outcome.NO_MOTION, response=response), truth=plant, amplitude=amplitude)
        for amplitude in (1.0, 2.0)
    ]
    save_figure(draw_figure(shown, kind=kind), tmp_path / "figure.png", [])  # a warning would be an error


NAMES = ["\x1b[31m red", "$unbalanced", "摩擦", "_hidden", "two\nlines", ""]


@pytest.mark.parametrize("name", some(NAMES, "\x1b[31m red", "$unbalanced"))
def test_any_name_can_be_drawn(name: str, result: Result, tmp_path: Path) -> None:
    figure = draw_figure([ShownResult(name, result), ShownResult("other", result)], title=name)
    save_figure(figure, tmp_path / "figure.png", [])
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert len(texts) == (2 if name else 1)
    assert all("\x1b" not in text and "\n" not in text for text in texts)


def test_numbers_and_stamps_need_no_matplotlib_and_drawing_no_display() -> None:
    code = (
        "import sys; from fraexp.figures.elements import stamp;"
        "from fraexp.figures.kinds import bode, curves, response_errors;"
        "print('matplotlib' in sys.modules);"
        "import fraexp.figures.drawing; print('matplotlib.pyplot' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False"]


def test_drawing_leaves_no_trace_in_the_users_settings(result: Result, tmp_path: Path) -> None:
    import matplotlib

    before = dict(matplotlib.rcParams)
    save_figure(draw_figure([ShownResult("a", result)]), tmp_path / "a.svg", [])
    assert dict(matplotlib.rcParams) == before
