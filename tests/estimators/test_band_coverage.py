"""The published 95 % bands hold what they say: the benchmark at its reduced size."""

import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.thorough
def test_every_band_covers_the_truth(checkout: Path) -> None:
    command = [sys.executable, str(checkout / "benchmarks" / "band_coverage.py"), "--reduced", "--seed", "5"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.rstrip().endswith("0 missed")
