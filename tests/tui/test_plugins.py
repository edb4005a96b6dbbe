"""The page of plugins: what there is, what is broken, and files that change while it is open."""

import os
from pathlib import Path

import pytest

from fraexp.components.local_file import load_file
from fraexp.components.registry import discover
from fraexp.store import Store
from fraexp.tui.app import FraexpApp
from fraexp.tui.services.plugin_watch import PluginWatch
from fraexp.views.components import list_offers
from fraexp.workspace.workspace_service import WorkspaceService
from tests.tui.pilots import pilot_of, screen_text, shows, until

LAW = '''
from fraexp.api import FrictionModel, param


class Mine(FrictionModel, name="mine", version=1):
    """Mine (1968): a spring [with brackets] that slips.

    A second paragraph.

    A third paragraph, for the whole page alone.
    """

    stiffness: float = param("N/m", "stiffness of it", {stiffness}, above=0)
    states = ("force [N]",)

    @staticmethod
    def advance(z, dy, dt, z_next, stiffness):
        """Force [N]."""
        z_next[0] = min(max(z[0] + stiffness * dy, -1.0), 1.0)
        return z_next[0]
'''


def drop(folder: Path, text: str, name: str = "mine.py") -> Path:
    file = folder / "plugins" / name
    file.parent.mkdir(exist_ok=True)
    file.write_text(text, encoding="utf-8")
    return file


def told(app: FraexpApp, text: str) -> bool:
    """Return whether a message that begins so was shown."""
    return any(message.message.startswith(text) for message in app._notifications)


@pytest.mark.thorough
def test_components_are_listed_with_what_they_are_and_how_often_they_were_used(workspace):
    async def steps(app, pilot):
        await pilot.press("p")
        await shows(pilot, "composite", "friction")
        await pilot.press("slash", *"rolling_force", "enter")
        await shows(pilot, "rows 1-1 of 1", "eq (10) as the slider")
        await pilot.press("escape", "slash", *"friction rolling", "enter")
        await shows(pilot, "rows 1-3 of 3")
        await until(pilot, lambda: app.screen.sources)
        await pilot.resize_terminal(160, 50)
        await shows(pilot, "used by 4 stored sweeps", "viscous_coefficient", "presets: linear_motor_table")

    pilot_of(workspace, steps)


def test_a_broken_plugin_stands_first_with_its_reason(workspace):
    drop(workspace, "import [nowhere\n", "bad.py")

    async def steps(app, pilot):
        await pilot.press("p")
        await shows(pilot, "broken: SyntaxError", "bad.py", "1 broken")
        lines = screen_text(app).splitlines()
        assert "bad.py" in next(line for line in lines if "broken" in line)
        await pilot.press("enter")
        await shows(pilot, "reloaded when", "fraexp check plugins/bad.py")
        await pilot.press("escape")
        await shows(pilot, "rows 1-")

    pilot_of(workspace, steps)


@pytest.mark.thorough
def test_a_file_that_is_added_broken_and_mended_is_noticed(workspace):
    async def steps(app, pilot):
        await pilot.press("p")
        await shows(pilot, "composite")
        drop(workspace, LAW.format(stiffness=2.0))
        await until(pilot, lambda: told(app, "plugins/mine.py added"))
        await pilot.press("slash", *"mine", "enter")
        await shows(pilot, "Mine (1968): a spring [with brackets] that slips.", "A second paragraph.")
        assert "A third paragraph" not in screen_text(app)
        drop(workspace, "1/0")
        await shows(pilot, "ZeroDivisionError", "broken", "mine.py, line 1")
        assert told(app, "plugins/mine.py changed; it failed to load: ZeroDivisionError")
        drop(workspace, LAW.format(stiffness=2.0))
        await shows(pilot, "A second paragraph.")
        assert not app.backend.workspace.registry.failures
        (workspace / "plugins/mine.py").unlink()
        await until(pilot, lambda: told(app, "plugins/mine.py removed"))
        await shows(pilot, "No component matches")

    pilot_of(workspace, steps)


@pytest.mark.thorough
def test_enter_on_what_is_no_friction_shows_all_of_its_description(workspace):
    async def steps(app, pilot):
        await pilot.press("p")
        await shows(pilot, "composite")
        await pilot.press("slash", *"estimator effective_input", "enter", "enter")
        await shows(pilot, "fraexp check effective_input --kind estimator", "estimator effective_input")

    pilot_of(workspace, steps)


def test_stored_sweeps_of_another_source_are_stale(workspace):
    with Store.open(str(workspace / "results.db"), read_only=True) as store:
        sources = store.sources()
    (hash_now,) = sources["friction:rolling"]
    assert sources["friction:rolling"] == {hash_now: 4}
    rolling = next(of for of in list_offers(WorkspaceService.open(workspace).registry) if of.name == "rolling")
    assert rolling.state(sources) == "ok"
    assert rolling.uses(sources) == (4, 0)
    assert rolling.state({"friction:rolling": {"another": 3, hash_now: 1}}) == "ok, 3 stale"


def test_an_edit_within_the_second_that_keeps_the_size_is_loaded(tmp_path):
    file = drop(tmp_path, LAW.format(stiffness=2.0))
    state = file.stat()
    assert load_file(file).Mine().stiffness == 2.0
    file.write_text(LAW.format(stiffness=3.0), encoding="utf-8")
    os.utime(file, ns=(state.st_atime_ns, state.st_mtime_ns))
    assert discover(file.parent).create("friction", {"name": "mine"}).stiffness == 3.0


def test_two_plugins_of_one_name_are_told(workspace):
    drop(workspace, LAW.format(stiffness=1.0).replace('"mine"', '"dahl"'))
    found = list_offers(WorkspaceService.open(workspace).registry)
    assert found[0].kind == "broken"
    assert "provided by both" in found[0].reason
    (dahl,) = [of for of in found if of.name == "dahl"]
    assert dahl.state({}) == "broken"


@pytest.mark.parametrize("there", [True, False])
def test_the_watch_tells_what_happened_to_files(tmp_path, there):
    folder = tmp_path / "plugins"
    if there:
        folder.mkdir()
    watch = PluginWatch(folder)
    assert watch.changes() == {}
    file = drop(tmp_path, "x = 1")
    assert watch.changes() == {"mine.py": "added"}
    file.write_text("x = 22", encoding="utf-8")
    assert watch.changes() == {"mine.py": "changed"}
    file.unlink()
    folder.rmdir()
    assert watch.changes() == {"mine.py": "removed"}
    assert watch.changes() == {}
