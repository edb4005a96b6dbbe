"""Every file of the corpus lists, proposes rightly or says what it lacks, and gives its response by one command."""

import json
import random
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.components.registry import Registry
from fraexp.errors import FraexpError
from fraexp.records.contents import list_contents
from fraexp.records.proposals import propose_import
from tests.records.corpus import LAYOUTS, Layout, plant
from tests.records.strangers_files import results


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def written(layout: Layout, folder: Path) -> None:
    if layout.extra and find_spec(layout.extra) is None:
        pytest.skip(f"{layout.extra} is not installed")
    layout.write(folder)


def test_the_corpus_is_broad() -> None:
    assert len(LAYOUTS) >= 30
    assert len({layout.kind for layout in LAYOUTS.values()}) >= 8


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_the_listing_proposes_rightly_or_says_what_it_lacks(
    folder: Path, layout: Layout, capsys: pytest.CaptureFixture[str]
) -> None:
    written(layout, folder)
    assert main(["import", *layout.files, "--json"]) == ExitCode.OK
    document = json.loads(capsys.readouterr().out)
    for part in layout.proposed:
        assert part in document["proposal"]
    needs = "; ".join(document["needs"])
    assert layout.needs in needs
    assert bool(layout.needs) == bool(needs)


@pytest.mark.thorough
@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_one_command_gives_the_response(folder: Path, layout: Layout) -> None:
    written(layout, folder)
    assert main(["import", *layout.files, *layout.options]) == ExitCode.OK
    (result,) = results(folder, Path(layout.files[0]).stem)
    assert result.response is not None
    assert result.response.frequency.size >= 15
    error = result.response.response / plant(result.response.frequency) - 1
    assert np.abs(error).max() < layout.tolerance


@pytest.mark.thorough
@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_a_proposal_that_needs_nothing_runs(folder: Path, layout: Layout, capsys: pytest.CaptureFixture[str]) -> None:
    written(layout, folder)
    assert main(["import", *layout.files, "--json"]) == ExitCode.OK
    document = json.loads(capsys.readouterr().out)
    if document["needs"]:
        pytest.skip("the file does not contain all that is needed")
    import shlex

    assert main(shlex.split(document["proposal"])[1:]) == ExitCode.OK


@pytest.mark.thorough
@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_a_damaged_file_gives_one_line(folder: Path, layout: Layout, registry: Registry) -> None:
    """Cut off, with bytes changed, with a part twice, and empty."""
    written(layout, folder)
    path = folder / layout.files[0]
    whole, dice = path.read_bytes(), random.Random(5)
    middle = len(whole) // 2
    noise = bytearray(whole)
    for _ in range(20):
        noise[dice.randrange(len(noise))] = dice.randrange(256)
    for damaged in (
        b"",
        whole[:100],
        whole[:middle],
        whole[middle:],
        bytes(noise),
        whole[:middle] + whole[middle // 2 :],
    ):
        path.write_bytes(damaged)
        try:
            propose_import(path, list_contents(path, registry), registry)
        except FraexpError as error:
            assert "\n" not in str(error)
        assert main(["import", *layout.files, *layout.options, "--study", str(folder / "other.toml")]) in (0, 1, 2)
        (folder / "other.toml").unlink(missing_ok=True)
