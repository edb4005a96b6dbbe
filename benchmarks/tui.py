"""Measure the time from a key to the repaint of the terminal UI, and what watching a run costs it.

python benchmarks/tui.py prints a table and fails where a bound is missed; with `live` it measures what watching
costs (`live 1`: once).
Each time is from the key until its last paint is ready to be written to the terminal, in this process; the bound is
for the median of a key's repetitions. Other work on the machine adds to it, unlike to the processor time: the bounds
are for an idle machine.
"""

import asyncio
import os
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from textual._compositor import CompositorUpdate
from textual.pilot import Pilot
from textual.screen import Screen

import fraexp.tui
from fraexp.data.results import FrequencyResponse, Outcome, Result
from fraexp.data.sweep import Sweep
from fraexp.store import Store
from fraexp.tui.app import FraexpApp
from fraexp.tui.plotting.plot_stack import PlotStack
from fraexp.tui.screens.run_page import RunPage
from fraexp.tui.screens.studies_page import StudiesPage
from fraexp.workspace.workspace_service import WorkspaceService

BOUND = 0.100
"""Most time [s] from key to repaint."""
OPENING_BOUND = 1.0
"""Most time [s] until the first picture of many sweeps."""
MANY = 10_000
"""Number of sweeps of a large run."""
WATCHING_BOUND = 0.05
"""Most of its time by which a run may take longer when it is watched."""
SIZE = (200, 50)
DRAWN = """
title = "Random draws"
question = "How long does it take?"
machine = "linear_motor_table"
excitation = { name = "stepped_sine", points = 30 }
estimator = { name = "conventional" }

[grid]
"excitation.amplitude" = [6, 12, 25, 75]

[monte_carlo]
count = 2500
seed = 1
draw = [{ paths = "friction.curve.coulomb_force", relative = 0.1 }]
"""
"""A run of 10,000 sweeps, which takes some minutes."""
Row = tuple[str, float, float, float]
"""What was measured, median and slowest wall time, and median processor time [s]."""


class Painted(FraexpApp):
    """The application without a terminal, with the time at which the last paint was ready."""

    CSS_PATH = Path(fraexp.tui.__file__).with_name("look.tcss")
    painted = (np.nan, np.nan)
    """Wall and processor time [s]."""

    def _display(self, screen: Screen[Any], renderable: Any) -> None:
        super()._display(screen, renderable)
        if isinstance(renderable, CompositorUpdate) and not self._batch_count:
            renderable.render_segments(self.console)
            self.painted = time.perf_counter(), time.process_time()


def main() -> int:
    """Measure all, and return 1 if a bound is missed."""
    if "live" in sys.argv[1:]:
        return watch_run(*map(int, sys.argv[2:3]))
    with TemporaryDirectory() as folder, TemporaryDirectory() as many:
        rows = asyncio.run(compare_keys(Path(folder)))
        opening, more = asyncio.run(compare_draws(Path(many)))
        rows += more
    print(f"{'key to repaint [ms]':50} {'median':>8} {'slowest':>8} {'processor':>10}")
    for name, median, slowest, processor in rows:
        print(f"{name:50} {1e3 * median:8.0f} {1e3 * slowest:8.0f} {1e3 * processor:10.0f}")
    first, processor, every = opening
    print(f"\nCompare opens {MANY:,} sweeps: first picture {first:.2f} s ({processor:.2f} s of a processor), ", end="")
    print(f"all sweeps {every:.2f} s")
    missed = [name for name, median, *_ in rows if not median <= BOUND]
    missed += ["opening"] if opening[0] > OPENING_BOUND else []
    if missed:
        print(f"bound missed: {', '.join(missed)}", file=sys.stderr)
    return int(bool(missed))


async def compare_keys(folder: Path, curves: int = 4, points: int = 5000) -> list[Row]:
    """Return times of keys in Compare with many points."""
    keys = store_responses(folder, curves, points)
    app = Painted(folder)
    async with app.run_test(size=SIZE) as pilot:
        while app.current_mode != "studies" or not app.screen.is_mounted:
            await pilot.pause(0.02)
        app.marks.add(keys)
        await pilot.press("c")
        await _until(pilot, lambda: _shows_picture(app))
        what = f"Compare, {curves} curves of {points} points:"
        return [
            await time_keys(app, pilot, f"{what} cursor", ["right"] * 20),
            await time_keys(app, pilot, f"{what} hide or show", ["2"] * 20),
            await time_keys(app, pilot, f"{what} focus", ["right_square_bracket"] * 20),
            await time_keys(app, pilot, f"{what} zoom", ["x", "X"] * 10),
            await time_keys(app, pilot, f"{what} pan", ["L", "H"] * 10),
            await time_keys(app, pilot, f"{what} wrapped phase", ["W"] * 20),
        ]


async def compare_draws(folder: Path) -> tuple[tuple[float, float, float], list[Row]]:
    """Return wall and processor time until the first picture, wall time until all sweeps, and times of keys."""
    keys = store_draws(folder, MANY)
    app = Painted(folder)
    async with app.run_test(size=SIZE) as pilot:
        while app.current_mode != "studies" or not app.screen.is_mounted:
            await pilot.pause(0.02)
        app.backend.workspace.registry  # noqa: B018 - loaded in the background in a session
        app.marks.add(keys)
        await pilot.pause(1.0)  # the first screen is read and drawn
        begin = np.array([time.perf_counter(), time.process_time()])
        pressed = asyncio.create_task(pilot.press("c"))  # which ends when nothing is left to do
        while not _shows_picture(app):
            await asyncio.sleep(0.01)
        app.painted = (np.nan, np.nan)
        while np.isnan(app.painted[0]):
            await asyncio.sleep(0.01)
        first, processor = app.painted - begin
        await pressed
        await _until(pilot, lambda: len(app.screen.compared.sweeps) == MANY)
        every = time.perf_counter() - begin[0]
        await pilot.pause(1.0)
        what = f"Compare, bands of {MANY:,} sweeps:"
        rows = [
            await time_keys(app, pilot, f"{what} cursor", ["right"] * 10),
            await time_keys(app, pilot, f"{what} hide or show", ["3"] * 10),
            await time_keys(app, pilot, f"{what} zoom", ["x", "X"] * 5),
            await time_keys(app, pilot, f"{what} other facet", ["g"] * 10),
        ]
    return (first, processor, every), rows


def store_draws(folder: Path, count: int, points: int = 30) -> list[str]:
    """Write responses of random draws at eight points of a grid into a database, and return the keys."""
    frequency, generator, pairs = np.geomspace(1.0, 200.0, points), np.random.default_rng(1), []
    for index in range(count):
        case, amplitude = ("conventional", "effective_input")[index % 2], (6.0, 12.0, 25.0, 75.0)[index // 2 % 4]
        viscous, turning = 4.7 + generator.normal(), frequency / (40 * (1 + 0.03 * generator.normal()))
        labels = {"case": case, "excitation.amplitude": amplitude, "draw": index // 8 + 1}
        labels["friction.viscous_coefficient"] = viscous
        experiment = {
            "source": "loop",
            "excitation": {"name": "stepped_sine", "amplitude": amplitude},
            "friction": {"name": "rolling", "viscous_coefficient": viscous},
        }
        value = 1e-3 / (1 - turning**2 + 0.1j * turning) / (1 + amplitude / 50)
        result = Result(Outcome.OK, response=_response(frequency, value))
        pairs.append((Sweep(experiment, {"name": case}, labels), result))
    with Store.open(str(folder / "results.db"), create=True) as store:
        run = store.begin_run("many", "many.toml", "fraexp run many", {}, [sweep for sweep, _ in pairs])
        store.save(run, [(sweep, result, {}) for sweep, result in pairs])
        store.end_run(run, "complete")
    return [sweep.key for sweep, _ in pairs]


def watch_run(repetitions: int) -> int:
    """Print how much longer a run takes while its screen is open, and return 1 if that is too much.

    The two kinds of runs alternate. The processor time of the UI beside that of the run depends less on other work of
    the machine.
    """
    pairs = np.array([[_time_run(watched) for watched in (False, True)] for _ in range(repetitions)])
    (alone, *_), (watched, computing, watching) = np.median(pairs, axis=0)
    cost, share = watched / alone - 1, watching / computing
    print(f"a run of {MANY} sweeps: {alone:.1f} s alone, {watched:.1f} s watched: {100 * cost:.1f} % more")
    print(f"processor: run {computing:.1f} s, watching it {watching:.1f} s: {100 * share:.1f} %")
    return int(min(cost, share) > WATCHING_BOUND)


def _time_run(watched: bool) -> tuple[float, float, float]:
    """Return the time of a run, its processor time, and that of the UI which watches it [s]."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "studies").mkdir()
        (folder / "studies" / "drawn.toml").write_text(DRAWN, encoding="utf-8")
        computing = _children_time()
        used = asyncio.run(_watch(folder)) if watched else _leave_alone(folder)
        with Store.open(str(folder / "results.db"), read_only=True) as store:
            run = store.runs()[0]
        assert run.ended
        return (run.ended - run.started).total_seconds(), _children_time() - computing, used


def _leave_alone(folder: Path) -> float:
    started = WorkspaceService.open(folder, None).launch("drawn", [])
    while not started.has_ended():
        time.sleep(0.2)
    return 0.0


async def _watch(folder: Path) -> float:
    """Return the processor time of the UI that shows the run [s]."""
    app = Painted(folder)
    async with app.run_test(size=SIZE) as pilot:
        while not (isinstance(studies := app.screen, StudiesPage) and studies.is_mounted):
            await pilot.pause(0.02)
        while not (
            studies.entries and len(studies.found) == len(studies.entries)
        ):  # the studies are surveyed at the start
            await pilot.pause(0.2)
        started = app.backend.workspace.launch("drawn", [])
        used, page = time.process_time(), RunPage(started)
        await app.push_screen(page)
        while page.live:  # what is drawn after the end takes nothing from the run
            await asyncio.sleep(0.1)
        used = time.process_time() - used
        while not started.has_ended():
            await asyncio.sleep(0.2)
        return used


def _children_time() -> float:
    return sum(os.times()[2:4])


async def time_keys(app: Painted, pilot: Pilot[None], name: str, keys: Sequence[str]) -> Row:
    """Return the times of keys, one after another; TimeoutError if one is followed by no paint."""
    walls, processor = [], []
    for key in keys:
        await pilot.pause()
        app.painted = (np.nan, np.nan)
        begin = np.array([time.perf_counter(), time.process_time()])
        await pilot.press(key)
        await _until(pilot, lambda: not np.isnan(app.painted[0]), 10.0)
        wall, used = app.painted - begin
        walls.append(wall)
        processor.append(used)
    return name, float(np.median(walls)), float(np.max(walls)), float(np.median(processor))


def store_responses(folder: Path, curves: int, points: int) -> list[str]:
    """Write responses of a resonance into a database, and return the keys of their sweeps."""
    frequency = np.geomspace(1.0, 500.0, points)
    pairs = []
    for index in range(curves):
        turning = frequency / (40.0 + 5 * index)
        value = 1e-3 / (1 - turning**2 + 0.04j * turning) * np.exp(-0.01j * frequency)
        labels = {"excitation.amplitude": 12.0 + index}
        excitation = {"name": "stepped_sine", "amplitude": 12.0 + index}
        sweep = Sweep({"source": "loop", "excitation": excitation}, {"name": "conventional"}, labels)
        pairs.append((sweep, Result(Outcome.OK, response=_response(frequency, value))))
    with Store.open(str(folder / "results.db"), create=True) as store:
        run = store.begin_run("many", "many.toml", "fraexp run many", {}, [sweep for sweep, _ in pairs])
        store.save(run, [(sweep, result, {}) for sweep, result in pairs])
        store.end_run(run, "complete")
    return [sweep.key for sweep, _ in pairs]


def _response(frequency: np.ndarray, value: np.ndarray) -> FrequencyResponse:
    count = len(frequency)
    noise = np.random.default_rng(1).normal(size=count) * 1e-2
    return FrequencyResponse(
        frequency=frequency,
        response=value * (1 + noise),
        covariance=np.eye(2) * (1e-2 * np.abs(value))[:, None, None] ** 2,
        unit="m/N",
        input="u",
        output="y",
        input_amplitude=np.ones(count),
        output_amplitude=np.abs(value),
        settled=np.ones(count, dtype=bool),
        settling_time=np.ones(count),
        residual=np.zeros(count),
        harmonics=np.full((count, 6), 0.01 + 0j),
    )


def _shows_picture(app: Painted) -> bool:
    return any(stack.picture is not None for stack in app.screen.query(PlotStack))


async def _until(pilot: Pilot[None], holds: Callable[[], bool], patience: float = 60.0) -> None:
    end = time.monotonic() + patience
    while not holds():
        if time.monotonic() > end:
            raise TimeoutError("the screen does not come")
        await pilot.pause(0.05)


if __name__ == "__main__":
    sys.exit(main())
