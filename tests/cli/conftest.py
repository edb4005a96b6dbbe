import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fraexp.data.findings import remarks
from fraexp.data.results import Curve, FrequencyResponse, Metric, Outcome, Result
from fraexp.data.sweep import Sweep
from fraexp.store import ComponentOrigin, Store
from tests.responses import frequency_response
from tests.waiting import HANG_TIMEOUT_S

ROOT = Path(__file__).parents[2]
Command = Callable[..., subprocess.CompletedProcess[str]]


def response_of(gain: float, points: int = 40) -> FrequencyResponse:
    frequency = np.geomspace(1, 200, points)
    return frequency_response(
        frequency,
        -gain / frequency**2,
        covariance=np.tile(np.eye(2) * 1e-14, (points, 1, 1)),
        input_amplitude=np.full(points, 12.0),
        output_amplitude=12 * gain / frequency**2,
        settled=frequency > 1.5,
        settling_time=np.full(points, 0.5),
        residual=np.full(points, 1e-7),
        harmonics=np.full((points, 6), 1e-3 + 0j),
    )


def _record(column: str, **labels: Any) -> Sweep:
    channels = {"u": {"column": "force"}, "y": {"column": column}}
    return Sweep(
        {"source": "record", "record": {"hash": "abc", "channels": channels, "lines": list(range(20))}},
        {"name": "h1", "version": 1, "output": "y"},
        labels,
    )


def fill(path: Path) -> list[Sweep]:
    """Write run 1: two responses 6 dB apart, a loop of a driven friction model, a diverged and a failed sweep."""
    sweeps = [
        _record("scale", **{"record.output": "scale"}),
        _record("laser", **{"record.output": "laser\x1b[31m"}),
        Sweep({"source": "drive", "friction": {"name": "dahl", "stiffness": 1e5}}, {"name": "hysteresis"}, {"x": 1e-5}),
        Sweep({"source": "drive", "friction": {"name": "dahl", "stiffness": 1e9}}, {"name": "hysteresis"}, {"x": 2e-5}),
        Sweep({"source": "drive", "friction": {"name": "dahl", "stiffness": 2e9}}, {"name": "hysteresis"}, {"x": 3e-5}),
    ]
    angle = np.linspace(0, 7, 30)
    loop = Curve("loop", {"displacement": np.cos(angle), "force": np.sin(angle)}, {"displacement": "m", "force": "N"})
    results = [
        Result(Outcome.OK, (), response_of(0.1), (Metric("gain", 0.1, "m/N"), Metric("delay", float("nan"), "s"))),
        Result(Outcome.NOT_SETTLED, remarks("1 of 40 frequencies"), response_of(0.2), (Metric("gain", 0.2, "m/N"),)),
        Result(Outcome.OK, curves=(loop,)),
        Result(Outcome.DIVERGED, remarks("after 0.2 s")),
    ]
    with Store.open(str(path), create=True) as store:
        provenance = {"fraexp": "0.1.0", "git": {"commit": "c0ffee" * 6, "dirty": True}}
        run = store.begin_run("bench", "studies/bench.toml", "fraexp run studies/bench.toml", provenance, sweeps)
        origin = {"estimator:h1": ComponentOrigin("0123456789abcdef", "fraexp 0.1.0")}
        store.save(run, [(sweep, result, origin) for sweep, result in zip(sweeps, results, strict=False)])
        store.fail(run, sweeps[4].key, "ZeroDivisionError: float division by zero", "the log")
        store.end_run(run, "partial")
    return sweeps


@pytest.fixture(scope="session")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder whose results.db is only read."""
    folder = tmp_path_factory.mktemp("workspace")
    fill(folder / "results.db")
    return folder


@pytest.fixture(scope="session")
def sweeps(tmp_path_factory: pytest.TempPathFactory) -> list[Sweep]:
    """The sweeps of run 1 of that workspace."""
    return fill(tmp_path_factory.mktemp("again") / "results.db")


@pytest.fixture
def fraexp(workspace: Path, tmp_path: Path) -> Command:
    """Run the command line in a process of its own, in an empty folder, against the workspace."""

    def run(*arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-W", "error", "-m", "fraexp", *arguments]
        environment = {**os.environ, "PYTHONPATH": f"{ROOT}:{ROOT / 'plugins'}", **variables}
        pipes = {"capture_output": True, "text": True, "encoding": "utf-8"}
        return subprocess.run(command, cwd=tmp_path, env=environment, check=False, timeout=HANG_TIMEOUT_S, **pipes)

    return run
