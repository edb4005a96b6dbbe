"""Flip bits in databases: nothing changed is shown, exported or merged as sound (`tests/store/flipped_bits.py`).

    python benchmarks/flipped_bits.py                    200 databases
    python benchmarks/flipped_bits.py --databases 20 --seed 1 --keep FOLDER
    python benchmarks/flipped_bits.py --base FILE        of another database than one of real studies

`--keep` keeps the copies with a finding.
"""

import shutil
import sys
import tempfile
from pathlib import Path

from harness import ROOT, Bench, run

sys.path.insert(0, str(ROOT))
from fraexp.store import Store
from tests.store.flipped_bits import FINDINGS, attack, command

STUDIES = ("quick", "record", "friction/hysteresis", "identification/friction_viscous")


def databases(bench: Bench) -> None:
    """What came of each database, and findings."""
    with tempfile.TemporaryDirectory() as folder:
        base = Path(folder) / "base.db"
        if bench.options.base:
            shutil.copyfile(bench.options.base, base)
        else:
            make_base(base)
        keep = Path(bench.options.keep) if bench.options.keep else None
        found = attack(base, bench.options.databases, bench.seed, Path(folder), keep)
    for name, count in found.items():
        bench.row(name, f"{count:5}", name not in FINDINGS or not count)


def make_base(file: Path) -> None:
    """Run real studies, one of them twice, and tag some of their sweeps."""
    for study in (*STUDIES, STUDIES[0]):
        code, text = command(["run", study, "--workspace", str(ROOT), "--db", str(file), "--executor", "serial"])
        if code:
            raise SystemExit(f"{study}: {text.splitlines()[-1]}")
    with Store.open(str(file)) as store:
        keys = store.keys()
        store.tag(keys[::3], "baseline")


if __name__ == "__main__":
    run(__doc__, databases, databases=(200, 5), base="", keep="")
