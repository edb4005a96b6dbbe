"""Time and memory of planning a million sweeps: ``fraexp run --dry-run`` on a grid of 100 × 100 × 100 points.

Measured in a process of its own, from its start to its end, without a database and with one of 10,000 sweeps.
``benchmarks/planning.py [POINTS]`` takes another length of each axis.
"""

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

POINTS = 100
TIME, MEMORY = 10.0, 1e9
"""Bounds for a million sweeps [s], [bytes]."""
STUDY = """
machine = "linear_motor_table"
[excitation]
name = "stepped_sine"
frequencies = [20, 40, 80]
[estimator]
name = "proposed"
[grid]
"""


def main() -> int:
    points = int(sys.argv[1]) if len(sys.argv) > 1 else POINTS
    with tempfile.TemporaryDirectory() as folder:
        study = Path(folder) / "many.toml"
        study.write_text(STUDY + grid(points))
        began = time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-m", "fraexp", "run", str(study), "--dry-run", "--workspace", folder], check=False
        )
        took = time.perf_counter() - began
    peak = 1024 * resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    sweeps = points**3
    missed = done.returncode != 0 or took > TIME or peak > MEMORY
    print(f"{sweeps:,} sweeps planned in {took:.1f} s, {1e6 * took / sweeps:.1f} µs each, with {peak / 1e6:.0f} MB")
    return missed


def grid(points: int) -> str:
    """Return three axes of so many points, in sections of their own."""
    axes = {
        "plant.gain": [0.1 + 1e-4 * n for n in range(points)],
        "friction.viscous_coefficient": [4.0 + 0.01 * n for n in range(points)],
        "excitation.amplitude": [10.0 + 0.5 * n for n in range(points)],
    }
    return "".join(f'"{path}" = {values}\n' for path, values in axes.items())


if __name__ == "__main__":
    sys.exit(main())
