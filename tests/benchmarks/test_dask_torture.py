"""Runs on a Dask cluster that is disturbed at random come to the results of a run in peace, each computed once."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.waiting import HANG_TIMEOUT_S

pytest.importorskip("distributed", reason="Dask is not installed: pip install distributed")
pytestmark = pytest.mark.thorough


@pytest.mark.skipif(sys.platform != "linux", reason="pauses processes and reads /proc")
def test_whatever_is_silent_or_killed_the_answer_stays_right(checkout: Path, tmp_path: Path) -> None:
    command = [sys.executable, str(checkout / "benchmarks" / "dask_torture.py"), "--quick", "--keep", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=6 * HANG_TIMEOUT_S)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.rstrip().endswith("0 missed")
