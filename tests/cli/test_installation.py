import json
import os
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.components.kinds import KINDS
from fraexp.data.sweep import Sweep
from fraexp.store import Store
from fraexp.testing import selftest
from tests.cli.conftest import fill
from tests.store.conftest import reseal

GOOD = '''
"""A plant of my own."""
from fraexp.api import Plant, param

class Mass(Plant, name="my mass", version=3):
    """A free mass (Newton 1687)."""
    mass: float = param("kg", "moving mass", above=0)
    stiffness: float = param("N/m", "stiffness to ground", 0.0, at_least=0)

    def state_space(self): ...
    def response(self, omega): ...
'''


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "plugins").mkdir()
    (tmp_path / "plugins/mass.py").write_text(GOOD)
    return tmp_path


def test_all_components_are_on_one_screen_and_one_is_shown_in_full(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["plugins", "--workspace", str(folder)]) == ExitCode.OK
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == len(KINDS)
    assert "my mass (mass.py), two_mass" in next(line for line in lines if line.startswith("plant"))
    assert main(["plugins", "my mass", "--workspace", str(folder)]) == ExitCode.OK
    head, meaning, _, _, mass, stiffness = capsys.readouterr().out.rstrip().splitlines()
    assert head == f"plant my mass  version 3, {folder / 'plugins/mass.py'}"
    assert meaning == "  A free mass (Newton 1687)."
    assert mass.split() == ["mass", "kg", "required", ">", "0", "moving", "mass"]
    assert stiffness.split() == ["stiffness", "N/m", "0", "≥", "0", "stiffness", "to", "ground"]


def test_main_parameters_come_first(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Required ones, then those of the component itself, then inherited ones."""
    assert main(["plugins", "notched_pid", "--workspace", str(folder)]) == ExitCode.OK
    names = [line.split()[0] for line in capsys.readouterr().out.splitlines()[3:] if line]
    first, rest = names[1:6], names[7:]
    assert first == ["proportional", "notch_frequencies", "notch_widths", "notch_depths", "integral_time"]
    assert rest == ["derivative_time", "filter_time"]


def test_an_unknown_component_is_refused_with_the_nearest_name(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["plugins", "notched", "--workspace", str(folder)]) == ExitCode.USAGE
    assert "no component is called 'notched'; did you mean 'notched_pid'?" in capsys.readouterr().err


def test_a_broken_plugin_is_named_with_its_reason(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "plugins/broken.py").write_text("import nothing_of_this_name\n")
    assert main(["plugins", "--workspace", str(folder), "--json"]) == ExitCode.USAGE
    found = json.loads(capsys.readouterr().out)
    (failure,) = found["failures"]
    assert failure["place"].endswith("broken.py")
    assert "ModuleNotFoundError" in failure["reason"]
    mine = next(component for component in found["components"] if component["name"] == "my mass")
    assert mine["parameters"][0] == {
        "name": "mass", "unit": "kg", "meaning": "moving mass", "required": True, "default": None,
        "inherited_from": None, "bounds": {">": 0.0},
    }  # fmt: skip


def test_doctor_finds_everything_sound(workspace: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "--workspace", str(workspace), "--json"]) == ExitCode.OK
    found = json.loads(capsys.readouterr().out)
    assert (found["database"]["runs"], found["database"]["error"]) == (1, "")
    assert found["database"]["file_system"] not in ("", "unknown")
    assert found["packages"]["numpy"]
    assert found["cores"] >= 1
    assert found["plugins"]["broken"] == []
    stored = found["database"]
    assert (stored["sweeps"], stored["size"]) == (5, (workspace / "results.db").stat().st_size)
    assert stored["hanging"] == []
    assert set(found["extras"]) == {"postgresql", "dask"}
    assert found["self_test"]["sound"]
    assert found["self_test"]["difference"] < selftest.TOLERANCE
    assert "steps per sample" in found["self_test"]["kernel"]


def test_doctor_names_a_foreign_database(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "results.db").write_text("this is no database")
    assert main(["doctor", "--workspace", str(tmp_path)]) == ExitCode.INCOMPLETE
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("database")]
    assert line.split(maxsplit=1)[1].startswith(f"{tmp_path / 'results.db'}: this is not a database; ")
    assert line.count("results.db") == 1


@pytest.mark.parametrize(
    ("statement", "code", "finding"),
    [
        ("UPDATE sweep SET outcome = 'ok' WHERE outcome IS NOT NULL", 3, "4 of 5 sweeps and 0 of 1 runs are damaged"),
        ("UPDATE run SET study = 'other'", 0, "0 of 5 sweeps and 1 of 1 runs are damaged"),
    ],
)
def test_doctor_finds_what_is_no_result_and_show_says_so(
    statement: str, code: int, finding: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    key = fill(tmp_path / "results.db")[0].key
    with closing(sqlite3.connect(tmp_path / "results.db")) as connection, connection:
        connection.execute(statement)
    assert main(["doctor", "--workspace", str(tmp_path), "--json"]) == ExitCode.INCOMPLETE
    error = json.loads(capsys.readouterr().out)["database"]["error"]
    assert error.startswith(f"{tmp_path / 'results.db'}: {finding}; ")
    assert error.endswith(
        "; restore a copy with 'fraexp restore COPY', or save what is sound with fraexp merge into a new one"
    )
    assert main(["show", key, "--workspace", str(tmp_path)]) == code
    assert capsys.readouterr().err.startswith(f"fraexp: sweep {key[4:12]}: the stored values") == (code > 0)


@pytest.mark.skipif(os.name != "posix", reason="permissions of POSIX")
@pytest.mark.parametrize(
    ("part", "finding"), [("results.db", "the file is read-only"), ("", "the folder is read-only")]
)
def test_doctor_tells_what_cannot_be_written(
    part: str, finding: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    fill(tmp_path / "results.db")
    # Whoever runs the tests may be one who may write everywhere.
    monkeypatch.setattr("fraexp.store.backends.sqlite._is_writable", lambda path: path != tmp_path / part)
    assert main(["doctor", "--workspace", str(tmp_path)]) == ExitCode.OK
    printed = capsys.readouterr()
    assert f"read-only: {tmp_path / 'results.db'}: {finding}; " in printed.err
    assert "5 sweeps" in printed.out


def test_doctor_looks_before_the_first_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "--workspace", str(tmp_path)]) == ExitCode.OK
    assert "not created yet; the first run creates it" in capsys.readouterr().out
    assert list(tmp_path.iterdir()) == []


def test_doctor_finds_wrong_numbers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(selftest, "TRUTH", {key: 1.00001 * value for key, value in selftest.TRUTH.items()})
    assert main(["doctor", "--workspace", str(tmp_path)]) == ExitCode.INCOMPLETE
    assert "wrong results: the response differs by 1.0e-05 of the truth" in capsys.readouterr().out


def test_doctor_names_a_run_that_was_broken_off(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sweep = Sweep({"source": "loop"}, {"name": "effective_input"})
    with Store.open(str(tmp_path / "results.db"), create=True) as store:
        run = store.begin_run("bench", "bench.toml", "fraexp run bench", {}, [sweep])
        assert store.claim(run, [sweep.key]) == {sweep.key}
    with sqlite3.connect(tmp_path / "results.db") as connection:
        connection.execute("UPDATE run SET pid = 4194305")  # above the greatest that there can be
    reseal(str(tmp_path / "results.db"))
    assert main(["doctor", "--workspace", str(tmp_path)]) == ExitCode.OK
    told = capsys.readouterr().err
    again = f"fraexp run bench --workspace {tmp_path} continues it"
    assert f"run 1 was interrupted, with 1 sweep leased to it; {again}" in told


@pytest.mark.skipif(os.name != "posix", reason="permissions of POSIX")
@pytest.mark.parametrize("options", [[], ["--package"]])
def test_a_plugin_that_cannot_be_written_is_one_line(
    options: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "plugins").touch()  # which nobody can make a folder, whoever runs the tests
    (tmp_path / "fraexp-foo").touch()
    assert main(["new", "friction", "foo", "--workspace", str(tmp_path), *options]) == ExitCode.USAGE
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"fraexp: {tmp_path}")
    assert "cannot be written: " in line
    assert line.endswith("; choose another place")
