"""Checks of friction models that look at whole motions: reversals, loops, ever smaller steps, other processes."""

import importlib
import inspect
import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st
from hypothesis import target

from fraexp.components.kinds import Component, FrictionModel
from fraexp.errors import FraexpError
from fraexp.testing.conformance_check import NotApplicableError, require
from fraexp.testing.examples import strategy
from fraexp.testing.interpreted import Interpreted
from fraexp.testing.of_laws import NEAR
from fraexp.testing.walk import Drive, described, loops, slip_length, to_and_fro

STEPS = (200, 3200, 51200)
"""Steps per period, in which errors and jumps of the force must shrink."""
QUICK_STEPS = (100, 800, 3200)
"""Those that plain Python takes at once."""
FINER, QUICK_FINER = 16, 2
"""Parts into which the steps of a closed loop are divided, so that its energy is that of the law."""
LOST = 1e-3
"""Energy that a closed loop may give, relative to the work done in it: what the steps leave undecided."""


@dataclass(frozen=True)
class Wave:
    """A friction model and a smooth periodic motion: a sine with a harmonic."""

    model: FrictionModel
    amplitude: float
    """In the model's slip lengths."""
    harmonic: float
    """Third harmonic's share of the fundamental."""
    period: float
    """Duration [s]."""
    steps: tuple[int, int, int] = STEPS
    """Steps per period: coarse, fine, and those that count as exact."""

    def record(self, steps: int) -> np.ndarray:
        """Return one period of the displacement [m], shape (steps,)."""
        phase = 2 * np.pi * np.arange(steps) / steps
        shape = np.sin(phase) + self.harmonic * np.sin(3 * phase + 1.0)
        return self.amplitude * slip_length(self.model) * shape

    def force(self, steps: int, periodic: bool = True) -> np.ndarray:
        """Return the force [N] over the period, shape (steps,)."""
        return self.model.force(self.record(steps), self.period / steps, periodic=periodic)

    def __str__(self) -> str:
        """One line for a report."""
        length = self.amplitude * slip_length(self.model)
        return f"{described(self.model)}; a sine of {length:.3g} m, period {self.period:g} s, third {self.harmonic:g}"


def closed(component: type[Component]) -> Any:
    """Return the strategy of drives to and fro of a friction model: short ones where plain Python has to do."""
    return to_and_fro(component) if issubclass(component, Interpreted) else loops(component)


def waves(component: type[Component]) -> Any:
    """Return the strategy of waves of a friction model."""
    return st.builds(
        Wave,
        strategy(component),
        st.sampled_from([4.0, 1.0, 0.25, 20.0]),
        st.sampled_from([0.0, 0.3, 0.9]),
        st.sampled_from([1.0, 0.1, 10.0, 0.01]),
        st.just(QUICK_STEPS if issubclass(component, Interpreted) else STEPS),
    )


def continuous(wave: Wave) -> None:
    """The force does not jump at a reversal: steps of it shrink with the steps of the motion."""
    jumps = []
    coarse, fine, _ = wave.steps
    for steps in (coarse, fine):
        record, force = wave.record(steps), wave.force(steps)
        turning = np.flatnonzero(np.diff(np.sign(np.diff(record))) != 0)
        near = np.unique(np.clip(turning[:, None] + np.arange(-1, 4), 1, steps - 1))
        jumps.append(float(np.max(np.abs(np.diff(force)[near - 1]), initial=0.0)))
    scale = float(np.max(np.abs(force))) or 1.0
    jump = f"{jumps[0]:.4g} N with {coarse} steps, {jumps[1]:.4g} N with {fine}"
    require(jumps[1] <= 0.5 * jumps[0] + NEAR * scale, f"it jumps at a reversal by {jump}")


def refinement(wave: Wave) -> None:
    """Smaller steps of the same motion converge: to the same force at once where no rate matters."""
    coarse, fine, _ = wave.steps
    forces = [wave.force(steps, periodic=False)[:: steps // coarse] for steps in wave.steps]
    scale = float(np.max(np.abs(forces[-1]))) or 1.0
    errors = [float(np.sqrt(np.mean((force - forces[-1]) ** 2))) / scale for force in forces[:2]]
    change = f"they differ by {errors[0]:.2e} of the force with {coarse} steps, by {errors[1]:.2e} with {fine}"
    require(errors[1] <= max(0.5 * errors[0], NEAR), f"smaller steps do not converge: {change}")


def energy(drive: Drive) -> None:
    """No closed loop gives energy: ∮ f dy ≥ 0."""
    finer = QUICK_FINER if isinstance(drive.model, Interpreted) else FINER
    at = np.arange(finer * drive.record.size) / finer
    record = np.interp(at, np.arange(drive.record.size + 1), [*drive.record, 0.0])
    step = drive.time_step / finer
    force = drive.model.force(record, step, periodic=True)
    dy = np.roll(record, -1) - record
    viscous = drive.model.viscous * float(np.sum(dy**2)) / step
    work = (force + np.roll(force, -1)) / 2 * dy
    effort = float(np.sum(np.abs(work))) + viscous
    gained = -(float(np.sum(work)) + viscous)
    target(gained / effort if effort else 0.0)
    require(gained <= LOST * effort, f"a closed loop gives {gained:.4g} J of {effort:.4g} J moved")


def elsewhere(drive: Drive) -> None:
    """Another process gives the same force, to the last bit."""
    component = type(drive.model)
    if "<locals>" in component.__qualname__:
        raise NotApplicableError("its class is defined within a function, where no other process finds it")
    order = {
        "file": inspect.getfile(component), "module": component.__module__, "class": component.__qualname__,
        "spec": drive.model.spec(), "record": drive.record.tolist(), "time_step": drive.time_step,
    }  # fmt: skip
    command = [sys.executable, "-c", "from fraexp.testing.of_friction import answer; answer()"]
    done = subprocess.run(command, input=json.dumps(order), capture_output=True, text=True, check=False, timeout=120)
    reason = (done.stderr.strip().splitlines() or [""])[-1]
    require(done.returncode == 0, f"the other process fails: {reason}")
    here = [force.hex() for force in drive.model.force(drive.record, drive.time_step).tolist()]
    require(json.loads(done.stdout) == here, "the other process gives another force")


def answer() -> None:
    """Compute the force that `elsewhere` orders on standard input."""
    order = json.load(sys.stdin)
    owner: Any = _module(order["module"], Path(order["file"]))
    for part in order["class"].split("."):
        owner = getattr(owner, part)
    from fraexp.testing.of_any import registry_with

    model: Any = registry_with(owner).create(owner.kind, order["spec"])
    force = model.force(np.array(order["record"]), order["time_step"])
    print(json.dumps([value.hex() for value in force.tolist()]))


def _module(name: str, file: Path) -> Any:
    from fraexp.components.registry import DROP_IN, load_file

    try:
        return load_file(file) if name.startswith(DROP_IN) else importlib.import_module(name)
    except ImportError:
        return load_file(file)
    except FraexpError as error:
        raise SystemExit(str(error)) from None
