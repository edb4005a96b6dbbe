"""Benchmarks that judge what the README states meet their bounds, reduced."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.waiting import HANG_TIMEOUT_S

pytestmark = pytest.mark.thorough
ACCURACY = ["accuracy.py", "without-friction", "proposed", "fits", "model-errors"]
PEERS = ("\nfraexp", "\nNumPy loop", "\nscipy solve_ivp RK45", "\npython-control")
needs_linux = pytest.mark.skipif(sys.platform != "linux", reason="finds and pauses processes through /proc")


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (ACCURACY, ()),
        (["peer_table.py", "--reduced"], PEERS),
        pytest.param(["torture.py", "--quick", "--keep"], ("6 times kill -9",), marks=needs_linux),
        pytest.param(["dask_torture.py", "--quick", "--keep"], (), marks=needs_linux),
    ],
    ids=lambda part: part[0] if isinstance(part, list) else "",
)
def test_no_bound_is_missed(checkout: Path, tmp_path: Path, command: list[str], words: tuple[str, ...]) -> None:
    script, *options = command
    if script == "dask_torture.py":
        pytest.importorskip("distributed", reason="Dask is not installed: pip install distributed")
    kept = [str(tmp_path)] if "--keep" in options else []
    line = [sys.executable, str(checkout / "benchmarks" / script), *options, *kept]
    done = subprocess.run(line, capture_output=True, text=True, check=False, timeout=6 * HANG_TIMEOUT_S)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.rstrip().endswith("0 missed")
    assert [word for word in words if word not in done.stdout] == []
