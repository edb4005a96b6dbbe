"""Other programs simulate the same loop, and fraexp agrees with them."""

import re
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.thorough
def test_all_installed_peers_meet_their_stated_errors(checkout: Path) -> None:
    script = checkout / "benchmarks" / "peer_table.py"
    done = subprocess.run([sys.executable, str(script), "--reduced"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.rstrip().endswith("0 missed")
    for name in ("fraexp", "NumPy loop", "scipy solve_ivp RK45", "python-control"):
        assert re.search(rf"^{name}", done.stdout, re.MULTILINE), f"{name} is missing from the table"
