"""Measure the time to list 100,000 sweeps, filtered, sorted and counted, and the database's size.

    python benchmarks/store.py                           in a temporary SQLite file
    python benchmarks/store.py --database FILE or URL    in a database that is kept

Times are of the processor and of the clock; on a server that of the clock is bounded. Half of the sweeps are a grid of
amplitudes, friction forces, seeds and estimators with a list of 100 frequencies; the other half are drawn machines, no
two alike.
"""

import tempfile
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from harness import Bench, in_turns, run
from sqlalchemy import bindparam, insert, update

from fraexp.components.registry import discover
from fraexp.data.results import FrequencyResponse, Metric
from fraexp.data.sweep import Sweep
from fraexp.store import Store, codec
from fraexp.store.shared_sections import add_field_names
from fraexp.store.tables import RESPONSE_ARRAYS, frequency_response, metric, run_sweep, sweep
from fraexp.tui.plotting.compared_sweeps import read_marked_sweeps
from fraexp.views.comparison import difference_rows
from tests.store.resealing import seal_sweeps

SWEEPS = 100_000
RUNS = 20
FREQUENCIES = [float(value) for value in np.geomspace(1.0, 200.0, 100)]
FREQUENCIES_OF_A_STUDY, MOST_SIZE = 40, 1.5
"""From so many frequencies on, a sweep takes no more than so many times the room of its arrays."""
BOUND, FIRST_BOUND = 0.2, 0.1
"""Seconds of computing that a page may take, and the first one."""
ESTIMATORS: tuple[dict[str, Any], ...] = (
    {"name": "conventional", "refer_to_plant": True},
    {"name": "effective_input", "force_scale": 1.0, "displacement_scale": 1.0, "method": None, "deviations": []},
)
CHANNELS = {
    "version": 1,
    "input": "u",
    "output": "y",
    "input_dead_time": 1e-3,
    "input_time_constants": [],
    "relative_degree": 2,
}
QUESTIONS: dict[str, Callable[[Store], Any]] = {
    "first page": lambda store: store.page(),
    "last page": lambda store: store.page(offset=SWEEPS - 100),
    "sorted by estimator, deep": lambda store: store.page(order="estimator", offset=SWEEPS // 2),
    "sorted by elapsed": lambda store: store.page(order="-elapsed"),
    "sorted by state": lambda store: store.page(order="state"),
    "sorted by amplitude": lambda store: store.page(order="-excitation.amplitude"),
    "sorted by a drawn parameter": lambda store: store.page(order="plant.rigid_body_gain"),
    "sorted by a metric": lambda store: store.page(order="-metric.peak force"),
    "estimator=effective_input": lambda store: store.page("estimator=effective_input"),
    "estimator=effective_input excitation.amplitude>=12": lambda store: store.page(
        "estimator=effective_input excitation.amplitude>=12"
    ),
    "the issue's, tag and state": lambda store: store.page(
        "estimator=effective_input excitation.amplitude>=12 state:unusable tag:baseline"
    ),
    "-state:unusable": lambda store: store.page("-state:unusable"),
    "plant.rigid_body_gain>0.13 (drawn)": lambda store: store.page("plant.rigid_body_gain>0.13"),
    "plant.rigid_body_gain>0.13, sorted by it": lambda store: store.page(
        "plant.rigid_body_gain>0.13", "plant.rigid_body_gain"
    ),
    'metric."peak force">14': lambda store: store.page('metric."peak force">14'),
    "loop.resolution<=1um": lambda store: store.page("loop.resolution<=1um"),
    "a word": lambda store: store.page("effective_input"),
    "a word that nothing has": lambda store: store.page("nowhere"),
    "show a sweep": lambda store: store.results([store.find(store.page(limit=1).rows[0].key[4:12]).key]),
    "compare four sweeps": lambda store: differing(store, [row.key for row in store.page(limit=4).rows]),
    "a run of 5000": lambda store: store.page(run=3),
    "a run, filtered and sorted": lambda store: store.page("estimator=effective_input", "-elapsed", run=3),
    "study:drawn": lambda store: store.page("study:drawn"),
    "all keys that match": lambda store: store.keys("estimator=effective_input"),
    "fields": lambda store: store.fields(),
    "version": lambda store: store.version(),
}


def queries(bench: Bench) -> None:
    """Processor time and time by the clock [ms], and what matches."""
    with tempfile.TemporaryDirectory() as folder:
        database = bench.options.database or str(Path(folder) / "results.db")
        served = "://" in database
        if not (Store.exists(database) if served else Path(database).exists()):
            make(database)
        if not served:
            print(f"{Path(database).stat().st_size / SWEEPS / 1024:.2f} KiB a sweep")
        with Store.open(database, read_only=True) as store:
            for name, ask in QUESTIONS.items():
                used, waited = (
                    float(np.median(in_turns(lambda ask=ask: ask(store), turns=5, clock=clock)))
                    for clock in (time.process_time, time.perf_counter)
                )
                bound = FIRST_BOUND if name == "first page" else BOUND
                answer = ask(store)
                total = answer.total if hasattr(answer, "total") else ""
                is_met = (waited if served else used) <= bound
                bench.row(name, f"{1e3 * used:7.1f} ms {1e3 * waited:7.1f} ms {total:>8}", is_met, seconds=used)


def size(bench: Bench) -> None:
    """What sweeps of so many frequencies take, over the size of their arrays."""
    for points in (2, 30, 40, 100):
        with tempfile.TemporaryDirectory() as folder:
            file, grid = Path(folder) / "size.db", [*crossed(1000), *drawn(1000)]
            with Store.open(str(file), create=True) as store:
                write_results(store, store.begin_run("size", "size.toml", "fraexp run", {}, grid), grid, points)
            each = file.stat().st_size / len(grid)
        stored = {name: of for name, of in RESPONSE_ARRAYS.items() if not of.is_optional}
        data = {name: np.asarray(getattr(response(points), name), of.dtype) for name, of in stored.items()}
        ratio = each / sum(array.nbytes for array in data.values())
        is_met = points < FREQUENCIES_OF_A_STUDY or ratio <= MOST_SIZE
        bench.row(f"{points} frequencies", f"{each / 1024:5.2f} KiB a sweep, {ratio:.2f} times its arrays", is_met)


def differing(store: Store, keys: list[str]) -> list[list[str]]:
    """Return in what sweeps differ, as the terminal UI and ``fraexp compare`` show it."""
    found = read_marked_sweeps(store, keys)
    return difference_rows([[of] for of in found.sweeps], found.results, discover())


def make(database: str) -> None:
    """Write the database: sweeps and runs as a run writes them, small results at once."""
    grid = [*crossed(SWEEPS // 2), *drawn(SWEEPS // 2)]
    size = len(grid) // RUNS
    with Store.open(database, create=True) as store:
        for number in range(RUNS):
            study = "grid/amplitudes" if number < RUNS // 2 else "robustness/drawn"
            part = grid[number * size : (number + 1) * size]
            run = store.begin_run(study, f"studies/{study}.toml", "fraexp run", {"fraexp": "0.1.0"}, part)
            write_results(store, run, part)
            store.end_run(run, "complete")
        store.tag([item.key for item in grid[::51]], "baseline")


def crossed(count: int) -> Iterator[Sweep]:
    """Yield a grid of 50 amplitudes, 10 friction forces, seeds, and two estimators."""
    for index in range(count):
        which, rest = index % 2, index // 2
        amplitude, force, seed = 2.0 + rest % 50, 15.0 + rest // 50 % 10, rest // 500
        labels = {"excitation.amplitude": amplitude, "friction.curve.coulomb_force": force, "loop.seed": seed}
        estimator = {"name": ESTIMATORS[which]["name"]}
        yield Sweep(
            experiment(amplitude, force, seed, 0.132), ESTIMATORS[which] | CHANNELS, {**labels, "estimator": estimator}
        )


def drawn(count: int) -> Iterator[Sweep]:
    """Yield machines of which each has a plant, a friction force and noise of its own."""
    random = np.random.default_rng(1)
    for index in range(count):
        gain, force = float(random.normal(0.132, 0.003)), float(random.normal(17.9, 1.0))
        labels = {"draw": index, "plant.rigid_body_gain": gain, "friction.curve.coulomb_force": force}
        yield Sweep(experiment(12.0, force, index, gain), ESTIMATORS[index % 2] | CHANNELS, labels)


def experiment(amplitude: float, force: float, seed: int, gain: float) -> dict[str, Any]:
    """Return a loop as studies resolve it."""
    curve = {
        "shape": "exponential",
        "coulomb_force": force,
        "characteristic_displacement": 4.536e-05,
        "elements": 20,
        "displacements": [],
    }
    dead = {"input_dead_time": 0.001, "input_time_constants": [], "output_dead_time": 0.0, "output_time_constants": []}
    return {
        "source": "loop",
        "plant": {
            "name": "modal",
            "version": 1,
            "rigid_body_gain": gain,
            "frequencies": [38.8, 80.0],
            "damping_ratios": [0.04634, 0.02],
            "modal_gain_ratios": [0.342, 0.3],
            "viscous_coefficient": 0.0,
        },
        "friction": {"name": "rolling", "version": 1, "curve": curve, "stiffness": [], "viscous_coefficient": 4.69},
        "controller": {"name": "pid", "version": 1, "proportional": 6052.93, "derivative_time": 0.0566204},
        "loop": {"sample_time": 0.0005, **dead, "reference": 0.0, "resolution": 1e-07, "noise": 3e-8, "seed": seed},
        "excitation": {
            "name": "stepped_sine",
            "version": 1,
            "settling_tolerance": 1e-05,
            "settling_timeout": 30.0,
            "frequencies": FREQUENCIES,
            "amplitude": amplitude,
        },
        "numerics": {"tolerance": 0.0001, "steps_per_sample": 0},
    }


def response(points: int) -> FrequencyResponse:
    """Return a response with all arrays that every response has."""
    ones = np.ones(points)
    arrays = {"covariance": np.ones((points, 2, 2)), "settled": ones > 0, "harmonics": np.zeros((points, 6), complex)}
    names = ("frequency", "response", "input_amplitude", "output_amplitude", "settling_time", "residual")
    return FrequencyResponse(**dict.fromkeys(names, ones), **arrays, unit="m/N", input="u", output="y")  # type: ignore[arg-type]


def write_results(store: Store, run: int, part: list[Sweep], points: int = 2) -> None:
    """Write a result of some frequencies for each sweep; one in 41 failed, one in 20 did not settle."""
    template = codec.response_rows("", response(points))[0]
    random = np.random.default_rng(run)
    now = datetime.now(UTC) - timedelta(days=RUNS - run)
    outcomes, metrics = [], []
    for index, item in enumerate(part):
        outcome = "NOT_SETTLED" if index % 20 == 3 else "OK"
        created = now + timedelta(milliseconds=20 * index)
        outcomes.append({"of": item.key, "outcome": outcome, "elapsed": random.gamma(2.0), "created": created})
        values = (Metric("stroke", random.gamma(2.0), "m"), Metric("peak force", random.normal(14, 2), "N"))
        metrics += codec.metric_rows(item.key, (*values, Metric("measuring time", 38.6, "s")))
    with store._writing() as connection:
        connection.execute(update(sweep).where(sweep.c.key == bindparam("of")), outcomes)
        connection.execute(insert(metric), metrics)
        connection.execute(insert(frequency_response), [template | {"key": item.key} for item in part])
        add_field_names(connection, "metric", {row["name"] for row in metrics})
        for state, which in (("computed", part), ("failed", part[::41])):
            rows = [{"of": item.key} for item in which]
            chosen = update(run_sweep).where(run_sweep.c.run == run, run_sweep.c.key == bindparam("of"))
            connection.execute(chosen.values(state=state), rows)
        seal_sweeps(connection, [item.key for item in part])


if __name__ == "__main__":
    run(__doc__, size, queries, database="")
