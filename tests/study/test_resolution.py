"""Sweeps of a grid are those of its points, one by one: what they share is resolved once and changes no key."""

import hashlib
import itertools
from pathlib import Path
from typing import Any

import pytest

from fraexp.components.registry import discover
from fraexp.data.sweep import Section, Sweep
from fraexp.errors import FraexpError
from fraexp.study.paths import unit_at
from fraexp.study.study_file import resolve
from tests.refusals import refused

FILE = Path("study.toml")
BASE: dict[str, Any] = {
    "machine": "linear_motor_table",
    "excitation": {"name": "stepped_sine", "amplitude": 15.0, "frequencies": [20.0, 40.0]},
    "estimator": {"name": "conventional"},
}
AXES: dict[str, list[Any]] = {
    "estimator": [
        {"name": "conventional"},
        {"name": "effective_input"},
        {"name": "effective_input", "force_scale": 0.5},
    ],
    "plant.rigid_body_gain": [0.1, 0.132],
    "excitation.amplitude": [12, "20 N", 12.0],
    "friction.viscous_coefficient": [4.0, 5.0],
    "loop.sample_time": [5e-4, "1 ms"],
    "excitation.settling_timeout": [1.0, 2.0],
    "limits": [{"force": 100.0}, {"force": 1000.0}],
    "compensation": [{"gain": 0.5}, {"gain": 0.0}],
    "accuracy": [{"magnitude": 1.0}, {"phase": "2 deg"}],
}


def sweeps_of(data: dict[str, Any], overrides: list[str] | tuple[str, ...] = ()) -> Any:
    return resolve("study", FILE, data, Path(), REGISTRY, overrides).sweeps


REGISTRY = discover()


@pytest.mark.parametrize(
    "paths",
    [
        *itertools.permutations(("estimator", "plant.rigid_body_gain", "excitation.amplitude")),
        *itertools.combinations(AXES, 2),
    ],
)
def test_a_grid_gives_the_sweeps_of_its_points(paths: tuple[str, ...]) -> None:
    grid = {path: AXES[path] for path in paths}
    singles: dict[str, Any] = {}
    for values in itertools.product(*grid.values()):
        point = {path: [value] for path, value in zip(grid, values, strict=True)}
        (one,) = sweeps_of({**BASE, "grid": point})
        singles.setdefault(one.key, one)
    found = sweeps_of({**BASE, "grid": grid})
    assert [sweep.key for sweep in found] == list(singles)
    for sweep, single in zip(found, singles.values(), strict=True):
        assert (sweep.experiment, sweep.estimator, sweep.labels) == (single.experiment, single.estimator, single.labels)
        assert list(sweep.experiment) == list(single.experiment)
        assert sweep.key == Sweep(dict(sweep.experiment), dict(sweep.estimator)).key


def test_a_point_that_does_not_fit_is_found_wherever_it_stands() -> None:
    for path, values in {"excitation.amplitude": [12, 20, -3], "excitation.frequencies": [[20.0], [1500.0]]}.items():
        for other in ("plant.rigid_body_gain", "estimator"):
            for grid in ({path: values, other: AXES[other]}, {other: AXES[other], path: values}):
                with refused(FraexpError, "study.toml", "[excitation]"):
                    sweeps_of({**BASE, "grid": grid})
    with refused(FraexpError, "limits.force", "15 N"):
        sweeps_of({**BASE, "limits": {"force": 15.0}, "grid": {"excitation.amplitude": [12, 20]}})


def test_a_key_is_the_hash_of_its_sections_hashes() -> None:
    def digest(content: bytes) -> bytes:
        return hashlib.blake2b(content, digest_size=20).digest()

    one, other, estimator = {"x": [1.5, "é"]}, {"b": 1, "a": None}, {"name": "e"}
    experiment = digest(
        b'["loop",["excitation","plant"]]' + digest(b'{"a":null,"b":1}') + digest(b'{"x":[1.5,"\\u00e9"]}')
    )
    for plant in (one, Section(one)):
        sweep = Sweep({"source": "loop", "plant": plant, "excitation": other}, estimator)
        assert sweep.experiment_key == f"fx2-{experiment.hex()}"
        assert sweep.key == "fx2-" + digest(experiment + digest(b'{"name":"e"}')).hex()


def test_whatever_differs_gives_another_key() -> None:
    def key(source: str = "loop", **sections: Any) -> str:
        return Sweep({"source": source, "plant": {"x": 1}, "friction": {}} | sections, {"name": "e"}).key

    others = [key("drive"), key(plant={"x": 2}), key(plant={}, friction={"x": 1}), key(loop={}), key(plant={"x": "1"})]
    assert len({key(), *others}) == len(others) + 1


def test_a_dependence_on_the_position_is_a_parameter_of_any_friction_model() -> None:
    cogging = [{"period": "16 mm", "amplitude": 4}]
    axis = {"friction.position_dependence.start": ["1 mm", 0.002]}
    positioned = {**BASE, "friction": {"position_dependence": {"cogging": cogging}}, "grid": axis}
    found = list(sweeps_of({**positioned, "estimator": {"name": "effective_input"}}))
    for sweep, start in zip(found, (0.001, 0.002), strict=True):
        for friction in (sweep.experiment["friction"], sweep.estimator["friction"]):  # the observer's is the machine's
            assert friction["name"] == "rolling"
            assert friction["position_dependence"]["start"] == start
            assert friction["position_dependence"]["cogging"] == [{"period": 0.016, "amplitude": 4.0, "phase": 0.0}]
        assert unit_at(sweep.experiment, "friction.position_dependence.cogging.0.amplitude", REGISTRY) == "N"
    (plain,) = sweeps_of(BASE)
    assert "position_dependence" not in plain.experiment["friction"]


def test_a_path_leads_to_one_of_several_controllers() -> None:
    base = {**BASE, "machine": "gantry_two_loops"}
    (sweep,) = sweeps_of(base, ["controller.right.derivative_time=40 ms"])
    left, right = (sweep.experiment["controller"][name] for name in ("left", "right"))
    assert (left["derivative_time"], right["derivative_time"]) == (0.05, 0.04)
    with refused(FraexpError, "study.toml", "[controller.middle]", "'middle'", "right"):
        sweeps_of({**base, "controller": {"middle": left}})
    with refused(FraexpError, "left, right"):
        sweeps_of({**base, "limits": {"force": 100.0}})
    with refused(FraexpError, "loop_tuning", "left, right"):
        sweeps_of({**base, "estimator": {"name": "loop_tuning", "friction": {"name": "none"}}})


def test_a_dependence_on_the_position_belongs_to_one_of_several_contacts() -> None:
    (found,) = sweeps_of(
        {**BASE, "machine": "two_mass_drive"}, ["friction.load.position_dependence.ripples=[{period=1,amplitude=0.1}]"]
    )
    assert "position_dependence" in found.experiment["friction"]["load"]
    assert "position_dependence" not in found.experiment["friction"]["motor"]
