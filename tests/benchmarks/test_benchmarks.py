"""The accuracies that the README states hold."""

import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.parametrize(
    ("script", "arguments"),
    [
        ("accuracy.py", ["without-friction", "proposed", "fits", "model-errors"]),
    ],
)
@pytest.mark.thorough
def test_no_stated_accuracy_is_missed(checkout: Path, script: str, arguments: list[str]) -> None:
    command = [sys.executable, str(checkout / "benchmarks" / script), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.rstrip().endswith("0 missed")
