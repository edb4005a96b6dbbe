import json
from pathlib import Path

import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main

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


def test_plugins_show_parameters_with_units_and_bounds(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plugins", "--workspace", str(folder)]) == ExitCode.OK
    block = capsys.readouterr().out.partition("plant my mass  version 3, ")[2].partition("\n\n")[0].splitlines()
    assert block[0] == str(folder / "plugins/mass.py")
    assert block[1] == "  A free mass (Newton 1687)."
    assert block[3].split() == ["mass", "kg", "required", ">", "0", "moving", "mass"]
    assert block[4].split() == ["stiffness", "N/m", "0", "≥", "0", "stiffness", "to", "ground"]


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


def test_doctor_names_a_foreign_database(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "results.db").write_text("this is no database")
    assert main(["doctor", "--workspace", str(tmp_path)]) == ExitCode.STORE
    assert "results.db" in capsys.readouterr().out


def test_doctor_looks_before_the_first_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "--workspace", str(tmp_path)]) == ExitCode.OK
    assert "not there yet; the first run makes it" in capsys.readouterr().out
    assert list(tmp_path.iterdir()) == []
