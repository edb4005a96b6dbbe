"""Runs that are killed again and again come to the results of a run in peace, each computed once."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.waiting import HANG_TIMEOUT_S

pytestmark = pytest.mark.thorough


@pytest.mark.skipif(sys.platform != "linux", reason="finds processes through /proc")
def test_whatever_is_killed_the_answer_stays_right(checkout: Path, tmp_path: Path) -> None:
    command = [sys.executable, str(checkout / "benchmarks" / "torture.py"), "--quick", "--keep", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=6 * HANG_TIMEOUT_S)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "6 times kill -9" in done.stdout
    assert done.stdout.rstrip().endswith("0 missed")
