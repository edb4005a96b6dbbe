"""Trying a friction law on its screen: what is drawn, and what is wrong."""

import shlex

import pytest

from fraexp.tui.app import FraexpApp
from fraexp.tui.screens.trial_page import TrialPage
from fraexp.views.law_trial import TRIAL_STUDY
from fraexp.workspace.workspace_service import WorkspaceService
from tests.tui.pilots import pilot_of, screen_text, shows, until
from tests.tui.test_plugins import LAW, drop


def write(app: FraexpApp, path: str, text: str) -> None:
    form = app.screen.form
    form.choose(next(field for field in form.fields if field.path == path))
    form.write(text)


async def opened(pilot, name: str) -> None:
    await pilot.app.push_screen(TrialPage(name))
    await shows(pilot, "/cycle")


def test_what_is_typed_is_drawn(workspace):
    async def steps(app, pilot):
        await pilot.press("p")
        await shows(pilot, "composite")
        await pilot.press("slash", *"dahl", "enter", "enter")
        await shows(pilot, "friction dahl", "N 79.29 kN/m, 22.5 deg", "force [N] over displacement [µm]")
        await shows(pilot, "presliding")  # of the field that has the focus
        before = screen_text(app)
        await pilot.press("up")
        await shows(pilot, "105000")
        await until(pilot, lambda: "stiffness = 105000" in app.screen.command)
        assert screen_text(app) != before
        await pilot.press("enter")
        await shows(pilot, "friction.coulomb_force  Coulomb")
        await pilot.press("escape")
        await shows(pilot, "rows 1-")

    pilot_of(workspace, steps)


@pytest.mark.thorough
def test_what_is_wrong_is_told_by_its_field_and_the_curves_stay(workspace):
    async def steps(app, pilot):
        await opened(pilot, "dahl")
        good = app.screen.command
        write(app, "friction.coulomb_force", "-3")
        await shows(pilot, "force Fc must", "! coulomb_force", "previous: N ")
        assert "! stiffness" not in screen_text(app)
        assert app.screen.command == good
        write(app, "friction.coulomb_force", "17.9 mV")
        await shows(pilot, "17.9 mV", "! coulomb_force")
        write(app, "friction.coulomb_force", "20")
        await until(pilot, lambda: "coulomb_force = 20" in app.screen.command)
        assert "! coulomb_force" not in screen_text(app)
        write(app, "excitation.frequency", "0")
        await shows(pilot, "frequency is 0", "! frequency")

    pilot_of(workspace, steps)


@pytest.mark.thorough
def test_the_describing_function_stands_below_and_f6_shows_its_phase_where_room_is_short(workspace):
    async def steps(app, pilot):
        await opened(pilot, "rolling")
        await shows(pilot, "|N| [N/m] over amplitude [m]")
        assert "phase of N [deg]" not in screen_text(app)
        await pilot.press("f6")
        await shows(pilot, "phase of N [deg] over amplitude [m]")
        assert "force [N] over" not in screen_text(app)
        await pilot.resize_terminal(160, 50)
        await shows(pilot, "force [N] over", "|N| [N/m] over", "phase of N [deg] over")

    pilot_of(workspace, steps)


@pytest.mark.thorough
def test_a_law_that_is_edited_while_it_is_tried_is_tried_anew(workspace):
    drop(workspace, LAW.format(stiffness=2e4))

    async def steps(app, pilot):
        await opened(pilot, "mine")
        await shows(pilot, "20000")
        write(app, "excitation.amplitude", "1e-5")
        drop(workspace, "import nowhere_at_all")
        await shows(pilot, "ModuleNotFoundError")
        drop(workspace, LAW.format(stiffness=2e4).replace("dy, -1.0), 1.0)", "dy * 3, -1.0), 1.0)"))
        await shows(pilot, "N 60 kN/m")
        await shows(pilot, "1e-5")

    pilot_of(workspace, steps)


@pytest.mark.thorough
def test_the_command_at_the_top_can_be_run(workspace):
    found = []

    async def steps(app, pilot):
        await opened(pilot, "rolling")
        await until(pilot, lambda: "--set=friction" in app.screen.command)
        found.append(app.screen.command)

    pilot_of(workspace, steps)
    words = shlex.split(found[0])
    assert words[:3] == ["fraexp", "run", TRIAL_STUDY]
    sets = [word.removeprefix("--set=") for word in words[3:]]
    (study,) = WorkspaceService.open(workspace).studies([TRIAL_STUDY], sets)
    assert [sweep.experiment["friction"]["name"] for sweep in study.sweeps] == ["rolling"]
    assert study.sweeps[0].experiment["excitation"]["amplitude"] == 1e-4
