"""Measure machines drawn at random behind their sockets, of which the program knows sample time and limits alone.

    python benchmarks/autonomous_measurement.py                        20 machines
    python benchmarks/autonomous_measurement.py --machines 5           5
    python benchmarks/autonomous_measurement.py --seed 7 --only 3 7    some of those of a seed

Mass, one or two modes of either sign, law, number of elements, dead time, encoder noise and controller are drawn. A
machine counts as right if k0 is within 1 %, the first mode within 0.2 Hz and the Coulomb force within 3 %. A row misses
if the verdict is ok where one of them is not.
"""

import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from drawn_machines import drawn_machine
from harness import Bench, run
from paper_machine import REGISTRY, metrics_of

from fraexp.components.kinds import FrictionModel
from fraexp.components.registry import create
from fraexp.data.results import Result
from fraexp.errors import FraexpError
from fraexp.measurement.measured_study import without_versions
from fraexp.records.study_writer import write_study
from fraexp.workspace.autonomous_service import AutonomousService
from fraexp.workspace.workspace_service import WorkspaceService

LAWS = ("rolling", "dahl", "lugre", "rolling, D_i", "elastoplastic", "gms", "rolling")
SAMPLE_TIMES = (2.5e-4, 1e-3)
"""Range of sample times [s]: shorter ones take longer to simulate."""
NOISE = (1e-8, 3e-7)
"""Range of the encoder's noise [m]; its steps are 0.1 µm."""
FORCE_RATIO, STROKE, VELOCITY = 8.0, 40e-3, 2.0
"""Limit of the force over Coulomb friction, and those of stroke [m] and velocity [m/s]."""
BOUNDS = {"k0": 0.01, "f1": 0.2, "F": 0.03}


class Outcome(NamedTuple):
    """What a measurement has found."""

    errors: dict[str, float]
    is_ok: bool
    message: str
    machine_time: float

    @property
    def is_right(self) -> bool:
        """Whether all errors are within their bounds."""
        return all(abs(self.errors[name]) <= bound for name, bound in BOUNDS.items())


def drawn_sections(number: int, seed: int) -> tuple[dict[str, Any], str]:
    """Return the sections of a machine that has a mode and a usual sample time, and its law."""
    draws = np.random.default_rng([seed, number])
    law = LAWS[number % len(LAWS)]
    for attempt in range(1000):
        machine = drawn_machine(number, seed + 1000 * attempt, law)
        loop = machine.sections()["loop"]
        if machine.reference.modes and SAMPLE_TIMES[0] <= loop["sample_time"] <= SAMPLE_TIMES[1]:
            break
    sections = {name: machine.sections()[name] for name in ("plant", "friction", "controller")}
    late = loop["input_dead_time"] + loop["output_dead_time"]
    late += sum(loop["input_time_constants"]) + sum(loop["output_time_constants"])
    noise = float(np.exp(draws.uniform(*np.log(NOISE))))
    loop = {"sample_time": loop["sample_time"], "input_dead_time": late, "resolution": 1e-7, "noise": noise}
    return {**sections, "loop": {**loop, "seed": number, "divergence_limit": 100.0}}, law


def coulomb_force(sections: dict[str, Any]) -> float:
    """Return the force of gross sliding [N]."""
    model: Any = create(REGISTRY, FrictionModel, sections["friction"])
    return float(getattr(model, "coulomb_force", None) or np.sum(model.limit_force))


def measured(number: int, folder: str, seed: int) -> Outcome:
    """Return what an autonomous measurement of a machine finds."""
    sections, _ = drawn_sections(number, seed)
    force, plant = coulomb_force(sections), sections["plant"]
    study = {
        "title": f"Machine {number}",
        "loop": {"sample_time": sections["loop"]["sample_time"]},
        "limits": {"stroke": STROKE, "velocity": VELOCITY, "force": FORCE_RATIO * force},
        "measurement": {"machine": without_versions({"name": "simulated", **sections})},
    }
    root = Path(folder)
    write_study(root / "studies" / f"machine{number}.toml", study)
    service = AutonomousService(WorkspaceService.open(root), f"machine{number}")
    missing = {"k0": np.nan, "f1": np.nan, "F": np.nan}
    try:
        for _ in service.measure(fresh=True):
            pass
    except FraexpError as error:
        return Outcome(missing, False, str(error), 0.0)
    spent = sum(point.machine_time for point in service.files.points())
    result = service.result
    if result is None:
        return Outcome(missing, False, "no result", spent)
    return Outcome(errors_of(result, plant, force), service.is_good, result.message, spent)


def errors_of(result: Result, plant: dict[str, Any], force: float) -> dict[str, float]:
    """Return the errors of k0 (relative), the first mode [Hz] and the Coulomb force (relative)."""
    metrics = metrics_of(result)
    gain, found = metrics.get("k0", np.nan), [fit.component for fit in result.fits if fit.kind == "plant"]
    modes = np.array(found[0]["frequencies"] if found else [])
    first = float(min(modes - plant["frequencies"][0], key=abs)) if modes.size else np.nan
    return {"k0": gain / plant["rigid_body_gain"] - 1, "f1": first, "F": metrics["Coulomb force"] / force - 1}


def machines(bench: Bench) -> None:
    """Errors of k0, first mode and Coulomb force, the verdict, and the time."""
    right = honest = 0
    numbers = [int(text) for text in bench.options.only] or range(bench.options.machines)
    for number in numbers:
        began = time.monotonic()
        with tempfile.TemporaryDirectory() as folder:
            found = measured(number, folder, bench.seed)
        sections, law = drawn_sections(number, bench.seed)
        right += found.is_ok and found.is_right
        honest += not found.is_ok
        frequencies = "/".join(f"{f:.1f}" for f in sections["plant"]["frequencies"])
        text = f"k0 {found.errors['k0']:8.2%}  f1 {found.errors['f1']:7.3f} Hz  F {found.errors['F']:7.2%}  "
        text += f"{'ok' if found.is_ok else 'not ok'}{'' if found.is_right else ', off'}  "
        text += f"{found.machine_time:.0f} s of machine, {time.monotonic() - began:.0f} s"
        text += "" if found.is_ok else f"  {found.message[:200]}"
        what = f"{number} {law}, {1 / sections['plant']['rigid_body_gain']:.1f} kg, {frequencies} Hz"
        bench.row(what, text, found.is_right or not found.is_ok, **found.errors)
    print(f"{len(numbers)} machines: {right} right and ok, {honest} not ok")


if __name__ == "__main__":
    run(__doc__, machines, only=[], machines=(20, 5))
