"""Measure the everyday times of docs/performance.md, and the overhead of a sweep.

    python benchmarks/timing.py                     all parts
    python benchmarks/timing.py sweeps start-up     these
    python benchmarks/timing.py --reduced           fewer runs, laws and sweeps
    python benchmarks/timing.py --against COMMIT    processor time of sweeps, over that with the fraexp of a commit

sweeps     A warm sweep of 100 frequencies, 1 to 200 Hz, with its estimates
start-up   What a user waits for in a shell: fresh processes; also as a share of the imports that they cannot do without
laws       Processor time to compile friction laws, each in a fresh process: in an empty cache, each further law
overhead   Tiny sweeps, without friction and with an estimator that does nothing: claiming, sending, answering, storing
           and reporting, less the bare computation in this process

The machine should have nothing else to do.
"""

import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from harness import ROOT, Action, Bench, in_turns, run
from paper_machine import PAPER, PATH, REGISTRY, decibel, loop_job, response_of, results

sys.path.insert(0, str(ROOT))
from fraexp.execution.events import Finished
from fraexp.execution.job import Job, run_job
from fraexp.simulation.machine import reference_response
from fraexp.workspace.workspace_service import WorkspaceService

FRAEXP = ["-m", "fraexp"]
FIRST_RESULT = """
from fraexp.execution.events import Finished
from fraexp.workspace.workspace_service import WorkspaceService

events = WorkspaceService.open(".").run(["quick"], "serial", rerun="all")
next(event for event in events if isinstance(event, Finished))
events.close()
"""
IMPORTS = ["-c", "import numpy, sqlalchemy, pydantic"]
COMMANDS: dict[str, tuple[list[str], float, float]] = {
    "python alone": (["-c", ""], np.inf, np.inf),
    "importing numpy, sqlalchemy, pydantic": (IMPORTS, np.inf, np.inf),
    "import fraexp.api": (["-c", "import fraexp.api"], np.inf, np.inf),
    "fraexp --help": ([*FRAEXP, "--help"], 0.3, np.inf),
    "fraexp plugins": ([*FRAEXP, "plugins"], np.inf, np.inf),
    "fraexp list": ([*FRAEXP, "list"], np.inf, 1.3),
    "first result of study quick, laws compiled before": (["-c", FIRST_RESULT], 1.5, np.inf),
    "study paper/fig12, reused": ([*FRAEXP, "run", "paper/fig12"], 1.0, 2.0),
}
"""Commands, the bound of their time [s], and that of its ratio to the time of `IMPORTS`."""
FIRST_S, FURTHER_S, ALL_S = 10.0, 5.0, 60.0
"""Bounds: first law in an empty cache, each further one, all built-in laws together [s]."""
OTHERS = {"none": {}, "composite": {"preset": "dahl_and_viscous"}}
"""Built-in laws that benchmarks/accuracy.py does not compare."""
TRIVIAL = '''
from fraexp.api import Estimator, Metric, Outcome, Result


class Trivial(Estimator, name="trivial", version=1):
    """Does next to nothing."""

    def estimate(self, signals):
        """Return one metric."""
        return Result(Outcome.OK, metrics=(Metric("peak", float(signals.segments[0].channels["friction"][0, 0]), "N"),))
'''
TINY = """
[loop]
sample_time = 1e-3
[friction]
name = "none"
[estimator]
name = "trivial"
[excitation]
name = "displacement_sine"
frequency = 10.0
[grid]
"excitation.amplitude" = {values}
"""
MAX_OVERHEAD_MS = {"serial": np.inf, "processes": 2.0, "dask": 5.0}


def sweep_job(amplitude: float = 12.0, points: int = 100, is_quick: bool = False) -> Job:
    """Return FRA of the paper's machine from 1 to 200 Hz.

    Either the proposed method as studies have it by default, or both methods, settled to 1e-4, on an ideal scale with
    the numerics that 0.01 dB need.
    """
    excitation = {"name": "stepped_sine", "amplitude": amplitude, "points": points}
    proposed = {"name": "effective_input", "friction": PAPER["friction"], **PATH}
    if not is_quick:
        return loop_job(PAPER, excitation, proposed)
    ideal = {**PAPER, "loop": {**PAPER["loop"], "resolution": 0.0}, "numerics": {"tolerance": 1e-3}}
    excitation["settling_tolerance"] = 1e-4
    return loop_job(ideal, excitation, {"name": "conventional"}, {**proposed, "oversampling": 2})


def performed(*jobs: Job) -> Action:
    """Return an action that performs jobs one after another."""
    return lambda: [response_of(result) for job in jobs for result in results(job)]


WORKS: dict[str, Callable[[], Action]] = {
    "sweep of 100 frequencies, both methods": lambda: performed(sweep_job(is_quick=True)),
    "sweep of 100 frequencies, proposed method": lambda: performed(sweep_job()),
    "sweep of 30 frequencies, proposed method": lambda: performed(sweep_job(points=30)),
}


def sweeps(bench: Bench) -> None:
    """Medians."""
    jobs = {f"100 frequencies, {force:g} N": (sweep_job(force), 0.5) for force in (12.0, 75.0)}
    quick = sweep_job(is_quick=True)
    response = response_of(results(quick)[-1])
    truth = reference_response(quick.experiment, response.frequency, REGISTRY)
    error = float(np.max(np.abs(decibel(response.response / truth))))
    jobs[f"the same at 12 N, both methods, to {error:.3f} dB"] = quick, 0.02
    times = np.median(in_turns(*(performed(job) for job, _ in jobs.values()), turns=3 * bench.options.runs), axis=1)
    for (name, (_, bound)), taken in zip(jobs.items(), times, strict=True):
        bench.bounded(name, float(taken), bound, "s")


def start_up(bench: Bench) -> None:
    """Medians, and ratios to the imports, which take turns with them."""
    with tempfile.TemporaryDirectory() as folder:
        actions = [in_process(folder, *words) for words, *_ in COMMANDS.values()]
        times = np.median(in_turns(*actions, turns=bench.options.runs), axis=1)
    imports = times[list(COMMANDS).index("importing numpy, sqlalchemy, pydantic")]
    for (name, (_, bound, ratio_bound)), taken in zip(COMMANDS.items(), times, strict=True):
        bench.bounded(name, float(taken), bound, "s")
        if np.isfinite(ratio_bound):
            bench.bounded(f"{name}, over importing numpy, sqlalchemy, pydantic", float(taken / imports), ratio_bound)


def in_process(folder: str, *arguments: str) -> Action:
    """Return an action that runs Python with these arguments in a folder, in a fresh process."""
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return lambda: subprocess.run([sys.executable, *arguments], cwd=folder, check=True, capture_output=True, env=kept)


def use_laws(names: list[str]) -> None:
    """Use each law in the loop and in the observer for the first time in this process; print the processor time."""
    from accuracy import MODELS
    from kernel import machine, model, rolling, sweep
    from paper_machine import simulated

    from fraexp.components.kinds import Motion

    report = {"imports": time.process_time()}
    for name in names:
        began = time.process_time()
        friction = rolling(20) if name == "rolling" else model({"name": name, **{**MODELS, **OTHERS}[name]})
        signals = simulated(machine(friction, 0), sweep(4, min_frequency=20.0))
        displacement = signals.segments[0].channels["displacement"][0]
        friction.forces([Motion(displacement, 5e-4, periodic=True)] * 2)
        report[name] = time.process_time() - began
    print(json.dumps(report))


def laws(bench: Bench) -> None:
    """First use of each law in a process of its own, all with one cache."""
    from accuracy import MODELS

    names, total = ["rolling", "gms", "lugre"] if bench.reduced else [*MODELS, *OTHERS], 0.0
    with tempfile.TemporaryDirectory() as folder:
        for number, name in enumerate(names):
            command = [sys.executable, __file__, "--use-laws", name]
            environment = {**os.environ, "FRAEXP_CACHE_DIR": str(Path(folder) / "cache")}
            done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
            report: dict[str, float] = json.loads(done.stdout)
            taken = report[name] + (0.0 if number else report["imports"])
            total += taken
            what = f"{name}: further law" if number else f"{name}: first use in an empty cache, with imports"
            bench.bounded(what, taken, FURTHER_S if number else FIRST_S, "s")
    bench.bounded(f"{len(names)} laws together", total, ALL_S, "s")


def overhead(bench: Bench) -> None:
    """What a tiny sweep costs beside computing it [ms], or the processor time of the scheduler's process of it."""
    values = [round((n + 1) * 1e-6, 9) for n in range(bench.options.tiny)]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for part, file, text in (("studies", "tiny.toml", TINY.format(values=values)), ("plugins", "own.py", TRIVIAL)):
            (folder / part).mkdir()
            (folder / part / file).write_text(text, encoding="utf-8")
        tiny = WorkspaceService.open(folder).studies(["tiny"])[0].sweeps[:500]
        jobs = [Job(sweep.experiment, (sweep.estimator,), sweep.files, str(folder / "plugins")) for sweep in tiny]
        bare = float(in_turns(lambda: [run_job(job, lambda _: None) for job in jobs], turns=1)[0, 0]) / len(jobs)
        _overhead(bench, folder, "serial", bare)
        _overhead(bench, folder, "processes:2", bare)
        if importlib.util.find_spec("distributed"):
            from tests.dask_cluster import Cluster

            with Cluster(folder) as cluster:
                cluster.start_worker("one")
                cluster.start_worker("two")
                _overhead(bench, folder, f"dask:{cluster.address}", bare)
        else:
            print("(Dask is not installed: left out)")


def _overhead(bench: Bench, folder: Path, executor: str, bare: float) -> None:
    name, moments = executor.partition(":")[0], []
    for event in WorkspaceService.open(folder, str(folder / f"{name}.db")).run(["tiny"], executor):
        if isinstance(event, Finished):
            if event.state != "computed":
                raise SystemExit(f"{event.state}: {event.error}")
            moments.append((time.perf_counter(), time.process_time()))
    late = np.array(moments[len(moments) // 5 :])  # workers are up by then
    wall, used = (late[-1] - late[0]) / (len(late) - 1)
    cost, busy = 1e3 * (wall - bare), 1e3 * (used - (bare if name == "serial" else 0.0))
    print(f"{name}: {1e3 * wall:.2f} ms each, {1e3 * bare:.2f} ms bare; the scheduler's process is busy {busy:.2f} ms")
    bench.bounded(f"overhead of a tiny sweep, {name}", min(cost, busy), MAX_OVERHEAD_MS[name], "ms")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--use-laws"]:
        use_laws(sys.argv[2:])
    else:
        run(__doc__, sweeps, start_up, laws, overhead, works=WORKS, runs=(7, 3), tiny=(5000, 500))
