"""Measurements on a simulated machine behind its socket: kill -9, and the time that bands take.

python benchmarks/measurements.py kill --count 100   the measuring process is killed at random moments
python benchmarks/measurements.py band               0.1 dB from 2 to 200 Hz: adaptive and fixed plan
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from harness import ROOT, Bench, run

sys.path.insert(0, str(ROOT))
from fraexp.workspace.measurement_service import MeasurementService, PointEstimated
from fraexp.workspace.workspace_service import WorkspaceService
from tests.waiting import wait_until

STUDY = """
title = "An axis"
machine = "linear_motor_table"
[excitation]
name = "stepped_sine"
frequencies = {frequencies}
amplitude = 40
recorded_periods = {periods}
[loop]
noise = "{noise}"
[numerics]
steps_per_sample = 6
[limits]
stroke = "100 mm"
velocity = "2 m/s"
force = 500
[measurement]
machine = {{ name = "simulated", speed = {speed}, log = "machine.log" }}
[estimator]
name = "conventional"
"""
AT_REST_S, BAND_DB = 0.1, 0.1
"""Bounds: time after that of the watchdog until the machine rests, and width of the bands."""


def workspace(folder: str, **settings: Any) -> WorkspaceService:
    root = Path(folder)
    (root / "studies").mkdir(exist_ok=True)
    words = {"frequencies": "[10.0, 38.8, 100.0]", "periods": 4, "noise": "30 nm", "speed": 1.0, **settings}
    text = STUDY.format(**words).replace('"machine.log"', json.dumps(str(root / "machine.log")))
    (root / "studies" / "axis.toml").write_text(text, encoding="utf-8")
    return WorkspaceService.open(root)


def log_of(folder: str) -> list[dict[str, Any]]:
    file = Path(folder) / "machine.log"
    lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    return [json.loads(line) for line in lines if line.endswith("}")]


def kill(bench: Bench) -> None:
    """How late the machine stops after the measuring process is killed, and what is lost."""
    draws, late, lost, failed = bench.generator(), [], 0, 0
    for _ in range(bench.options.count):
        with tempfile.TemporaryDirectory() as folder:
            workspace(folder)
            command = [sys.executable, "-m", "fraexp", "measure", "axis"]
            quiet: dict[str, Any] = {"cwd": folder, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
            process = subprocess.Popen(command, **quiet)
            wait_until(lambda f=folder: bool(log_of(f)))
            time.sleep(draws.uniform(0.0, 6.0))
            os.kill(process.pid, signal.SIGKILL)
            process.wait()
            before = rows_of(folder)
            wait_until(lambda f=folder: log_of(f)[-1]["event"] == "rest")
            late += stop_delays(log_of(folder))
            failed += subprocess.run(command, **quiet, check=False).returncode != 0
            lost += not np.array_equal(rows_of(folder)[: len(before)], before)
    what = f"{bench.options.count} kills, {len(late)} while it played"
    bench.bounded(f"{what}: at rest after the watchdog's time", 1e3 * max(late, default=0.0), 1e3 * AT_REST_S, "ms")
    bench.bounded("recorded samples lost", lost, 0)
    bench.bounded("resumed without completing", failed, 0)


def rows_of(folder: str) -> np.ndarray:
    file = Path(folder) / "measurements" / "axis.samples"
    if not file.exists():
        return np.empty((0, 4))
    content = file.read_bytes()
    start = content.index(b"\n") + 1
    return np.frombuffer(content[start : start + (len(content) - start) // 32 * 32], "<f8").reshape(-1, 4)


def stop_delays(log: list[dict[str, Any]], watchdog: float = 0.5) -> list[float]:
    """Return how long after the time of the watchdog the machine was at rest, where that stopped it [s]."""
    found, heard = [], 0.0
    for event in log:
        heard = event.get("last_sign_of_life", heard)
        if event["event"] == "rest" and event["reason"] == "watchdog":
            found.append(event["time"] - heard - watchdog)
    return found


def band(bench: Bench) -> None:
    """Machine time in which all frequencies reach a band: adaptive, and with equally long records."""
    grid = np.round(np.geomspace(2, 200, 4 if bench.reduced else 20), 3).tolist()
    with tempfile.TemporaryDirectory() as folder:
        place = workspace(folder, frequencies=grid, noise="3 um", speed=0.0)
        points = measured(place, f"measurement.band={BAND_DB}", "measurement.max_record_time=120")
        longest = max(point.periods * point.samples for point in points) * 500e-6
        adaptive = sum(point.machine_time for point in points)
        widest = max(point.band for point in points)
        bench.row("adaptive", f"{adaptive:.0f} s of machine, widest band {widest:.3f} dB", widest <= BAND_DB)
        points = measured(place, f"excitation.min_record_time={longest}", "excitation.recorded_periods=4")
        fixed = sum(point.machine_time for point in points)
        widest = max(point.band for point in points)
        bench.row(f"fixed, {longest:.1f} s each", f"{fixed:.0f} s of machine, widest band {widest:.3f} dB")
        bench.bounded("adaptive over fixed", adaptive / fixed, 1.0)


def measured(place: WorkspaceService, *overrides: str) -> list[Any]:
    events = MeasurementService(place, "axis", overrides).measure(fresh=True)
    return [event.measured.point for event in events if isinstance(event, PointEstimated)]


if __name__ == "__main__":
    run(__doc__, kill, band, count=(100, 2))
