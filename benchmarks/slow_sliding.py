"""Hold the intervals of a LuGre law's numbers where the records never slide faster than its Stribeck velocity.

    python benchmarks/slow_sliding.py                10 machines
    python benchmarks/slow_sliding.py --seed 7

Coulomb force and Stribeck velocity are then extrapolated: they act nearly alike. Machines and records are those of
`law_selection.py`, but for the Stribeck velocity, which is 1.25 times the largest velocity of a record that is
simulated first. All numbers of friction are wrong at the start, as there, and the law is the only candidate. What is
printed are errors over the half-width of the 95 % interval, and that half-width over the value.

The exit code is 1 if more than one of ten intervals misses the true value, of all that the verdict calls right.
"""

import argparse
import os
import sys
from dataclasses import replace

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from drawn_machines import DrawnMachine
from law_selection import candidates, choose, machines, record

from fraexp.data.results import Fit, Outcome

SEED = 32
VELOCITY_RATIO = 1.25
"""Stribeck velocity over the largest velocity."""
MIN_STATIC_RATIO = 1.1
"""Least static over Coulomb force: without a Stribeck effect there is nothing to extrapolate."""
NAMES = ("coulomb_force", "static_force", "stribeck_velocity", "viscous_coefficient", "bristle_stiffness")
MAX_MISSED_SHARE, HALF_WIDTH_STDS = 0.1, 1.96


def slow_machine(machine: DrawnMachine) -> DrawnMachine:
    """Return a machine whose Stribeck velocity is above all velocities of its records."""
    own = {**machine.friction}
    own["static_force"] = max(own["static_force"], MIN_STATIC_RATIO * own["coulomb_force"])
    speed = max(
        float(np.abs(np.gradient(segment.channels["displacement"].ravel(), segment.sample_time)).max())
        for segment in record(replace(machine, friction=own)).segments
    )
    return replace(machine, friction={**own, "stribeck_velocity": VELOCITY_RATIO * speed})


def fitted(machine: DrawnMachine, seed: int) -> tuple[Outcome, Fit]:
    """Return the outcome, and the friction that is found from a wrong start."""
    (start,) = candidates(machine, ("lugre",), np.random.default_rng([seed, machine.number]), is_blind=False)
    result = choose(machine, record(machine), [start])
    return result.outcome, next(fit for fit in result.fits if fit.kind == "friction")


def main() -> int:
    """Print errors over half-widths, and how many intervals miss."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--machines", type=int, default=10, help="number of machines (10)")
    parser.add_argument("--seed", type=int, default=SEED, help=f"seed of the draws ({SEED})")
    parser.add_argument("--reduced", action="store_true", help="3 machines")
    arguments = parser.parse_args()
    count, missed, judged = 3 if arguments.reduced else arguments.machines, 0, 0
    for drawn in machines(count, ("lugre",), arguments.seed):
        machine = slow_machine(drawn)
        outcome, fit = fitted(machine, arguments.seed)
        texts = []
        for name in NAMES:
            place = fit.parameters.index(name)
            value, true = float(fit.values[place]), float(machine.friction[name])
            half_width = HALF_WIDTH_STDS * float(np.sqrt(fit.covariance[place, place]))
            ratio = (value - true) / half_width
            texts.append(f"{name} {ratio:+.2f} (± {100 * half_width / value:.2g} %)")
            if outcome is Outcome.OK:
                judged, missed = judged + 1, missed + (abs(ratio) > 1)
        print(f"{machine.number:4d} {outcome.value or 'ok':12s} {', '.join(texts)}", flush=True)
    print(f"\nintervals that miss the true value: {missed} of {judged}")
    return int(missed > MAX_MISSED_SHARE * judged)


if __name__ == "__main__":
    sys.exit(main())
