"""Compare planned with measured times of twenty different studies.

    python benchmarks/estimates.py               first on a new machine, then on one that has measured
    python benchmarks/estimates.py --compiled    without compilation: all kernels are cached
    python benchmarks/estimates.py --processor   processor time in one process, where other programs share the machine
    python benchmarks/estimates.py quick record  these studies alone

Each study runs in a fresh process and a fresh workspace. Cold, its cache folder is empty, too, so that its laws are
compiled and nothing is known about the machine. Learned, all studies have run before with one cache folder. Measured
is the time from the plan to the end of the run with its figure; of the largest study, two samples are run, and the
time of the whole follows on a straight line. The exit code is 1 if fewer than nine of ten are within a factor of 2.
"""

import argparse
import json
import os
import random
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

FACTOR, SHARE = 2.0, 0.9
"""Permitted factor between estimate and measurement, and the fraction of studies that must keep to it."""
MACHINE = 'machine = "linear_motor_table"\n'
GUIDE = "stiffness = 3.9e5, coulomb_force = 17.9"
SAMPLES = (4, 12)
"""Sweeps of the samples of a study that would run for long."""
FROM_TREE = (
    "quick", "paper/fig12", "methods/amplitude_map", "methods/comparison", "methods/response_controlled",
    "methods/feedback_compensated", "methods/chirp", "methods/excitations", "methods/best_linear",
    "friction/observers", "friction/drift", "identification/friction_laws", "identification/friction_triangle",
    "identification/autonomous_multisine", "record", "positioning/robustness",
)  # fmt: skip
LARGE = (
    MACHINE
    + f"""
[excitation]
name = "stepped_sine"
points = 400
recorded_periods = 20
[estimator]
name = "effective_input"
[grid]
"excitation.amplitude" = {[10 + 0.2 * number for number in range(400)]}
"""
)
SLOW = (
    MACHINE
    + f"""
[excitation]
name = "stepped_sine"
min_frequency = 0.1
max_frequency = 20.0
points = 40
settling_timeout = 100.0
settling_tolerance = 1e-7
[estimator]
name = "conventional"
[grid]
"friction" = [{{ name = "dahl", {GUIDE} }}, {{ name = "elastoplastic", preset = "linear_motor_table" }}]
"excitation.amplitude" = [30, 60]
"""
)
ESTIMATORS = (
    MACHINE
    + f"""
[loop]
noise = 30e-9
[excitation]
name = "stepped_sine"
points = 300
recorded_periods = 5
[estimator]
name = "effective_input"
[grid]
"excitation.amplitude" = [12, 75]
"estimator.force_scale" = {[0.8 + 0.02 * number for number in range(20)]}
"""
)
DRAWN = (
    MACHINE
    + """
[excitation]
name = "multisine"
rms = 12.0
realisations = 8
recorded_periods = 4
settling_tolerance = 1e-2
[grid]
estimator = [{ name = "best_linear_approximation" }, { name = "h1_h2_hv" }]
[monte_carlo]
count = 150
draw = [
    { paths = "plant.rigid_body_gain", relative = 0.01 },
    { paths = "friction.curve.coulomb_force", relative = 0.05 },
]
"""
)
GENERATED = {"large": LARGE, "slow": SLOW, "estimators": ESTIMATORS, "drawn": DRAWN}
NAMES = (*FROM_TREE, *GENERATED)
SAMPLED = ("large",)


@dataclass(frozen=True)
class Compared:
    """An estimate beside the time that the run took."""

    name: str
    expected: float
    compiling: float
    measured: float
    executor: str

    @property
    def ratio(self) -> float:
        """Expected over measured time."""
        return self.expected / self.measured

    @property
    def holds(self) -> bool:
        """Whether the estimate is within the factor."""
        return 1 / FACTOR <= self.ratio <= FACTOR


def child(name: str, folder: str, count: int, executor: str, compiled: bool) -> None:
    """Run a study, or so many of its sweeps, and print estimate and time; this is a process of its own."""
    from fraexp.execution.estimates import estimate
    from fraexp.execution.events import Ended, Planned
    from fraexp.workspace.workspace_service import WorkspaceService

    workspace = WorkspaceService.open(folder)
    if executor == "serial":  # processor time is that of an idle machine
        estimate.slowdown = lambda processes: 1.0
    if compiled:
        _know_kernels(workspace.studies([name])[0].sweeps, workspace)
    whole = workspace.plan(name, executor=executor or None)[1][0]
    if count:
        _sample(name, Path(folder), count)
    for event in workspace.run([name], executor or None):
        if isinstance(event, Planned):
            began, computed, planned = time.perf_counter(), processor_time(), event
        if isinstance(event, Ended):
            took = processor_time() - computed if executor == "serial" else time.perf_counter() - began
    found = whole if count else planned
    numbers = {"expected": found.seconds, "compiling": found.compiling, "measured": took, "executor": found.executor}
    print(json.dumps(numbers))


def _know_kernels(sweeps, workspace) -> None:  # type: ignore[no-untyped-def]
    """Let the machine know that all kernels of these sweeps are compiled."""
    from fraexp.execution.estimates.estimate import count_workload
    from fraexp.execution.estimates.speeds import save_ratios

    save_ratios({}, count_workload(sweeps, workspace.registry).kernels)


def processor_time() -> float:
    """Return the processor time of this process and of those that it has started [s]."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(of.ru_utime + of.ru_stime for of in used)


def _sample(name: str, folder: Path, count: int) -> None:
    """Have a study of the folder run at some of its amplitudes, drawn at random."""
    file = folder / "studies" / f"{name}.toml"
    lines = file.read_text().splitlines()
    at = next(number for number, line in enumerate(lines) if line.startswith('"excitation.amplitude"'))
    amplitudes = json.loads(lines[at].partition("=")[2])
    lines[at] = f'"excitation.amplitude" = {sorted(random.Random(0).sample(amplitudes, count))}'
    file.write_text("\n".join(lines))


def compare(name: str, cache: Path, compiled: bool, processor: bool) -> Compared:
    """Run a study in a fresh process and workspace."""
    found = [_child(name, cache, count, compiled, processor) for count in (SAMPLES if name in SAMPLED else (0,))]
    one = {key: found[0][key] for key in ("expected", "compiling", "measured", "executor")}
    if name in SAMPLED:
        few, many = SAMPLES
        slope = (found[1]["measured"] - found[0]["measured"]) / (many - few)
        one["measured"] = found[0]["measured"] + slope * (400 - few)
    return Compared(name, **one)


def _child(name: str, cache: Path, count: int, compiled: bool, processor: bool) -> dict[str, float]:
    environment = os.environ | {"FRAEXP_CACHE_DIR": str(cache)}
    if not compiled:
        environment["NUMBA_CACHE_DIR"] = str(cache / "compiler")
    with tempfile.TemporaryDirectory() as folder:
        studies = Path(folder) / "studies"
        studies.mkdir()
        if name in GENERATED:
            (studies / f"{name}.toml").write_text(GENERATED[name])
        arguments = ["--child", name, folder, str(count), "serial" if processor else "", "compiled" if compiled else ""]
        done = subprocess.run(
            [sys.executable, __file__, *arguments], env=environment, stdout=subprocess.PIPE, text=True, check=True
        )
    return json.loads(done.stdout.splitlines()[-1])


def studies(names: Sequence[str], folder: Path, options: argparse.Namespace) -> Iterator[tuple[str, Compared]]:
    """Yield each study with what the machine knows: nothing, then what all of them have taught."""
    for name in names if options.machine != "learned" else ():
        yield "cold", compare(name, Path(tempfile.mkdtemp(dir=folder)), options.compiled, options.processor)
    if options.machine == "cold":
        return
    shared = folder / "shared"
    for name in names:
        _child(name, shared, SAMPLES[0] if name in SAMPLED else 0, options.compiled, options.processor)
    for name in names:
        yield "learned", compare(name, shared, options.compiled, options.processor)


def main() -> int:
    """Print all estimates beside what was measured; return 1 if too few hold."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("names", nargs="*", help="studies, all by default", default=NAMES)
    options.add_argument("--compiled", action="store_true", help="leave out compiling")
    options.add_argument("--processor", action="store_true", help="processor time of one process")
    options.add_argument("--machine", choices=["cold", "learned"], help="one of the two alone")
    given = options.parse_args()
    print(
        f"{'study':<38s} {'machine':<8s} {'executor':<10s} {'expected':>9s} {'compiling':>9s} {'measured':>9s}  ratio"
    )
    held: dict[str, list[bool]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for machine, one in studies(given.names, Path(folder), given):
            held.setdefault(machine, []).append(one.holds)
            numbers = f"{one.expected:7.1f} s {one.compiling:7.1f} s {one.measured:7.1f} s  {one.ratio:5.2f}"
            print(
                f"{one.name:<38s} {machine:<8s} {one.executor:<10s} {numbers}{'' if one.holds else '  MISSED'}",
                flush=True,
            )
    for machine, found in held.items():
        print(f"{machine}: {sum(found)} of {len(found)} within a factor of {FACTOR:g} ({SHARE:.0%} at least)")
    return int(any(sum(found) < SHARE * len(found) for found in held.values()))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        child(sys.argv[2], sys.argv[3], int(sys.argv[4]), sys.argv[5], bool(sys.argv[6]))
        sys.exit()
    sys.exit(main())
