"""Measurements on a simulated machine behind its socket: kill -9, the time that bands take, and limits that hold.

python benchmarks/measurements.py kill [COUNT]      the measuring process is killed at random moments
python benchmarks/measurements.py band              0.1 dB from 2 to 200 Hz: adaptive and fixed plan
python benchmarks/measurements.py limits [COUNT]    excitations and machines drawn at random against limits
"""

import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from fraexp.errors import FraexpError
from fraexp.measurement.measurement_plan import plan_measurement
from fraexp.simulation.live_loop import LiveLoop, live_setup
from fraexp.simulation.motion_limits import Demand
from fraexp.workspace.measurement_service import MeasurementService, PointEstimated
from fraexp.workspace.workspace_service import WorkspaceService

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
SECTIONS = ("plant", "friction", "controller", "loop", "numerics")
WAIT_TIMEOUT_S = 120.0


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


def kill(count: int) -> None:
    """Kill the measuring process at random moments; print how late the machine stopped, and what was lost."""
    draws, late, lost, failed = random.Random(1), [], 0, 0
    for number in range(count):
        with tempfile.TemporaryDirectory() as folder:
            workspace(folder)
            command = [sys.executable, "-m", "fraexp", "measure", "axis"]
            quiet = {"cwd": folder, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
            process = subprocess.Popen(command, **quiet)
            wait_for(lambda f=folder: log_of(f))
            time.sleep(draws.uniform(0.0, 6.0))
            os.kill(process.pid, signal.SIGKILL)
            process.wait()
            before = rows_of(folder)
            wait_for(lambda f=folder: log_of(f)[-1]["event"] == "rest")
            late += stop_delays(log_of(folder))
            failed += subprocess.run(command, **quiet, check=False).returncode != 0
            after = rows_of(folder)
            lost += not np.array_equal(after[: len(before)], before)
        latest = max(late, default=0.0) * 1e3
        print(
            f"{number + 1}: at rest {latest:.0f} ms after the watchdog's time; lost {lost}, failed {failed}", flush=True
        )
    print(f"{count} kills: {len(late)} while it played, the machine at rest at most {max(late) * 1e3:.0f} ms after the")
    print(f"watchdog's time, recorded samples lost in {lost}, resumed without completing {failed}")


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


def wait_for(condition: Any) -> None:
    until = time.monotonic() + WAIT_TIMEOUT_S
    while not condition():
        if time.monotonic() > until:
            raise TimeoutError
        time.sleep(0.01)


def band(goal: float = 0.1) -> None:
    """Print the machine time in which all frequencies reach a band: adaptive, and with equally long records."""
    grid = np.round(np.geomspace(2, 200, 20), 3).tolist()
    with tempfile.TemporaryDirectory() as folder:
        place = workspace(folder, frequencies=grid, noise="3 um", speed=0.0)
        points = measured(place, f"measurement.band={goal}", "measurement.max_record_time=120")
        adaptive = sum(point.machine_time for point in points)
        worst = max(point.periods * point.samples for point in points) * 500e-6
        print(f"adaptive: {adaptive:.0f} s, widest band {max(point.band for point in points):.3f} dB")
        points = measured(place, f"excitation.min_record_time={worst}", "excitation.recorded_periods=4")
        fixed = sum(point.machine_time for point in points)
        print(f"fixed, {worst:.1f} s each: {fixed:.0f} s, widest band {max(point.band for point in points):.3f} dB")
        print(f"adaptive takes {adaptive / fixed:.0%} of the machine time of the fixed plan")


def measured(place: WorkspaceService, *overrides: str) -> list[Any]:
    events = MeasurementService(place, "axis", overrides).measure(fresh=True)
    return [event.measured.point for event in events if isinstance(event, PointEstimated)]


def limits(count: int) -> None:
    """Draw excitations and limits, and the machine around the study's; print how far played ones exceeded a limit."""
    draws, played, refused, excess = np.random.default_rng(1), 0, 0, [0.0]
    with tempfile.TemporaryDirectory() as folder:
        place = workspace(folder)
        for number in range(count):
            stated, overrides = drawn_limits(draws), drawn_excitation(draws)
            overrides += [f"limits.{name}={value}" for name, value in stated.items()]
            try:
                service = MeasurementService(place, "axis", overrides)
                plan = plan_measurement(service.tasks[0], place.registry)
            except FraexpError:
                refused += 1
                continue
            played += 1
            setup = live_setup(drawn_truth(draws, service.tasks[0].experiment), place.folder)
            for point in plan.points:
                request = point.expected_request(point.counts.record)
                truth = LiveLoop(setup, number).play(request.excitation(0, request.samples))
                demand = Demand.of_samples(truth["displacement"], truth["u"], setup.sample_time)
                excess += [getattr(demand, name) / value - 1 for name, value in stated.items()]
    print(f"{count} drawn: {refused} refused, {played} played; the greatest excess over a limit is {max(excess):.1%}")
    print(f"{sum(each > 0 for each in excess)} of {len(excess)} demands exceed their limit")


def drawn_limits(draws: np.random.Generator) -> dict[str, float]:
    centre = {"stroke": 3e-3, "velocity": 0.1, "acceleration": 15.0, "force": 60.0, "force_rate": 2e4}
    return {name: float(value * 10 ** draws.uniform(-0.5, 0.7)) for name, value in centre.items()}


def drawn_excitation(draws: np.random.Generator) -> list[str]:
    amplitude = 10 ** draws.uniform(0.3, 2.2)
    if draws.random() < 0.3:
        name = "{name='multisine', rms=%g, line_spacing=1, min_frequency=%g, max_frequency=%g, seed=%d}"
        low = draws.uniform(1, 20)
        text = name % (amplitude / 3, low, low * draws.uniform(2, 10), draws.integers(1000))
        return [f"excitation={text}"]
    frequency = 10 ** draws.uniform(0.3, 2.3)
    return [f"excitation.frequencies=[{frequency}]", f"excitation.amplitude={amplitude}"]


def drawn_truth(draws: np.random.Generator, experiment: Any) -> dict[str, Any]:
    """Return a machine around the study's: gain and modes within 3 %, viscous friction within 30 %."""
    sections = {name: dict(experiment[name]) for name in SECTIONS}
    sections["plant"]["rigid_body_gain"] *= draws.uniform(0.97, 1.03)
    sections["plant"]["frequencies"] = [f * draws.uniform(0.97, 1.03) for f in sections["plant"]["frequencies"]]
    sections["friction"]["viscous_coefficient"] *= draws.uniform(0.7, 1.3)
    return sections


if __name__ == "__main__":
    kinds = {"kill": kill, "limits": limits}
    if sys.argv[1] == "band":
        band()
    else:
        kinds[sys.argv[1]](int(sys.argv[2]) if len(sys.argv) > 2 else 100)
