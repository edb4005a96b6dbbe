"""A workspace whose sweeps do what they are told: nearly nothing, or harm to the worker that computes them."""

from pathlib import Path

from fraexp.execution.sent_jobs import Job

PLUGIN = '''
"""Estimators that do what they are told."""

import os
import time
from pathlib import Path
from typing import ClassVar

import numpy as np

from fraexp.api import Estimator, FrictionModel, Metric, Outcome, Result, param


class Trivial(Estimator, name="trivial", version=1):
    """Says how great the displacement was, and who it was that computed it."""

    def estimate(self, signals):
        """Return two metrics."""
        peak = float(np.max(signals.segments[0].channels["displacement"]))
        return Result(Outcome.OK, metrics=(Metric("peak", peak, "m"),))


class Who(Estimator, name="who", version=1):
    """Says in which process and with how many threads it computes."""

    def estimate(self, signals):
        """Return metrics."""
        np.linalg.inv(np.random.default_rng(1).normal(size=(400, 400)))  # threads are started when they are needed
        status = Path("/proc/self/status")  # Linux
        threads = [line.split()[1] for line in status.read_text().splitlines() if line.startswith("Threads")]
        told = {"process": os.getpid(), "threads": int(threads[0])}
        return Result(Outcome.OK, metrics=tuple(Metric(name, float(value), "1") for name, value in told.items()))


class Endless(FrictionModel, name="endless", version=1):
    """Never gives the force of a step beyond 0.5 m."""

    force_bound: ClassVar[float] = 1.0
    max_stiffness: ClassVar[float] = 1.0
    states: ClassVar[tuple[str, ...]] = ("force [N]",)

    @staticmethod
    def advance(z, dy, dt, z_next):
        """Friction force [N] after the displacement moved by dy [m]."""
        z_next[0] = 0.0
        while abs(dy) > 0.5:
            z_next[0] += 1.0
        return z_next[0]


class Trouble(Estimator, name="trouble", version=1):
    """Does something in Python before it answers."""

    code: str = param("", "what it does")
    times: int = param("1", "how often it does so, told by files in the folder", 10**9)
    folder: str = param("", "folder for notes", "")

    def estimate(self, signals):
        """Return an empty result, after the trouble."""
        notes = Path(self.folder) if self.folder else None
        count = len(list(notes.iterdir())) if notes else 0
        if notes:
            (notes / f"{count}-{os.getpid()}-{time.monotonic_ns()}").touch()
        if count < self.times:
            exec(self.code)
        return Result(Outcome.OK, metrics=(Metric("attempts", float(count + 1), "1"),))
'''


def write_plugin(folder: Path) -> str:
    """Write the plugin into a folder, and return the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "trouble.py").write_text(PLUGIN, encoding="utf-8")
    return str(folder)


def job(plugins: str, *estimators: dict[str, object], amplitude: float = 1e-5) -> Job:
    """Return a job on a friction-free displacement, which costs next to nothing."""
    return Job(
        {
            "source": "drive",
            "friction": {"name": "none", "version": 1},
            "excitation": {"name": "displacement_sine", "version": 1, "amplitude": amplitude, "frequency": 10.0},
            "loop": {"sample_time": 1e-3},
        },
        tuple(estimators) or ({"name": "trivial", "version": 1},),
        plugins=plugins,
    )


def trouble(code: str, **more: object) -> dict[str, object]:
    """Return an estimator that runs `code`."""
    return {"name": "trouble", "version": 1, "code": code, **more}


def study(sweeps: int, *troubles: dict[str, object], friction: str = "none", least: float = 1e-6) -> str:
    """Return a study of that many trivial sweeps, of amplitudes from `least` [m], and as many for each trouble."""
    cases = ['[[case]]\nlabel = "trivial"\nestimator = { name = "trivial" }']
    cases += [f'[[case]]\nlabel = "trouble {n}"\nestimator = {_inline(of)}' for n, of in enumerate(troubles)]
    return f"""title = "Trouble"
[loop]
sample_time = 1e-3
[friction]
name = "{friction}"
[excitation]
name = "displacement_sine"
frequency = 10.0
{chr(10).join(cases)}
[grid]
"excitation.amplitude" = {[round((n + 1) * least, 9) for n in range(sweeps)]}
"""


def _inline(table: dict[str, object]) -> str:
    entries = (f"{key} = {value!r}" for key, value in table.items() if key != "version")
    return "{ " + ", ".join(entries).replace("\\n", "\\\\n") + " }"
