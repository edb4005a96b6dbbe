"""A run's page: while it lives, when it is over, when it died, when it never began."""

import os
import signal

import pytest

from fraexp.execution import background
from fraexp.store import Store
from fraexp.tui.screens.run_page import LogTail, RunPage, _launch_arguments, show_run
from fraexp.tui.widgets import preview_plot
from fraexp.views.run_progress import bar_text, progress_text
from fraexp.workspace.workspace_service import WorkspaceService
from tests.tui.pilots import pilot_of, screen_text, settle, shows, until

SLOW = [
    "excitation.min_frequency=1e-3",
    "excitation.points=3",
    "excitation.settling_tolerance=1e-15",
    "excitation.settling_timeout=10000",
]


@pytest.fixture
def living(workspace):
    """A run that takes its time; none is left when a test is over."""
    started = WorkspaceService.open(workspace).launch("quick", SLOW, "processes:1")
    yield started
    try:
        os.killpg(started.pid, signal.SIGKILL)
    except ProcessLookupError:
        return
    finally:
        started.process.wait()


async def begun(app, pilot) -> None:
    """Wait until a run computes: a law that is new to the machine is compiled at its first use."""
    await until(pilot, lambda: isinstance(app.screen, RunPage))
    await until(pilot, lambda: app.screen.run and (app.screen.run.progress or app.screen.run.state != "running"))
    await shows(pilot, "running")


@pytest.mark.thorough
def test_a_run_that_is_over_shows_its_sweeps_and_that_it_has_no_log(workspace, keys):
    async def steps(app, pilot):
        show_run(app, 1)
        await shows(pilot, "complete", "4 of 4 sweeps", "100 %", "conventional", "$ fraexp show 1")
        await shows(pilot, "no log: the run was started in a terminal")
        await pilot.press("x")
        await pilot.press("c")
        await until(pilot, lambda: list(app.marks) == keys)
        assert app.current_mode == "compare"
        await until(pilot, lambda: getattr(app.screen, "command", "").startswith("fraexp plot 1 --kind bode"))

    pilot_of(workspace, steps)


@pytest.mark.thorough
def test_failures_are_told_without_commanding_the_terminal(workspace):
    async def steps(app, pilot):
        show_run(app, 2)
        await shows(pilot, "no usable result", "1 failed", "failed: ValueError: nothing to [bold]divide\\x1b[31m by")
        await pilot.press("c")
        await settle(pilot)
        assert isinstance(app.screen, RunPage)  # there is nothing to compare

    pilot_of(workspace, steps, (120, 30))


@pytest.mark.thorough
def test_a_run_is_watched_stopped_and_goes_on(workspace, living):
    async def steps(app, pilot):
        show_run(app, living)
        await begun(app, pilot)
        await shows(pilot, "0 of 4 sweeps", "1 worker")
        page = app.screen
        await pilot.press("x")
        await shows(pilot, "stopped", "It was stopped; finished sweeps are kept. R continues the run.")
        assert not page.live
        await pilot.press("R")
        await until(pilot, lambda: isinstance(app.screen, RunPage) and app.screen is not page)
        again = app.screen.started
        try:
            await until(pilot, lambda: app.screen.number == page.number + 1)
            assert app.screen.run.command == page.run.command
            assert app.screen.run.provenance["executor"] == "processes:1"
            app.screen._stopping = True  # it would end before a second x
            await pilot.press("x")
            await shows(pilot, "Kill its processes?")
            await pilot.press("y")
            await shows(pilot, "process lost")
        finally:
            background.stop(again.pid, hard=True)
            again.process.wait()

    pilot_of(workspace, steps)


@pytest.mark.thorough
def test_a_run_whose_process_dies_is_shown_as_lost_within_seconds(workspace, living):
    async def steps(app, pilot):
        show_run(app, living)
        await begun(app, pilot)
        os.killpg(living.pid, signal.SIGKILL)
        await shows(pilot, "process lost", "Its process ended before all sweeps were finished")

    pilot_of(workspace, steps)


@pytest.mark.thorough
def test_a_process_that_ends_without_a_run_shows_its_last_line(workspace):
    started = WorkspaceService.open(workspace).launch("nowhere")

    async def steps(app, pilot):
        show_run(app, started)
        await shows(pilot, "failed to start (exit code 2)", "there is no study 'nowhere'")
        assert not app.screen.live

    pilot_of(workspace, steps)
    started.process.wait()


def test_the_log_is_followed_line_by_line_and_made_harmless(tmp_path, workspace):
    log = tmp_path / "run.log"
    log.write_bytes("".join(f"line {number}\n" for number in range(500)).encode() + b"\x1b[2Jclear\nhalf a ")

    async def steps(app, pilot):
        show_run(app, 1)
        await until(pilot, lambda: isinstance(app.screen, RunPage))
        await shows(pilot, "complete")
        tail = app.screen.query_one(LogTail)
        tail.follow(log)
        assert tail.last == "\\x1b[2Jclear"
        assert tail.line_count <= 200
        with log.open("ab") as stream:
            stream.write(b"line\n")
        tail.follow(log)
        assert tail.last == "half a line"
        log.unlink()
        tail.follow(log)
        assert "cannot be read" in str(tail.border_title)
        assert "\x1b" not in screen_text(app)

    pilot_of(workspace, steps)


def test_what_is_run_again_is_what_was_run(made):
    space = WorkspaceService.open(made)
    with Store.open(str(made / "results.db"), read_only=True) as store:
        assert _launch_arguments(store.run(1), space) == ("quick", ["excitation.points=5"])
        assert _launch_arguments(store.run(2), space) == ("failing", [])
        elsewhere = WorkspaceService.open(made / "plugins")  # where 'failing' cannot be found
        assert _launch_arguments(store.run(2), elsewhere) == (store.run(2).study_file, [])


@pytest.mark.parametrize(("part", "shown"), [(0.0, "░░░░"), (0.5, "██░░"), (0.999, "███░"), (1.0, "████")])
def test_a_bar_is_only_full_when_all_is_done(part, shown):
    assert bar_text(part, 4) == shown


def test_progress_tells_speed_and_time_left(workspace):
    with Store.open(str(workspace / "results.db"), read_only=True) as store:
        run = store.run(1)
    assert progress_text(run, 4) == "████ 100 %  4 of 4 sweeps"


def test_work_that_repeats_itself_rests_for_its_share(monkeypatch: pytest.MonkeyPatch) -> None:
    now = {"monotonic": 100.0, "process_time": 5.0}
    monkeypatch.setattr(preview_plot.time, "monotonic", lambda: now["monotonic"])
    monkeypatch.setattr(preview_plot.time, "process_time", lambda: now["process_time"])
    budget = preview_plot.RefreshBudget(0.05)
    budget.end()
    assert not budget.is_resting
    budget.begin()
    now["process_time"] += 0.1
    budget.end()
    for passed, rests in ((0.0, True), (1.9, True), (2.1, False)):
        now["monotonic"] = 100.0 + passed
        assert budget.is_resting == rests
