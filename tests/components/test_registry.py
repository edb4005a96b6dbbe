"""Plugins from strangers: found, reported, and never the end of the rest."""

import sys
from pathlib import Path

import fraexp_plugins
import pytest

from fraexp.components.registry import discover
from fraexp.errors import ParameterError, PluginError
from tests.refusals import refused

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
    assert registry.provider("friction", "mine").distribution == "workspace"
    assert registry.create("friction", {"name": "mine"}).max_stiffness == pytest.approx(4.0)
    assert not registry.failures


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (
            "import nowhere_to_be_found",
            "ModuleNotFoundError: No module named 'nowhere_to_be_found' (broken.py, line 1)",
        ),
        ("x = (", "SyntaxError"),
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
        (
            {"arguments": "z, dy, dt, z_next, kk"},
            "mine.advance takes 'kk', which is not a parameter; did you mean 'k'?",
        ),
        ({"arguments": "dy, z, dt, z_next, k"}, "expected (z, dy, dt, z_next, ...)"),
        ({"version": "1, api=0"}, "class Mine has the unknown argument 'api'; known: name, version"),
    ],
)
def test_a_class_that_breaks_the_contract_is_refused_when_it_is_defined(tmp_path, changes, reason):
    drop(tmp_path, "mine.py", **changes)
    (failure,) = discover(tmp_path).failures
    assert reason in failure.reason
    assert failure.reason.endswith("(mine.py, line 4)")  # the class


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (
            "class C(Controller, name='c', version=1):\n    def transfer_function(self):\n        return [1], [1]",
            "c.transfer_function takes (self); expected (self, sample_time) (other.py, line 2)",
        ),
        (
            "class X(Excitation, name='x', version=1):\n    def periods(self, sample_time): ...\n"
            "    def schedule(self): ...",
            "x.schedule is a method; expected a property: put @property above it (other.py, line 2)",
        ),
        ("class P(Plant):\n    pass", "other.py, line 2: P has no name; expected name=... after its base"),
        ("class P(Plant, name='p', version=1):\n    pass", "p lacks response, state_space, which every plant has"),
        ("from fraexp.api import Gone", "'Gone' from 'fraexp.api'; it was written for another version of fraexp"),
        ("x = (", "SyntaxError: '(' was never closed (other.py, line 2)"),
    ],
)
def test_a_mistyped_or_outdated_file_is_reported_with_its_own_line(tmp_path, text, reason):
    (tmp_path / "other.py").write_text(f"from fraexp.api import Controller, Excitation, Plant\n{text}\n")
    (failure,) = discover(tmp_path).failures
    assert reason in failure.reason
    assert "line 2" in failure.reason
    assert failure.place == str(tmp_path / "other.py")


def test_an_error_about_a_name_tells_of_the_broken_file_that_may_supply_it_and_of_no_other(tmp_path):
    drop(tmp_path, "first.py", name="wanted", arguments="z, dy, dt, z_next, kk")
    (tmp_path / "second.py").write_text("1/0")
    registry = discover(tmp_path)
    with pytest.raises(PluginError) as caught:
        registry.provider("friction", "wanted")
    place = tmp_path / "first.py"
    assert str(caught.value).startswith(
        f"no friction is called 'wanted'; {place} may provide it, but is broken: wanted"
    )
    assert "second.py" not in str(caught.value)
    with refused(PluginError, "'rolling'", "'fraexp plugins'"):
        registry.provider("friction", "roling")


def test_what_a_plugin_prints_is_no_data(tmp_path, capsys):
    (tmp_path / "loud.py").write_text("print('hello')")
    assert not discover(tmp_path).failures
    assert capsys.readouterr() == ("", "hello\n")


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("z_next[5] = 1.0; return k * dy", "(mine.py, line 12) wrote z_next[5] of 1 on dy = 1e-09 m"),
        ("z_next[0] = dy; return z[1] if dy < -1e-3 else k * dy", "read z[1] of 1"),
        ("z_next[0] = z[0] + dy; return z[int(z[0] * 100)]", "read z["),  # after a long way only
        ("z[0] = 1.0; z_next[0] = z[0]; return k * dy", "writes z[0]; it may write only z_next"),
        (
            "z_next[0] = dy\n        if abs(dy) > 2e-4: z[0] = 0.0\n        return k * dy",
            "writes z[0]; it may write only z_next",
        ),
        ("z_next[0] = 0.0; return float('nan')", "expected finite numbers"),
        ("return k * dy", "expected finite numbers"),
    ],
)
def test_a_law_that_would_go_wrong_when_compiled_is_refused_before(tmp_path, body, reason):
    drop(tmp_path, "mine.py", body)
    model = discover(tmp_path).create("friction", {"name": "mine"})
    with pytest.raises(PluginError) as caught:
        model.check_law()
    assert reason in str(caught.value)


def test_a_law_that_overflows_only_at_absurd_speed_is_let_through(tmp_path):
    drop(tmp_path, "mine.py", "import math; z_next[0] = 0.0; return k * math.sinh(dy / dt)")
    discover(tmp_path).create("friction", {"name": "mine"}).check_law()
    drop(tmp_path, "mine.py", "import math; z_next[0] = 0.0; return k * math.sinh(1e4 * dy / dt)")
    with refused(PluginError, "OverflowError"):
        discover(tmp_path).create("friction", {"name": "mine"}).check_law()


def test_two_plugins_of_one_name_are_both_named_whenever_it_is_asked_for(tmp_path):
    drop(tmp_path, "first.py", name="rolling")
    drop(tmp_path, "second.py", name="twice")
    drop(tmp_path, "third.py", name="twice")
    registry = discover(tmp_path)
    with refused(PluginError, "'twice'", tmp_path / "second.py", tmp_path / "third.py", "line 4"):
        registry.create("friction", {"name": "twice"})
    with refused(PluginError, "'rolling'", "rolling.py", tmp_path / "first.py", "line 4"):
        registry.create("friction", {"name": "rolling"})


PACKAGE = """
from fraexp.api import component_modules, hookimpl

@hookimpl
def fraexp_component_modules():
    return component_modules(__name__, __path__)
"""


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A folder of an installed package whose modules are imported when they are needed."""
    metadata = tmp_path / "laws-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: laws\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text("[fraexp]\nmine = some_laws\n")
    folder = tmp_path / "some_laws"
    folder.mkdir()
    (folder / "__init__.py").write_text(PACKAGE)
    monkeypatch.syspath_prepend(tmp_path)
    yield folder
    for name in [name for name in sys.modules if name.partition(".")[0] == "some_laws"]:
        del sys.modules[name]


def test_a_module_of_a_package_is_imported_when_one_of_its_components_is_asked_for(package):
    drop(package, "one.py", name="first")
    drop(package, "two.py", name="second")
    registry = discover()
    assert registry.provider("friction", "first").distribution == "laws 1.0"
    assert list(registry.used_providers("friction", {})) == []  # what no contact has
    assert {name for name in sys.modules if name.startswith("some_laws.")} == {"some_laws.one"}
    assert {"first", "second"} <= set(registry.names("friction"))


def test_a_component_whose_name_no_text_tells_is_found_all_the_same(package):
    drop(package, "hidden.py", name="unseen")
    file = package / "hidden.py"
    text = file.read_text("utf-8")
    file.write_text("NAME = 'unseen'\n" + text.replace('name="unseen"', "name=NAME"), encoding="utf-8")
    assert discover().create("friction", {"name": "unseen"}).k == 2.0


def test_a_module_of_a_package_that_fails_takes_no_other_with_it(package):
    drop(package, "one.py", name="first")
    (package / "broken.py").write_text("1/0")
    registry = discover()
    assert registry.create("friction", {"name": "first"}).k == 2.0
    (failure,) = registry.failures
    assert failure.place == "laws 1.0 (some_laws.broken)"
    assert failure.reason == "ZeroDivisionError: division by zero (broken.py, line 1)"


def test_a_file_and_a_package_that_supply_one_name_are_both_named(package, tmp_path):
    drop(package, "one.py", name="twice")
    drop(tmp_path, "own.py", name="twice")
    with refused(PluginError, "'twice'", "one.py", "own.py", "line 4"):
        discover(tmp_path).create("friction", {"name": "twice"})


def test_the_built_in_modules_tell_their_components_without_being_imported(registry):
    found = {(provider.component.__module__, name) for (_, name), provider in registry.providers.items()}
    told = fraexp_plugins.fraexp_component_modules()
    built_in = {(module, name) for module, name in found if module.startswith("fraexp_plugins.")}
    assert built_in == {(module, name) for module, names in told.items() for name in names}


def test_a_built_in_module_has_one_component_and_is_named_like_it():
    """Or with its kind behind the name, where the name alone is a module of the standard library: csv_reader."""
    root = Path(fraexp_plugins.__file__).parent
    modules = fraexp_plugins.fraexp_component_modules()
    packages = {module for module in modules if root.joinpath(*module.split(".")[1:]).is_dir()}
    stems = {module.rpartition(".")[2]: names for module, names in modules.items() if module not in packages}
    assert {stem: names for stem, names in stems.items() if len(names) != 1 or not stem.startswith(names[0])} == {}
    assert not any(modules[package] for package in packages)
    assert len(stems) > 40


def test_presets_can_be_named_and_changed_in_part(registry):
    model = registry.create("friction", {"name": "lugre", "preset": "canudas_de_wit_1995", "viscous_coefficient": 9.0})
    assert (model.bristle_stiffness, model.viscous_coefficient) == (1e5, 9.0)
    with refused(ParameterError, "lugre", "'canudas'", "'canudas_de_wit_1995'"):
        registry.create("friction", {"name": "lugre", "preset": "canudas"})


def test_a_file_that_is_never_loaded_is_named_with_its_line(tmp_path, monkeypatch):
    monkeypatch.setattr("fraexp.components.local_file.LAW_TIME_LIMIT_S", 0.2)
    (tmp_path / "endless.py").write_text("import math\nwhile math.pi:\n    pass\n", encoding="utf-8")
    (failure,) = discover(tmp_path).failures
    assert "it has not been loaded after 0.2 s (endless.py, line " in failure.reason
