"""Measure time and memory of planning a million sweeps: ``fraexp run --dry-run`` on a grid of 100 × 100 × 100 points.

Measured in a process of its own, from its start to its end, without a database. What is judged is the computing
time, which other programs on the machine disturb less. ``benchmarks/planning.py [POINTS]`` takes another length of
each axis.
"""

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

POINTS = 100
TIME, MEMORY = 10.0, 1e9
"""Bounds [s], [bytes]."""
STUDY = """
machine = "linear_motor_table"
[excitation]
name = "stepped_sine"
frequencies = [20, 40, 80]
[estimator]
name = "effective_input"
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
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    computing, peak, sweeps = used.ru_utime + used.ru_stime, 1024 * used.ru_maxrss, points**3
    missed = done.returncode != 0 or computing > TIME or peak > MEMORY
    each = f"{1e6 * computing / sweeps:.1f} µs each, {took:.1f} s by the clock"
    print(f"{sweeps:,} sweeps planned in {computing:.1f} s of computing, {each}, with {peak / 1e6:.0f} MB")
    return missed


def grid(points: int) -> str:
    """Return three axes of so many points, in sections of their own."""
    axes = {
        "plant.rigid_body_gain": [0.1 + 1e-4 * n for n in range(points)],
        "friction.viscous_coefficient": [4.0 + 0.01 * n for n in range(points)],
        "excitation.amplitude": [10.0 + 0.5 * n for n in range(points)],
    }
    return "".join(f'"{path}" = {values}\n' for path, values in axes.items())


if __name__ == "__main__":
    sys.exit(main())
