"""One sweep: its sections, and what is told when something has changed."""

import pytest

from fraexp.store import Store
from fraexp.tui.screens.sweep_page import SweepPage
from tests.tui.pilots import pilot_of, screen_text, shows, until


async def opened(app, pilot, key: str) -> None:
    """Open a sweep, and wait until all is read."""
    await pilot.press("w")
    await until(pilot, lambda: app.screen.PLACE == "sweeps")
    await app.push_screen(SweepPage(key))
    await until(pilot, lambda: isinstance(app.screen, SweepPage) and app.screen._parameters)


def failed(workspace) -> str:
    """Return the key of the sweep that failed."""
    with Store.open(str(workspace / "results.db"), read_only=True) as store:
        return store.sweeps(2)[0].key


def test_enter_opens_the_sweep_under_the_cursor_and_esc_leaves_it(workspace):
    async def steps(app, pilot):
        await pilot.press("w")
        await until(pilot, lambda: app.screen.PLACE == "sweeps" and app.screen.table.keys)
        key = app.screen.table.key
        await pilot.press("enter")
        await shows(pilot, f"sweep {key[4:12]}", f"$ fraexp show {key[4:12]}", "excitation.amplitude = ")
        await pilot.press("escape")
        await shows(pilot, "$ fraexp list --sweeps")

    pilot_of(workspace, steps)


@pytest.mark.thorough
def test_all_points_are_shown_and_the_command_follows(workspace, keys):
    async def steps(app, pilot):
        await opened(app, pilot, keys[0])
        await pilot.press("2")
        await shows(pilot, "frequency", "[dB re 1 mm/N]", "rows 1-5 of 5", "--points")
        with Store.open(str(workspace / "results.db"), read_only=True) as store:
            response = store.result(keys[0]).response
        for frequency in response.frequency:
            assert f"{frequency:.6g}" in screen_text(app)

    pilot_of(workspace, steps)


@pytest.mark.thorough
def test_parameters_have_units_origins_and_meanings(workspace, keys):
    async def steps(app, pilot):
        await opened(app, pilot, keys[0])
        await pilot.press("3")
        await shows(pilot, "plant.rigid_body_gain = 0.132 m/(N s²)  from study", "rigid-body gain k0")
        await pilot.press("G")
        await shows(pilot, "estimator.refer_to_plant = true  from grid")
        await pilot.press("g")
        await pilot.resize_terminal(200, 50)
        await shows(pilot, "parameter", "meaning", "reciprocal of the moving mass")

    pilot_of(workspace, steps)


@pytest.mark.parametrize(
    ("path", "origin"),
    [
        ("excitation.amplitude", "grid"),
        ("estimator", "grid"),
        ("plant.viscous_coefficient", "default"),
        ("plant.rigid_body_gain", "study"),
        ("estimator.input_dead_time", "loop.input_dead_time"),
    ],
)
def test_it_is_told_where_values_are_from(workspace, keys, registry, path, origin):
    from fraexp.views.resolved_parameters import resolved_parameters

    with Store.open(str(workspace / "results.db"), read_only=True) as store:
        rows = {row.path: row for row in resolved_parameters(store.find(keys[0]), registry)}
    assert rows[path].origin == origin


@pytest.mark.thorough
def test_provenance_tells_run_command_and_plugins_that_have_changed(workspace, keys):
    async def steps(app, pilot):
        await opened(app, pilot, keys[0])
        await pilot.press("4")
        await shows(pilot, "fraexp run quick --set=excitation.points=5", "estimator:conventional", "unchanged")

    pilot_of(workspace, steps, size=(100, 40))


def test_a_sweep_of_a_plugin_that_has_changed_or_gone_says_so(workspace, keys, registry):
    from dataclasses import replace

    from fraexp.store import ComponentOrigin
    from fraexp.tui.screens.sweep_page import source_states

    with Store.open(str(workspace / "results.db"), read_only=True) as store:
        sweep = store.find(keys[0])
    older = {
        "estimator:conventional": ComponentOrigin("0" * 64, "fraexp"),
        "estimator:nobody": ComponentOrigin("0" * 64, "x"),
    }
    found = {of.component: of.status for of in source_states(replace(sweep, sources=older), registry)}
    assert found["estimator:conventional"].startswith("changed since")
    assert found["estimator:nobody"] == "gone"


def test_a_sweep_that_failed_shows_its_message_and_log(workspace):
    async def steps(app, pilot):
        await opened(app, pilot, failed(workspace))
        await shows(pilot, "failed", r"ValueError: nothing to [bold]divide\x1b[31m by", "no result; the summary")
        await pilot.press("2")
        assert "rows" not in screen_text(app)  # there are no points to be shown
        await pilot.press("5")
        await shows(pilot, "Traceback", "raise ValueError")
        assert "\x1b" not in screen_text(app)

    pilot_of(workspace, steps)


@pytest.mark.thorough
def test_it_is_marked_tagged_and_compared_with_the_marked_ones_here_too(workspace, keys):
    async def steps(app, pilot):
        await opened(app, pilot, keys[1])
        await pilot.press("space")
        await shows(pilot, "1 marked")
        await pilot.press("t")
        await shows(pilot, "(one word)?")
        await pilot.press(*"fine", "enter")
        await shows(pilot, "tags fine")
        app.marks.add([keys[0]])
        await pilot.press("c")
        await until(pilot, lambda: app.current_mode == "compare")
        assert list(app.marks) == [keys[1], keys[0]]

    pilot_of(workspace, steps)


@pytest.mark.thorough
def test_deleting_it_here_leads_back(workspace, keys):
    async def steps(app, pilot):
        await opened(app, pilot, keys[0])
        await pilot.press("D")
        await shows(pilot, "Delete 1 sweep with results")
        await pilot.press("y")
        await shows(pilot, "rows 1-4 of 4")

    pilot_of(workspace, steps)
