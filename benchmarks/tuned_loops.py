"""Draw plants in the band of a measured response, and count the unstable loops with the tuned gains.

    python benchmarks/tuned_loops.py             10,000 plants for each of six bands
    python benchmarks/tuned_loops.py --reduced   500

Stability is judged by the eigenvalues of each sampled loop (`tests/tuning/drawn_loops.py`).
"""

import sys

from harness import ROOT, Bench, run
from paper_machine import REGISTRY

sys.path.insert(0, str(ROOT))
from tests.tuning.drawn_loops import tune, unstable_loops


def drawn_loops(bench: Bench) -> None:
    """Unstable loops among plants drawn in the band, for several bands."""
    for name in ("linear_motor_table", "linear_motor_table_integral"):
        for noise, is_integral in ((0.1e-6, True), (3e-6, False), (3e-6, True)):
            machine = tune(REGISTRY, name, noise, 0.02, integral_action=is_integral)
            count, worst = unstable_loops(machine, machine.controller, bench.options.draws, 2 * bench.seed)
            gain = machine.controller.model_dump()["proportional"]
            what = f"{name}, {noise * 1e6:.1f} µm{', integral action' * is_integral}"
            text = f"Kp {gain:9.0f} N/m: {count} of {bench.options.draws} unstable, greatest pole {worst:.6f}"
            bench.row(what, text, count == 0, worst=worst)


if __name__ == "__main__":
    run(__doc__, drawn_loops, draws=(10_000, 500))
