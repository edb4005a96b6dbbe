"""Count how many seeded defects the fast tests find.

    python benchmarks/suite_defects.py                    all of them, some minutes
    python benchmarks/suite_defects.py --reduced          each fifth
    python benchmarks/suite_defects.py --only hold seed   those whose name contains a word

Each defect replaces one text of the last commit by a wrong one, in a temporary worktree, and runs the fast tests that
are named beside it. A defect is found if a test fails. It is an error if the text is not there exactly once: then the
code has changed, and the defect must follow it. The tests must pass without any defect.
"""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from harness import Bench, checked_out, run

TIMEOUT_S = 600.0
"""Time after which tests that a defect keeps from ending count as failed."""


class Defect(NamedTuple):
    """A wrong text in place of a right one, and the tests that should fail."""

    name: str
    file: str
    right: str
    wrong: str
    tests: str


PLUGINS = "plugins/fraexp_plugins"
DEFECTS = (
    Defect(
        "hold without its phase", "fraexp/analysis/delays.py",
        "return np.exp(-1j * half) * np.sinc(half / np.pi)", "return np.sinc(half / np.pi) + 0j",
        "tests/physics/test_loop.py",
    ),
    Defect(
        "dead time that leads", "fraexp/analysis/delays.py",
        "np.exp(-1j * omega * dead_time)", "np.exp(1j * omega * dead_time)",
        "tests/physics/test_loop.py",
    ),
    Defect(
        "factor 2 in the circle of 95 %", "fraexp/analysis/confidence.py",
        "quantile = finite / 2 * np.expm1(", "quantile = finite * np.expm1(", "tests/analysis/test_confidence.py",
    ),
    Defect(
        "one-sided quantile", "fraexp/analysis/confidence.py",
        "(1 + CONFIDENCE_LEVEL) / 2", "CONFIDENCE_LEVEL", "tests/analysis/test_confidence.py",
    ),
    Defect(
        "rounding variance q²/3", "fraexp/analysis/quantisation.py",
        "encoder.resolution**2 / 12", "encoder.resolution**2 / 3", "tests/estimators/test_encoder_bands.py",
    ),
    Defect(
        "sign of Coulomb friction", f"{PLUGINS}/friction/coulomb.py",
        "z[0] + max_stiffness * dy", "z[0] - max_stiffness * dy", "tests/physics/test_steady_sliding.py",
    ),
    Defect(
        "Dahl's exponent halved", f"{PLUGINS}/friction/dahl.py",
        "math.exp(-stiffness * abs(dy)", "math.exp(-0.5 * stiffness * abs(dy)", "tests/physics/test_dahl_and_lugre.py",
    ),
    Defect(
        "friction that sees 98 % of the motion", "fraexp/kernels/friction_step.py",
        "previous_force)\n        return law(z, y", "previous_force)\n        return law(z, 0.98 * y",
        "tests/physics/test_against_harmonic_balance.py",
    ),
    Defect(
        "dead time longer by a sample", "fraexp/simulation/discretisation.py",
        "samples = int(np.floor(dead_time / sample_time + 1e-9))",
        "samples = int(np.floor(dead_time / sample_time + 1e-9)) + 1", "tests/physics/test_loop.py",
    ),
    Defect(
        "gain of the integral action", f"{PLUGINS}/controllers/pid.py",
        "self.proportional * sample_time / (2 * self.integral_time)",
        "self.proportional * sample_time / self.integral_time", "tests/simulation/test_exported_feedback.py",
    ),
    Defect(
        "one noise for all experiments", "fraexp/simulation/batch_preparation.py",
        "np.random.SeedSequence([experiment.setup.seed, experiment.number])",
        "np.random.SeedSequence([experiment.setup.seed])", "tests/simulation/test_batch_preparation.py",
    ),
    Defect(
        "seed of the phases", f"{PLUGINS}/excitations/multisine.py",
        "rng([self.seed, 1, number])", "rng([self.seed, 1])", "tests/excitations/test_multisine.py",
    ),
    Defect(
        "seed of the draws", "fraexp/study/random_draws.py",
        "([seed, int.from_bytes(name)])", "([int.from_bytes(name)])", "tests/study/test_random_draws.py",
    ),
    Defect(
        "prefix milli", "fraexp/data/units.py", "else value * factor(tail.strip(), unit)",
        "else value / factor(tail.strip(), unit)", "tests/data/test_units.py",
    ),
    Defect(
        "settled from 100 times the tolerance on", "fraexp/kernels/settling.py",
        "(excess, before) > job.", "(excess, before) > 100 * job.", "tests/simulation/test_settling.py",
    ),
    Defect(
        "all tags of a name removed", "fraexp/store/queries/tags.py",
        "delete(tag).where(tag.c.name == name, tag.c.key.in_(chunk))", "delete(tag).where(tag.c.name == name)",
        "tests/store/test_marks.py",
    ),
    Defect(
        "leases of all runs released", "fraexp/store/changes/leases.py",
        'delete(lease).where(lease.c.run == bindparam("number"))', 'delete(lease).where(bindparam("number") >= 0)',
        "tests/store/test_leases.py",
    ),
    Defect(
        "a date that includes the next day", "fraexp/store/queries/filter_sql.py",
        "created < end)", "created <= end + (end - begin))", "tests/store/test_finding.py",
    ),
    Defect(
        "limits that nothing exceeds", "fraexp/measurement/motion_guard.py",
        "growth <= share * allowed", "growth <= 2 * share * allowed", "tests/measurement/test_autonomous.py",
    ),
    Defect(
        "scale of a record's column", "fraexp/records/channels.py",
        'scale = gain if scaled["operator"] == "*" else 1 / gain', "scale = gain",
        "tests/records/test_channel_text.py",
    ),
)  # fmt: skip


@contextmanager
def seeded(tree: Path, defect: Defect) -> Iterator[None]:
    """Put a defect into a worktree, and take it out again; SystemExit if its text is not there exactly once."""
    file = tree / defect.file
    text = file.read_text(encoding="utf-8") if file.exists() else ""
    if (count := text.count(defect.right)) != 1:
        raise SystemExit(f"{defect.file}: {defect.right!r} is there {count} times; the defect must follow the code")
    file.write_text(text.replace(defect.right, defect.wrong), encoding="utf-8")
    try:
        yield
    finally:
        file.write_text(text, encoding="utf-8")


def failure(tree: Path, tests: str, timeout: float = TIMEOUT_S) -> str:
    """Return the first test that fails in a worktree; empty if all pass. SystemExit if there is none to run."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tree), str(tree / "plugins")])}
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "auto", "-p", "no:cacheprovider", *tests.split()]
    try:
        done = subprocess.run(
            command, cwd=tree, env=environment, capture_output=True, text=True, check=False, timeout=timeout
        )
    except subprocess.TimeoutExpired:
        return "tests that do not end"
    if done.returncode not in (0, 1, 2):
        raise SystemExit(f"pytest {tests}: {(done.stdout + done.stderr)[-500:]}")
    lines = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return "" if done.returncode == 0 else (lines or ["an error"])[0].partition(" - ")[0]


def defects(bench: Bench) -> None:
    """The first test that fails with each defect."""
    words = bench.options.only or [""]
    chosen = [each for each in DEFECTS if any(word in each.name for word in words)][:: 5 if bench.reduced else 1]
    with checked_out("HEAD") as tree:
        every = " ".join(sorted({path for defect in chosen for path in defect.tests.split()}))
        if broken := failure(tree, every, TIMEOUT_S * len(chosen)):
            raise SystemExit(f"{broken} fails without any defect")
        for defect in chosen:
            began = time.monotonic()
            with seeded(tree, defect):
                found = failure(tree, defect.tests)
            bench.row(defect.name, f"{found or 'not found'}, {time.monotonic() - began:.0f} s", bool(found))
    print(f"{len(bench.rows) - bench.missed} of {len(bench.rows)} defects found")


if __name__ == "__main__":
    run(__doc__, defects, only=[])
