"""The screens of a measurement: its plan, what is shown while a machine moves, and that it stops whatever dies.

The machine is the simulated one in its own process. It waits for whoever measures, so that nothing depends on time.
"""

import io
import json
import os
import pickle
import signal
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from fraexp.data.sample_file import SampleWriter
from fraexp.measurement.consent import CONSENTS_VARIABLE
from fraexp.measurement.measured_points import MeasurementFiles
from fraexp.store import Store
from fraexp.tui.screens.launch_page import LaunchPage
from fraexp.tui.screens.measurement_page import (
    MARGIN_SIGN,
    PREDICTED_SIGN,
    LimitGauges,
    MeasurementPage,
    MeasurementPlanPage,
)
from fraexp.tui.screens.run_page import RunPage
from fraexp.tui.screens.studies_page import StudiesPage
from fraexp.tui.services.live_measurement import LimitedMotion, read_changes
from fraexp.views.run_progress import FULL
from tests.tui.pilots import pilot_of, screen_text, settle, shows, until
from tests.waiting import wait_until

STUDY = """
title = "An axis"
machine = "linear_motor_table"

[excitation]
name = "stepped_sine"
frequencies = [38.8, 100.0]
amplitude = 40
recorded_periods = 4

[loop]
noise = 30e-9

[limits]
stroke = 0.02
velocity = 0.5
force = 150

[measurement]
machine = { name = "simulated", log = "LOG" }

[grid]
"estimator" = [{ name = "conventional", refer_to_plant = true }, { name = "effective_input" }]
"""
ENDLESS = 'machine = { name = "simulated", log = "LOG" }\nband = 1e-9\nmax_record_time = 3000'
"""A band that is never reached: the first point is recorded until somebody stops it."""
RAMP_OUT, LOCKSTEP_SAMPLES = 100, 50
"""Samples in which the excitation falls, and by which the machine is ahead of who measures."""


@pytest.fixture
def axis(tmp_path: Path) -> Path:
    """A workspace with a study that can be measured."""
    return write_study(tmp_path, STUDY)


@pytest.fixture
def endless(tmp_path: Path) -> Path:
    """The same with a measurement that does not end by itself."""
    return write_study(tmp_path, STUDY.replace('machine = { name = "simulated", log = "LOG" }', ENDLESS))


def write_study(folder: Path, text: str) -> Path:
    (folder / "studies").mkdir()
    (folder / "studies" / "axis.toml").write_text(text.replace("LOG", str(folder / "machine.log")), encoding="utf-8")
    return folder


def machine_events(folder: Path) -> list[dict[str, Any]]:
    log = folder / "machine.log"
    return [json.loads(line) for line in log.read_text().splitlines() if line.endswith("}")] if log.exists() else []


def last_event(folder: Path) -> str:
    events = machine_events(folder)
    return str(events[-1]["event"]) if events else ""


async def choose(app, pilot, study: str = "axis") -> None:
    """Put the cursor on a study."""
    await until(pilot, lambda: isinstance(app.screen, StudiesPage) and app.screen.item)
    await pilot.press("slash", *study, "enter")
    await until(pilot, lambda: app.screen.item and app.screen.item.name == study)


async def begin(app, pilot) -> None:
    """Plan the study, and let it be measured."""
    await choose(app, pilot)
    await pilot.press("m")
    await shows(pilot, "of machine time on machine 'simulated'")
    await pilot.press("enter")
    await shows(pilot, "The machine 'simulated' will move", "Is it clear?")
    await pilot.press("y")
    await until(pilot, lambda: isinstance(app.screen, MeasurementPage))


async def play(app, pilot) -> None:
    """Measure until the first point is being recorded."""
    await begin(app, pilot)
    await until(pilot, lambda: app.measurement.played and app.measurement.played.periods > 8)
    await shows(pilot, "100 Hz, 40 N peak: settled")  # the target is cut where the number of periods is long


def test_a_program_of_a_study_is_allowed_in_a_dialog_before_it_runs(tmp_path, monkeypatch):
    monkeypatch.setenv(CONSENTS_VARIABLE, str(tmp_path / "consents"))
    command = 'machine = { name = "command", program = ["python3", "axis.py"] }'
    folder = write_study(tmp_path, STUDY.replace('machine = { name = "simulated", log = "LOG" }', command))
    (folder / "axis.py").write_text("open('ran', 'w')\nraise SystemExit('the drive is off')", encoding="utf-8")

    async def steps(app, pilot):
        await choose(app, pilot)
        await pilot.press("m")
        await shows(pilot, "'command' offers no disable")
        await pilot.press("f5")
        await shows(pilot, "The study would run", "python3", "axis.py in", "Allow it, now and later?")
        await pilot.press("n")
        await until(pilot, lambda: isinstance(app.screen, MeasurementPlanPage))
        assert not (tmp_path / "consents").exists()
        await pilot.press("f5", "y")
        await shows(pilot, "The machine 'command' will move")
        await pilot.press("y")
        await until(pilot, lambda: app.measurement and app.measurement.has_ended)
        assert "the drive is off" in app.measurement.message

    pilot_of(folder, steps)
    assert (tmp_path / "ran").exists()


@pytest.mark.thorough
def test_a_study_is_planned_measured_and_analysed(axis):
    async def steps(app, pilot):
        await choose(app, pilot)
        await pilot.press("m")
        await shows(pilot, "2 points, about", "rows 1-2 of 2", "stroke", "of 20 mm", "38.79 Hz", "100 Hz")
        assert app.screen.command == "fraexp measure axis"
        await pilot.press("f5")
        await shows(pilot, "Is it clear?")
        await pilot.press("enter")  # which answers no
        await until(pilot, lambda: isinstance(app.screen, MeasurementPlanPage))
        assert not machine_events(axis)
        await pilot.press("f5", "y")
        await until(pilot, lambda: isinstance(app.screen, RunPage))
        assert app.measurement.state == "complete"
        assert [label for label, _ in app.measurement.responses] == ["conventional", "effective_input"]
        await shows(pilot, "axis-measured", "complete", "2 computed")
        assert app.screen.command.startswith("fraexp show ")

    pilot_of(axis, steps)
    with Store.open(str(axis / "results.db"), read_only=True) as store:
        (run,) = store.runs()
        measured = store.results([sweep.key for sweep in store.sweeps(run.number)])
    assert [len(of.response.frequency) for of in measured.values()] == [2, 2]


@pytest.mark.thorough
def test_one_key_stops_softly_and_the_measurement_goes_on_later(endless):
    async def steps(app, pilot):
        await play(app, pilot)
        await shows(pilot, "▶ measuring 0/2", "stroke", "µm of 20 mm", "Repeated or lost: nothing")
        await pilot.press("x")
        await until(pilot, lambda: app.measurement.has_ended)
        await shows(pilot, "stopped", "measured points are kept; R continues with the point that was lost")
        assert "▶ measuring" not in screen_text(app)
        await pilot.press("x")
        assert app.measurement.state == "stopped"
        await pilot.press("R")
        await until(pilot, lambda: isinstance(app.screen, MeasurementPlanPage))
        await shows(pilot, "of machine time on machine 'simulated'")

    pilot_of(endless, steps)
    *_, played, rested = machine_events(endless)  # the axis is watched at rest before
    assert (played["event"], rested["event"], rested["reason"]) == ("play", "rest", "")  # no watchdog
    samples = endless / "measurements" / "axis.samples"
    with closing(SampleWriter(samples)) as writer:
        recorded = writer.rows
    assert recorded + RAMP_OUT <= rested["samples"] <= recorded + RAMP_OUT + 4 * LOCKSTEP_SAMPLES


@pytest.mark.thorough
def test_leaving_the_screen_keeps_measuring_and_every_screen_says_so(endless):
    async def steps(app, pilot):
        await play(app, pilot)
        live = app.measurement
        await pilot.press("escape")
        await until(pilot, lambda: isinstance(app.screen, StudiesPage))
        for key in ("r", "p", "s"):
            await pilot.press(key)
            await shows(pilot, "▶ measuring 0/2")
        await pilot.press("m")
        await until(pilot, lambda: isinstance(app.screen, MeasurementPage))
        assert app.screen.measurement is live and live.state == "measuring"
        await shows(pilot, "100 Hz, 40 N peak: settled")
        await pilot.press("q")
        await shows(pilot, "Stop the machine and quit?")
        await pilot.press("n")
        assert live.state == "measuring"
        await pilot.press("q", "y")
        await until(pilot, lambda: app._exit)
        assert live.state == "stopped"

    pilot_of(endless, steps)
    assert [event["event"] for event in machine_events(endless)[-2:]] == ["play", "rest"]


@pytest.mark.thorough
def test_the_machine_stops_by_its_watchdog_if_the_measuring_process_is_killed(endless):
    async def steps(app, pilot):
        await play(app, pilot)
        os.kill(app.measurement._process.pid, signal.SIGKILL)
        await shows(pilot, "process lost", "ended with code -9; the machine stops by its watchdog")
        await until(pilot, lambda: last_event(endless) == "rest")

    pilot_of(endless, steps)
    assert [event["event"] for event in machine_events(endless)[-3:]] == ["play", "watchdog", "rest"]


DRIVEN = """
import asyncio, sys
from pathlib import Path
from tests.tui.pilots import pilot_of
from tests.tui.test_measuring import play

async def steps(app, pilot):
    await play(app, pilot)
    print("playing", file=sys.__stdout__, flush=True)  # textual has its own stdout
    await asyncio.sleep(3600)

pilot_of(Path(sys.argv[1]), steps)
"""


@pytest.mark.thorough
def test_the_machine_stops_softly_if_the_terminal_ui_is_killed(endless):
    root = Path(__file__).parents[2]
    with subprocess.Popen([sys.executable, "-c", DRIVEN, str(endless)], cwd=root, stdout=subprocess.PIPE) as ui:
        assert ui.stdout is not None
        assert ui.stdout.readline() == b"playing\n"
        ui.kill()
    wait_until(lambda: last_event(endless) == "rest")
    assert [event["event"] for event in machine_events(endless)[-2:]] == ["play", "rest"]  # before its watchdog


@pytest.mark.thorough
def test_a_limit_that_is_exceeded_stops_it_and_is_named(axis):
    file = axis / "studies" / "axis.toml"
    limited = file.read_text().replace("velocity = 0.5", "velocity = 0.06").replace("[38.8, 100.0]", "[20.0]")
    shape = "frequencies = [38.8], damping_ratios = [0.05], modal_gain_ratios = [0.3]"
    stronger = f'plant = {{ name = "modal", rigid_body_gain = 0.264, {shape} }}'
    file.write_text(limited.replace('name = "simulated",', f'name = "simulated", {stronger},'))

    async def steps(app, pilot):
        await begin(app, pilot)
        await shows(pilot, "failed", "limits.velocity is 0.06 m/s at 20 Hz; the machine was stopped")
        await shows(pilot, "R tries again")

    pilot_of(axis, steps, (120, 40))


def test_a_study_that_cannot_be_measured_says_what_it_lacks(tmp_path):
    write_study(tmp_path, STUDY[: STUDY.index("[limits]")] + STUDY[STUDY.index("[grid]") :])

    async def steps(app, pilot):
        await choose(app, pilot)
        await pilot.press("m")
        await shows(pilot, "[limits] does not state stroke and velocity and force")
        await shows(pilot, "lacks the section [measurement]", 'machine = { name = "simulated" }', "Nothing was played")
        await pilot.press("f5")
        await settle(pilot)
        assert isinstance(app.screen, MeasurementPlanPage)
        await pilot.press("escape")
        await until(pilot, lambda: isinstance(app.screen, StudiesPage))

    pilot_of(tmp_path, steps)


@pytest.mark.thorough
def test_the_form_leads_to_the_plan_with_its_values_and_a_refusal_names_the_number(axis):
    async def steps(app, pilot):
        await choose(app, pilot)
        await pilot.press("enter")
        await until(pilot, lambda: isinstance(app.screen, LaunchPage) and app.screen.groups)
        app.screen.written.changes["excitation.amplitude"] = "130"
        await pilot.press("f6")
        await shows(pilot, "predicted to need a force of 1", "limits.force is 150 N", "Nothing was played")
        assert app.screen.command == "fraexp measure axis --set=excitation.amplitude=130 --dry-run"
        await pilot.press("escape")
        await until(pilot, lambda: isinstance(app.screen, LaunchPage))

    pilot_of(axis, steps, (120, 40))


@pytest.mark.thorough
def test_points_of_an_earlier_measurement_are_kept_or_discarded_by_a_key(axis):
    async def steps(app, pilot):
        await begin(app, pilot)
        await until(pilot, lambda: isinstance(app.screen, RunPage))
        await pilot.press("s", "m")
        await shows(pilot, "2 points of an earlier measurement kept: F discards them")
        await pilot.press("F")
        await shows(pilot, "What was recorded before is discarded.")
        await pilot.press("y")
        await until(pilot, lambda: isinstance(app.screen, MeasurementPage))
        await until(pilot, lambda: isinstance(app.screen, RunPage))
        file = axis / "studies" / "axis.toml"
        file.write_text(file.read_text().replace("amplitude = 40", "amplitude = 41"))
        await pilot.press("s", "m")
        await shows(pilot, "a measurement with another machine, excitation or setting is stored: F discards it")
        await pilot.press("f5")
        await settle(pilot)
        assert isinstance(app.screen, MeasurementPlanPage)

    pilot_of(axis, steps)
    played = [event["number"] for event in machine_events(axis) if event["event"] == "play"]
    assert played.count(1) == 2, played  # the second point of both measurements; the first has the number of a rest
    assert len(MeasurementFiles(axis / "measurements", "axis").points()) == 2


def test_changes_that_were_cut_off_end_the_stream():
    whole = pickle.dumps({"done": 1})
    assert read_changes(io.BytesIO(whole)) == {"done": 1}
    for length in range(len(whole)):
        assert read_changes(io.BytesIO(whole[:length])) is None


def test_a_gauge_shows_what_is_used_what_was_predicted_and_where_the_margin_begins(tmp_path):
    motions = [LimitedMotion("force", "N", 100.0, 60.0, 0), LimitedMotion("stroke", "m", 0.02, 0.005, 1)]

    async def steps(app, pilot):
        gauges = LimitGauges("")
        await app.screen.mount(gauges, before=0)
        await pilot.pause()
        gauges.show(motions, 0.1, (95.0, 0.001), (60.0, 0.005))
        await shows(pilot, "95 N of 100 N", " 95 % !", "1 mm of 20 mm", "  5 %")
        force, stroke = (line for line in screen_text(app).splitlines() if " of " in line and "%" in line)
        bar = stroke.split()[1]
        assert bar.count(FULL) == round(0.05 * len(bar))
        assert bar.index(PREDICTED_SIGN) == int(0.25 * len(bar)) and bar.index(MARGIN_SIGN) == int(0.9 * len(bar))
        assert force.split()[1].count(FULL) == round(0.95 * len(bar))
        assert all(len(line.split()[1]) == len(bar) for line in (force, stroke))

    pilot_of(tmp_path, steps, (80, 24))
