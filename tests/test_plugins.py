"""Plugins from strangers: found, reported, and never the end of the rest."""

from pathlib import Path

import pytest

from fraexp.errors import ParameterError, PluginError
from fraexp.plugins import discover

LAW = """
from fraexp.api import FrictionModel, param

class Mine(FrictionModel, name="{name}", version={version}):
    '''Mine (1968).'''
    k: float = param("N/m", "stiffness", 2.0, above=0)
    states = ("force [N]",)

    @staticmethod
    def advance({arguments}):
        '''Force [N].'''
        {body}
"""


def drop(folder: Path, file: str, body: str = "z_next[0] = z[0] + k * dy; return z_next[0]", **changes: object) -> None:
    values = {"name": "mine", "version": 1, "arguments": "z, dy, dt, z_next, k", "body": body, **changes}
    (folder / file).write_text(LAW.format(**values), encoding="utf-8")


def test_a_dropped_file_supplies_its_component(tmp_path):
    drop(tmp_path, "mine.py")
    registry = discover(tmp_path)
    assert registry.supply("friction", "mine").distribution == "workspace"
    assert registry.create("friction", {"name": "mine"}).greatest_stiffness == pytest.approx(4.0)
    assert not registry.failures


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (
            "import nowhere_to_be_found",
            "ModuleNotFoundError: No module named 'nowhere_to_be_found' (broken.py, line 1)",
        ),
        ("x = (", "SyntaxError"),
        ("import sys\nsys.exit(3)", "SystemExit: 3"),
        ("1/0", "ZeroDivisionError: division by zero (broken.py, line 1)"),
    ],
)
def test_a_file_that_cannot_be_loaded_is_reported_and_the_rest_goes_on(tmp_path, text, reason):
    (tmp_path / "broken.py").write_text(text, encoding="utf-8")
    drop(tmp_path, "mine.py")
    registry = discover(tmp_path)
    assert [reason in failure.reason for failure in registry.failures] == [True]
    assert registry.create("friction", {"name": "mine"})
    assert "rolling" in registry.names("friction")


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"arguments": "z, dy, dt, z_next, kk"}, "mine.advance takes 'kk', which is no parameter; did you mean 'k'?"),
        ({"arguments": "dy, z, dt, z_next, k"}, "expected (z, dy, dt, z_next, ...)"),
        ({"version": "'a'"}, "expected a whole number"),
    ],
)
def test_a_class_that_breaks_the_contract_is_refused_when_it_is_defined(tmp_path, changes, reason):
    drop(tmp_path, "mine.py", **changes)
    assert reason in discover(tmp_path).failures[0].reason


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("z_next[5] = 1.0; return k * dy", "IndexError: index 5 is out of bounds"),
        ("z[0] = 1.0; z_next[0] = z[0]; return k * dy", "writes z"),
        ("z_next[0] = 0.0; return float('nan')", "expected finite numbers"),
        ("return k * dy", "expected finite numbers"),
        ("raise ValueError('boom')", "ValueError: boom (mine.py, line"),
    ],
)
def test_a_law_that_would_go_wrong_when_compiled_is_refused_before(tmp_path, body, reason):
    drop(tmp_path, "mine.py", body)
    model = discover(tmp_path).create("friction", {"name": "mine"})
    with pytest.raises(PluginError) as caught:
        model.rehearse()
    assert reason in str(caught.value)


def test_two_plugins_of_one_name_are_both_named_whenever_it_is_asked_for(tmp_path):
    drop(tmp_path, "first.py", name="rolling")
    drop(tmp_path, "second.py", name="twice")
    drop(tmp_path, "third.py", name="twice")
    registry = discover(tmp_path)
    with pytest.raises(PluginError, match=r"'twice' .* both .*second.py and .*third.py; rename one"):
        registry.create("friction", {"name": "twice"})
    with pytest.raises(PluginError, match=r"'rolling' .* both .*rolling.py and .*first.py"):
        registry.create("friction", {"name": "rolling"})


def test_presets_can_be_named_and_changed_in_part(registry):
    model = registry.create("friction", {"name": "lugre", "preset": "canudas_de_wit_1995", "sigma2": 9.0})
    assert (model.sigma0, model.sigma2) == (1e5, 9.0)
    with pytest.raises(ParameterError, match=r"lugre has no preset 'canudas'; did you mean 'canudas_de_wit_1995'\?"):
        registry.create("friction", {"name": "lugre", "preset": "canudas"})
