"""The accuracies that the README states hold."""

import subprocess
import sys
from pathlib import Path


def test_no_stated_accuracy_is_missed(checkout: Path) -> None:
    script = checkout / "benchmarks" / "accuracy.py"
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "no friction, ideal scale: conventional" in done.stdout
    assert done.stdout.rstrip().endswith("0 missed")
