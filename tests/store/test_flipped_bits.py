"""Databases with flipped bits; `benchmarks/flipped_bits.py` damages 200 databases of real studies."""

from pathlib import Path

import pytest

from fraexp.store import Store
from tests.cli.conftest import fill
from tests.store.flipped_bits import FINDINGS, attack

DATABASES = 10
SEED = 20261123


@pytest.fixture
def base(tmp_path: Path) -> Path:
    """A small database with all that is stored, and with two runs of the same sweep."""
    sweeps = fill(tmp_path / "base.db")
    with Store.open(str(tmp_path / "base.db")) as store:
        keys = store.keys()
        store.tag(keys[:2], "baseline")
        run = store.begin_run("again", "studies/bench.toml", "fraexp run again", {}, [sweeps[3], sweeps[0]])
        store.reuse(run, [sweeps[3].key, sweeps[0].key])
        store.end_run(run, "complete")
    return tmp_path / "base.db"


@pytest.mark.thorough
def test_nothing_changed_is_shown_as_sound(base: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = attack(base, DATABASES, SEED, base.parent)
    assert not any(found[kind] for kind in FINDINGS), capsys.readouterr().out
