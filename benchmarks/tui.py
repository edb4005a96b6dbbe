"""How long the terminal UI takes from a key to its repaint.

python benchmarks/tui.py prints a table and fails where a bound is missed. Each time is from the key until nothing is
left to be done, the screen painted, in this process. Other work on the machine only adds to it: the bound is for the
fastest of a key's repetitions, and a key that does nothing tells how busy the machine is.
"""

import asyncio
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from textual.pilot import Pilot

from fraexp.results import FrequencyResponse, Outcome, Result
from fraexp.store import Store
from fraexp.sweep import Sweep
from fraexp.tui.app import FraexpApp

BOUND = 0.100
"""Most time [s] from key to repaint."""
SIZE = (200, 50)
Row = tuple[str, float, float, float]
"""What was measured, fastest and median wall time, and median processor time [s]."""


def main() -> int:
    """Measure all, and return 1 if a bound is missed."""
    with TemporaryDirectory() as folder:
        rows = asyncio.run(compare_keys(Path(folder)))
    print(f"{'key to repaint [ms]':50} {'fastest':>8} {'median':>8} {'processor':>10}")
    for name, fastest, median, processor in rows:
        print(f"{name:50} {1e3 * fastest:8.0f} {1e3 * median:8.0f} {1e3 * processor:10.0f}")
    missed = [name for name, fastest, *_ in rows if fastest > BOUND]
    if missed:
        print(f"more than {1e3 * BOUND:.0f} ms: {', '.join(missed)}", file=sys.stderr)
    return int(bool(missed))


async def compare_keys(folder: Path, curves: int = 4, points: int = 5000) -> list[Row]:
    """Return times of keys in Compare with many points."""
    keys = store_responses(folder, curves, points)
    app = FraexpApp(folder)
    async with app.run_test(size=SIZE) as pilot:
        app.marks.add(keys)
        await pilot.press("c")
        await _until(pilot, lambda: getattr(getattr(app.screen, "stack", None), "picture", None) is not None)
        what = f"Compare, {curves} curves of {points} points:"
        return [
            await time_keys(pilot, f"{what} nothing", ["f12"] * 20),
            await time_keys(pilot, f"{what} cursor", ["right"] * 20),
            await time_keys(pilot, f"{what} hide or show", ["2"] * 10),
            await time_keys(pilot, f"{what} focus", ["right_square_bracket"] * 12),
            await time_keys(pilot, f"{what} zoom", ["x", "X"] * 8),
            await time_keys(pilot, f"{what} pan", ["L", "H"] * 8),
            await time_keys(pilot, f"{what} wrapped phase", ["W"] * 10),
        ]


async def time_keys(pilot: Pilot[None], name: str, keys: Sequence[str]) -> Row:
    """Return the times of keys, one after another."""
    walls, processor = [], []
    for key in keys:
        await pilot.pause()
        begin, used = time.perf_counter(), time.process_time()
        await pilot.press(key)
        await pilot.pause()
        walls.append(time.perf_counter() - begin)
        processor.append(time.process_time() - used)
    return name, min(walls), float(np.median(walls)), float(np.median(processor))


def store_responses(folder: Path, curves: int, points: int) -> list[str]:
    """Write responses of a resonance into a database, and return the keys of their sweeps."""
    frequency = np.geomspace(1.0, 500.0, points)
    pairs = []
    for index in range(curves):
        turning = frequency / (40.0 + 5 * index)
        value = 1e-3 / (1 - turning**2 + 0.04j * turning) * np.exp(-0.01j * frequency)
        labels = {"excitation.amplitude": 12.0 + index}
        sweep = Sweep({"source": "loop", "excitation": {"name": "x", "amplitude": 12.0 + index}}, {"name": "y"}, labels)
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


async def _until(pilot: Pilot[None], holds: Callable[[], bool], patience: float = 60.0) -> None:
    end = time.monotonic() + patience
    while not holds():
        if time.monotonic() > end:
            raise TimeoutError("the screen does not come")
        await pilot.pause(0.05)


if __name__ == "__main__":
    sys.exit(main())
