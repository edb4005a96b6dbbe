"""Make the example record: a stepped sine on the paper's machine, with the encoder's resolution and noise.

python benchmarks/make_record.py studies/records/table_stepped_sine.csv
"""

import sys
from pathlib import Path

import numpy as np
from calibrate_machine import MACHINE, sections_of

from fraexp.components.registry import discover
from fraexp.execution.job import Job, load_signals

FREQUENCIES = [8.0, 12.0, 17.0, 24.0, 30.0, 36.0, 39.0, 43.0, 55.0, 68.0, 80.0, 110.0, 150.0]
AMPLITUDE, NOISE, PERIODS = 25.0, 30e-9, 3


def main() -> None:
    """Simulate and write the columns time, thrust, position and frequency."""
    sections = sections_of(MACHINE)
    sections["loop"] |= {"noise": NOISE, "seed": 1}
    excitation = {
        "name": "stepped_sine",
        "amplitude": AMPLITUDE,
        "frequencies": FREQUENCIES,
        "settling_tolerance": 1e-4,
        "recorded_periods": PERIODS,
    }
    experiment = {"source": "loop", **sections, "excitation": excitation, "numerics": {}}
    signals = load_signals(Job(experiment, ()), discover(), lambda _: None)
    thrust = np.concatenate([segment.channels["u"].ravel() for segment in signals.segments])
    position = np.concatenate([segment.channels["y"].ravel() for segment in signals.segments])
    frequency = np.concatenate([np.full(s.channels["u"].size, s.frequency[0]) for s in signals.segments])
    sample_time = sections["loop"]["sample_time"]
    with Path(sys.argv[1]).open("w", encoding="utf-8") as file:
        file.write("# Simulated: linear-motor table, stepped sine of 25 N, scale of 0.1 um with 30 nm of noise\n")
        file.write("time [s],thrust [N],position [um],frequency [Hz]\n")
        for k, (u, y, f) in enumerate(zip(thrust, position, frequency, strict=True)):
            file.write(f"{k * sample_time:.4f},{u:.4f},{y * 1e6:.1f},{f:.6g}\n")


if __name__ == "__main__":
    main()
