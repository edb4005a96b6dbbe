"""Measure the time from a key to the repaint of the terminal UI, and what watching a run costs it.

    python benchmarks/tui.py                    all parts
    python benchmarks/tui.py curves --reduced   four curves, with fewer keys

Each time is from the key until its last paint is ready to be written to the terminal, in this process; the bound is
for the median of a key's repetitions. Other work on the machine adds to it, unlike to the processor time: the bounds
are for an idle machine.
"""

import asyncio
import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from harness import Bench, run
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
CURVE_KEYS = {
    "cursor": ["right"],
    "hide or show": ["2"],
    "focus": ["right_square_bracket"],
    "zoom": ["x", "X"],
    "pan": ["L", "H"],
    "wrapped phase": ["W"],
}
DRAW_KEYS = {"cursor": ["right"], "hide or show": ["3"], "zoom": ["x", "X"], "other facet": ["g"]}
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


def curves(bench: Bench) -> None:
    """Keys in Compare with 4 curves of 5000 points [ms]."""
    with TemporaryDirectory() as folder:
        asyncio.run(_compare_curves(bench, Path(folder)))


async def _compare_curves(bench: Bench, folder: Path) -> None:
    keys = store_sweeps(folder, [_resonance(index) for index in range(4)])
    app = Painted(folder)
    async with app.run_test(size=SIZE) as pilot:
        await _begin(app, pilot)
        app.marks.add(keys)
        await pilot.press("c")
        await _until(pilot, lambda: _shows_picture(app))
        await time_keys(bench, app, pilot, CURVE_KEYS)


def draws(bench: Bench) -> None:
    """Compare opens 10,000 sweeps as bands, and keys there [ms]."""
    with TemporaryDirectory() as folder:
        asyncio.run(_compare_draws(bench, Path(folder)))


async def _compare_draws(bench: Bench, folder: Path) -> None:
    generator = bench.generator()
    keys = store_sweeps(folder, [_drawn_resonance(index, generator) for index in range(MANY)])
    app = Painted(folder)
    async with app.run_test(size=SIZE) as pilot:
        await _begin(app, pilot)
        app.backend.workspace.registry  # noqa: B018 - loaded in the background in a session
        app.marks.add(keys)
        await pilot.pause(1.0)  # the first screen is read and drawn
        begin = time.perf_counter()
        pressed = asyncio.create_task(pilot.press("c"))  # which ends when nothing is left to do
        while not _shows_picture(app):
            await asyncio.sleep(0.01)
        app.painted = (np.nan, np.nan)
        while np.isnan(app.painted[0]):
            await asyncio.sleep(0.01)
        bench.bounded(f"{MANY:,} sweeps: first picture", app.painted[0] - begin, OPENING_BOUND, "s")
        await pressed
        await _until(pilot, lambda: len(app.screen.compared.sweeps) == MANY)
        bench.row(f"{MANY:,} sweeps: all of them", f"{time.perf_counter() - begin:.2f} s")
        await pilot.pause(1.0)
        await time_keys(bench, app, pilot, DRAW_KEYS)


Stored = tuple[dict[str, Any], str, dict[str, Any], np.ndarray, np.ndarray]
"""Experiment, estimator, labels, frequencies [Hz] and response of a sweep."""


def _resonance(index: int) -> Stored:
    frequency, amplitude = np.geomspace(1.0, 500.0, 5000), 12.0 + index
    turning = frequency / (40.0 + 5 * index)
    value = 1e-3 / (1 - turning**2 + 0.04j * turning) * np.exp(-0.01j * frequency)
    excitation = {"name": "stepped_sine", "amplitude": amplitude}
    return {"excitation": excitation}, "conventional", {"excitation.amplitude": amplitude}, frequency, value


def _drawn_resonance(index: int, generator: np.random.Generator) -> Stored:
    case, amplitude = ("conventional", "effective_input")[index % 2], (6.0, 12.0, 25.0, 75.0)[index // 2 % 4]
    frequency, viscous = np.geomspace(1.0, 200.0, 30), 4.7 + generator.normal()
    turning = frequency / (40 * (1 + 0.03 * generator.normal()))
    labels = {"case": case, "excitation.amplitude": amplitude, "draw": index // 8 + 1}
    labels["friction.viscous_coefficient"] = viscous
    excitation = {"name": "stepped_sine", "amplitude": amplitude}
    experiment = {"excitation": excitation, "friction": {"name": "rolling", "viscous_coefficient": viscous}}
    value = 1e-3 / (1 - turning**2 + 0.1j * turning) / (1 + amplitude / 50)
    return experiment, case, labels, frequency, value


def store_sweeps(folder: Path, made: Sequence[Stored]) -> list[str]:
    """Write sweeps with responses into a database, and return their keys."""
    pairs = [
        (Sweep({"source": "loop", **experiment}, {"name": name}, labels), _result(frequency, value))
        for experiment, name, labels, frequency, value in made
    ]
    with Store.open(str(folder / "results.db"), create=True) as store:
        number = store.begin_run("many", "many.toml", "fraexp run many", {}, [sweep for sweep, _ in pairs])
        store.save(number, [(sweep, result, {}) for sweep, result in pairs])
        store.end_run(number, "complete")
    return [sweep.key for sweep, _ in pairs]


async def _begin(app: FraexpApp, pilot: Pilot[None]) -> None:
    while app.current_mode != "studies" or not app.screen.is_mounted:
        await pilot.pause(0.02)


def watching(bench: Bench) -> None:
    """How much longer a run of 10,000 sweeps takes while its screen is open; the two kinds of runs alternate."""
    pairs = np.array([[_time_run(watched) for watched in (False, True)] for _ in range(bench.options.pairs)])
    (alone, *_), (watched, computing, used) = np.median(pairs, axis=0)
    cost, share = watched / alone - 1, used / computing  # the processor time depends less on other work
    print(f"{alone:.1f} s alone, {watched:.1f} s watched; processor: run {computing:.1f} s, watching it {used:.1f} s")
    bench.bounded("watching, over the run", 100 * min(cost, share), 100 * WATCHING_BOUND, "%")


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
        while not (studies.entries and len(studies.found) == len(studies.entries)):  # they are surveyed at the start
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


async def time_keys(bench: Bench, app: Painted, pilot: Pilot[None], keys: dict[str, list[str]]) -> None:
    """Print the times of keys, one after another; TimeoutError if one is followed by no paint."""
    for name, turn in keys.items():
        times = []
        for key in turn * (5 if bench.reduced else 10):
            await pilot.pause()
            app.painted = (np.nan, np.nan)
            begin = np.array([time.perf_counter(), time.process_time()])
            await pilot.press(key)
            await _until(pilot, lambda: not np.isnan(app.painted[0]), 10.0)
            times.append(1e3 * (app.painted - begin))
        (wall, used), slowest = np.median(times, axis=0), np.max(times, axis=0)[0]
        text = f"{wall:6.0f} ms, slowest {slowest:.0f} ms, processor {used:.0f} ms"
        bench.row(name, text, wall <= 1e3 * BOUND, wall=float(wall))


def _result(frequency: np.ndarray, value: np.ndarray) -> Result:
    count = len(frequency)
    noise = np.random.default_rng(1).normal(size=count) * 1e-2
    response = FrequencyResponse(
        frequency=frequency, response=value * (1 + noise), unit="m/N", input="u", output="y",
        covariance=np.eye(2) * (1e-2 * np.abs(value))[:, None, None] ** 2,
        input_amplitude=np.ones(count), output_amplitude=np.abs(value), settled=np.ones(count, dtype=bool),
        settling_time=np.ones(count), residual=np.zeros(count), harmonics=np.full((count, 6), 0.01 + 0j),
    )  # fmt: skip
    return Result(Outcome.OK, response=response)


def _shows_picture(app: Painted) -> bool:
    return any(stack.picture is not None for stack in app.screen.query(PlotStack))


async def _until(pilot: Pilot[None], holds: Callable[[], bool], patience: float = 60.0) -> None:
    end = time.monotonic() + patience
    while not holds():
        if time.monotonic() > end:
            raise TimeoutError("the screen does not come")
        await pilot.pause(0.05)


if __name__ == "__main__":
    run(__doc__, curves, draws, watching, pairs=(3, 1))
