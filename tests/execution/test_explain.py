"""Why a sweep is computed: what is compared with what."""

from pathlib import Path

from fraexp.components.registry import Registry
from fraexp.data.results import Outcome, Result
from fraexp.data.sweep import Sweep
from fraexp.execution.explain import reasons
from fraexp.store import Store


def sweep(number: int) -> Sweep:
    return Sweep({"source": "loop", "plant": {"name": "modal", "x": number}}, {"name": "conventional", "version": 1})


def texts(folder: Path, registry: Registry, stored: Sweep) -> list[str]:
    with Store.open(str(folder / "results.db"), create=True) as store:
        run = store.begin_run("study", "f", "c", {}, [stored])
        store.save(run, [(stored, Result(Outcome.OK), {})])
        return [why.reason for why in reasons([sweep(2)], {}, (), {}, store, "study", registry)]


def test_a_new_sweep_is_compared_with_the_nearest_stored_one(tmp_path: Path, registry: Registry) -> None:
    (text,) = texts(tmp_path, registry, sweep(1))
    assert text.startswith("plant.x = 2, stored 1")
