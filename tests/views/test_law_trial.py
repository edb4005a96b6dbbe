"""The trial of a friction law: its numbers, its faults, and that a study gives the same."""

import numpy as np
import pytest

from fraexp.components.registry import discover
from fraexp.errors import FraexpError
from fraexp.store import Store
from fraexp.views.entries import apply_texts, example_spec, parameter_entries, without_defaults
from fraexp.views.law_trial import STEPS_PER_PERIOD, TRIAL_STUDY, SineMotion, SineTrial, trial_overrides
from fraexp.workspace.workspace_service import WorkspaceService
from tests.examples import thorough
from tests.refusals import refused
from tests.tui.test_plugins import LAW, drop

LUGRE = {"name": "lugre", "preset": "linear_motor_table"}
DAHL = {"name": "dahl", "stiffness": 3.9e5, "coulomb_force": 17.9, "viscous_coefficient": 20.0}


def test_an_ideal_element_has_its_describing_function_of_the_textbook(registry):
    """K = Y = 1 at an amplitude of 2 µm, in units of 1 µm: 0.5 + j/π (Gelb and Vander Velde 1968)."""
    spec = {"name": "rolling", "stiffness": [1e6], "limit_force": [1.0]}
    trial = SineTrial(spec, SineMotion(amplitude=2e-6), registry)
    assert trial.loop().describing_function / 1e6 == pytest.approx(0.5 + 1j / np.pi, abs=2e-3)
    assert trial.loop().energy == pytest.approx(4e-6, rel=1e-3)  # 4 Fc (A - Y)
    amplitudes, values = trial.describing_function()
    assert amplitudes[0] < 1e-6
    assert values[0] / 1e6 == pytest.approx(1.0)  # stuck: a spring


def test_viscous_friction_is_part_of_the_force(registry):
    trial = SineTrial({"name": "none", "viscous_coefficient": 3.0}, SineMotion(amplitude=1e-3, frequency=2.0), registry)
    assert trial.loop().describing_function == pytest.approx(1j * 2 * np.pi * 2.0 * 3.0, rel=1e-3)


@pytest.mark.thorough
@pytest.mark.parametrize("spec", [DAHL, pytest.param(LUGRE, marks=pytest.mark.thorough)])
def test_the_study_at_the_top_gives_the_same_loop(tmp_path, spec):
    workspace, sine = WorkspaceService.open(tmp_path), SineMotion(amplitude=5e-5, frequency=2.0)
    loop = SineTrial(spec, sine, workspace.registry).loop()
    for _ in workspace.run([TRIAL_STUDY], "serial", trial_overrides(spec, sine)):
        pass
    with Store.open(workspace.database, read_only=True) as store:
        (row,) = store.page().rows
        (curve,) = store.result(row.key).curves
        metrics = {metric.name: metric.value for metric in store.result(row.key).metrics}
    times = np.arange(STEPS_PER_PERIOD) / STEPS_PER_PERIOD
    stored = np.interp(
        times, np.arange(curve.columns["force"].size) / curve.columns["force"].size, curve.columns["force"]
    )
    assert np.max(np.abs(stored - loop.force)) < 2e-3 * np.max(np.abs(stored))
    assert loop.describing_function.real == pytest.approx(metrics["describing function, real"], rel=1e-3)
    assert loop.describing_function.imag == pytest.approx(metrics["describing function, imaginary"], rel=1e-3)
    assert loop.energy == pytest.approx(metrics["energy per cycle"], rel=1e-3)


def test_every_friction_model_has_values_to_begin_with(registry):
    for name in registry.names("friction"):
        component = registry.provider("friction", name).component
        base = example_spec(component, registry)
        lines = list(parameter_entries(component, base, registry))
        assert lines or not component.model_fields
        again = apply_texts(base, {line.path: line.text for line in lines})
        assert registry.create("friction", again) == registry.create("friction", base)
        short = without_defaults(component, again, registry)
        assert registry.create("friction", short) == registry.create("friction", base)
        assert SineTrial(short, SineMotion(), registry).loop().is_periodic


def test_numbers_move_by_a_share_and_stay_within_their_bounds(registry):
    component = registry.provider("friction", "rolling").component
    lines = {one.path: one for one in parameter_entries(component, example_spec(component, registry), registry)}
    assert lines["curve.coulomb_force"].next_text("17.9", 0.05) == "18.79"
    assert lines["curve.coulomb_force"].next_text("18.795", -0.05) == "17.9"
    assert lines["curve.characteristic_displacement"].next_text("45 um", 0.05) == "47.25 um"
    assert lines["curve.elements"].next_text("1", -0.05) == "1"
    assert lines["curve.elements"].next_text("20", 0.05) == "21"
    assert lines["curve.shape"].next_text("exponential", 0.05) == "hyperbolic"
    assert lines["curve.shape"].next_text("exponential", -0.05) == "table"
    assert lines["viscous_coefficient"].next_text("0", 0.05) == "0.5"
    assert lines["viscous_coefficient"].next_text("0", -0.05) == "0"
    assert lines["curve.characteristic_displacement"].next_text("half", 0.05) == "half"


@pytest.mark.parametrize(
    ("line", "names"),
    [
        ("return math.nan", ["mine.py", "line", "nan"]),
        thorough("return 1 / (dy - dy)", ["mine.py", "line", "dy"]),
        thorough("return float('nan') if abs(z[0]) > 0.5 else z_next[0]", ["nan N"]),
        thorough("return [][1] if abs(z[0]) > 0.5 else z_next[0]", ["IndexError"]),
    ],
)
def test_a_law_that_raises_or_gives_no_number_is_told_in_one_line(tmp_path, line, names):
    text = LAW.format(stiffness=1e5).replace("return z_next[0]", line).replace("\nfrom", "\nimport math\nfrom", 1)
    drop(tmp_path, text.replace("min(max(z[0] + stiffness * dy, -1.0), 1.0)", "z[0] + stiffness * dy"))
    with refused(FraexpError, *names):
        # small to be rehearsed without reaching far
        SineTrial({"name": "mine", "stiffness": 0.4}, SineMotion(amplitude=2.0), discover(tmp_path / "plugins")).loop()


def test_a_law_that_takes_too_long_is_left_to_the_compiler(registry, monkeypatch):
    monkeypatch.setattr("fraexp.views.law_trial.MAX_TRIAL_TIME_S", 0.0)
    with refused(FraexpError, "Python", "study"):
        SineTrial(DAHL, SineMotion(), registry).loop()
