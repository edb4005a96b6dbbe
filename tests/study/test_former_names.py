"""Former names: a study that uses them gives the sweeps, labels and keys that today's names give, and one warning."""

from pathlib import Path
from typing import Any

import pytest

from fraexp.components.registry import Registry, discover
from fraexp.errors import FormerNameWarning, FraexpError
from fraexp.study.study_file import ResolvedStudy, load

PLUGIN = """
from fraexp.api import FrictionModel, hookimpl, param


class Spring(FrictionModel, name="coil", version=1):
    former_names = ("spring",)
    renamed = {"k": "stiffness"}
    states = ("force [N]",)
    stiffness: float = param("N/m", "stiffness", 1e4, above=0)

    @staticmethod
    def advance(z, dy, dt, z_next, stiffness):
        z_next[0] = z[0] + stiffness * dy
        return z_next[0]


@hookimpl
def fraexp_components():
    return [Spring]
"""
STUDY = """
machine = "linear_motor_table"
[excitation]
name = "stepped_sine"
amplitude = 12
frequencies = [20, 40]
[friction]
name = "{coil}"
{stiffness} = 2e4
[estimator]
name = "effective_input"
friction = {{ name = "{coil}" }}
[[case]]
label = "stiff"
friction = {{ {stiffness} = 3e4 }}
[[case]]
label = "believed"
estimator = {{ friction = {{ {stiffness} = 4e4 }} }}
[grid]
"estimator.friction.{stiffness}" = [1e4, 2e4]
"loop.noise" = [1e-7, 2e-7]
[{monte_carlo}]
count = 2
draw = [{{ paths = "friction.{stiffness}", relative = 0.1 }}, {{ paths = "plant.damping_ratios.0", {std} = 0.001 }}]
[[{published}]]
what = "a number"
value = 1
compare = "above"
metric = "k0"
where = {{ case = "stiff", "estimator.friction.{stiffness}" = 1e4, "draw" = 1, "loop.noise" = 1e-7 }}
"""
TODAY = {"coil": "coil", "stiffness": "stiffness", "monte_carlo": "monte_carlo", "published": "published", "std": "std"}
FORMER = {"coil": "spring", "stiffness": "k", "monte_carlo": "random", "published": "printed", "std": "deviation"}


@pytest.fixture
def coil(tmp_path: Path) -> Registry:
    (tmp_path / "plugins").mkdir()
    (tmp_path / "plugins" / "coil.py").write_text(PLUGIN, encoding="utf-8")
    return discover(tmp_path / "plugins")


def study(folder: Path, registry: Registry, words: dict[str, str], *overrides: str) -> ResolvedStudy:
    file = folder / "study.toml"
    file.write_text(STUDY.format(**words), encoding="utf-8")
    return load("study", file, folder, registry, overrides)


@pytest.mark.parametrize("word", FORMER)
def test_a_former_name_gives_the_same_sweeps_and_one_warning(word: str, tmp_path: Path, coil: Registry) -> None:
    today = study(tmp_path, coil, TODAY)
    with pytest.warns(FormerNameWarning, match=FORMER[word]) as told:
        before = study(tmp_path, coil, TODAY | {word: FORMER[word]})
    assert len(told) == 1
    assert "study.toml" in str(told[0].message)
    assert [sweep.key for sweep in before.sweeps] == [sweep.key for sweep in today.sweeps]
    assert [sweep.labels for sweep in before.sweeps] == [sweep.labels for sweep in today.sweeps]
    assert before.published == today.published


@pytest.mark.parametrize(
    ("former", "now"),
    [
        ("friction.k=5e4", "friction.stiffness=5e4"),
        ("grid.estimator.friction.k=[1e4, 3e4]", "grid.estimator.friction.stiffness=[1e4, 3e4]"),
        ("random.count=3", "monte_carlo.count=3"),
        ("friction.name=spring", "friction.name=coil"),
    ],
)
def test_the_command_line_takes_former_names(former: str, now: str, tmp_path: Path, coil: Registry) -> None:
    published: dict[str, Any] = TODAY
    with pytest.warns(FormerNameWarning, match="--set"):
        before = study(tmp_path, coil, published, former)
    today = study(tmp_path, coil, published, now)
    assert [(sweep.key, sweep.labels) for sweep in before.sweeps] == [
        (sweep.key, sweep.labels) for sweep in today.sweeps
    ]


def test_both_names_at_once_are_refused(tmp_path: Path, coil: Registry) -> None:
    file = tmp_path / "both.toml"
    file.write_text(STUDY.format(**TODAY).replace("stiffness = 2e4", "stiffness = 2e4\nk = 1e4"), encoding="utf-8")
    with pytest.raises(FraexpError, match="'k' is now called 'stiffness', and both are given"):
        load("both", file, tmp_path, coil)


def test_stored_data_with_former_names_builds_the_component(coil: Registry) -> None:
    built = coil.create("friction", {"name": "spring", "version": 1, "k": 5.0})
    assert built.spec() == {"name": "coil", "version": 1, "stiffness": 5.0}
