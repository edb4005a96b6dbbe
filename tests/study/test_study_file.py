"""Studies: what overrides and grids mean, and how what is wrong is said."""

from pathlib import Path

import pytest

from fraexp.errors import FraexpError, StudyError
from fraexp.study.study_file import find_studies, load, packaged_studies
from tests.refusals import refused

HEAD = """
machine = "linear_motor_table"
[excitation]
name = "stepped_sine"
amplitude = 12
[estimator]
name = "effective_input"
"""


def study(registry, folder: Path, text: str, *overrides: str):
    file = folder / "s.toml"
    file.write_text(text, encoding="utf-8")
    return load("s", file, folder, registry, overrides)


def test_points_that_say_the_same_are_one_sweep(registry, tmp_path):
    text = HEAD + '[grid]\n"estimator" = [{ force_scale = 1.0 }, {}, { force_scale = 1.1 }]\n'
    assert len(study(registry, tmp_path, text).sweeps) == 2


CASES = (
    HEAD
    + """
[[case]]
label = "plain"
estimator = { name = "conventional" }
[[case]]
label = "twice, wrong model"
[case.excitation]
amplitude = 24
[case.estimator]
force_scale = 1.1
"""
)


def test_cases_are_laid_over_the_study_as_a_machine_is_under_it(registry, tmp_path):
    plain, twice = study(registry, tmp_path, CASES).sweeps
    assert (plain.labels, twice.labels) == ({"case": "plain"}, {"case": "twice, wrong model"})
    assert plain.estimator["name"] == "conventional"
    assert twice.estimator["name"] == "effective_input"
    assert (twice.estimator["force_scale"], twice.experiment["excitation"]["amplitude"]) == (1.1, 24.0)
    assert plain.experiment["excitation"] == {**twice.experiment["excitation"], "amplitude": 12.0}


def test_cases_come_before_the_grid_which_has_the_last_word(registry, tmp_path):
    text = CASES + '[grid]\n"excitation.amplitude" = [1, 2]\n'
    sweeps = study(registry, tmp_path, text).sweeps
    found = [(sweep.labels["case"], sweep.experiment["excitation"]["amplitude"]) for sweep in sweeps]
    assert found == [("plain", 1), ("plain", 2), ("twice, wrong model", 1), ("twice, wrong model", 2)]


def test_an_axis_of_the_grid_can_be_set(registry, tmp_path):
    text = HEAD + '[grid]\n"excitation.amplitude" = [1, 2, 3]\n"estimator.force_scale" = [0.9, 1.1]\n'
    found = study(registry, tmp_path, text, "grid.excitation.amplitude=[12, 24]", "grid.loop.seed = [1]")
    labels = [sweep.labels for sweep in found.sweeps]
    assert [label["excitation.amplitude"] for label in labels] == [12, 12, 24, 24]
    assert {label["loop.seed"] for label in labels} == {1}
    last = study(registry, tmp_path, text, "grid.excitation.amplitude=[12, 24]", "excitation.amplitude=5")
    assert [sweep.experiment["excitation"]["amplitude"] for sweep in last.sweeps] == [5, 5]


@pytest.mark.parametrize(
    ("override", "names"),
    [
        ("grid.excitation.amplitude=12", ["[12, 75]"]),
        ("grid.excitation.amplitude=[]", ["[12, 75]"]),
        ("grid.excitatio.amplitude=[12]", ["'excitation'"]),
        ("grid=[12]", ["grid"]),
    ],
)
def test_an_axis_that_cannot_be_one_is_refused(registry, tmp_path, override, names):
    with refused(StudyError, *names):
        study(registry, tmp_path, HEAD, override)


def test_an_override_replaces_what_the_cases_say(registry, tmp_path):
    sweeps = study(registry, tmp_path, CASES, "excitation.amplitude=7").sweeps
    assert [sweep.experiment["excitation"]["amplitude"] for sweep in sweeps] == [7.0, 7.0]
    assert [sweep.estimator["name"] for sweep in sweeps] == ["conventional", "effective_input"]


def test_a_study_names_the_kind_of_its_figure(registry, tmp_path):
    assert study(registry, tmp_path, 'figure = "errors"' + HEAD).figure == "errors"
    assert study(registry, tmp_path, HEAD).figure == ""


def test_the_key_depends_on_numbers_and_not_on_how_they_are_written(registry, tmp_path):
    plain = study(registry, tmp_path, HEAD).sweeps[0]
    other = study(registry, tmp_path, HEAD.replace("amplitude = 12", 'amplitude = "12000 mN"\ntitle = 1'[:22])).sweeps[
        0
    ]
    assert plain.key == other.key


def test_the_observer_knows_the_machine_unless_told_otherwise(registry, tmp_path):
    sweep = study(registry, tmp_path, HEAD).sweeps[0]
    assert sweep.estimator["friction"] == sweep.experiment["friction"]
    assert sweep.estimator["input_dead_time"] == 1e-3
    assert sweep.estimator["resolution"] == 1e-7


MOTION = """
machine = "linear_motor_table"
[excitation]
name = "point_to_point"
[estimator]
name = "positioning_metrics"
"""


def test_an_excitation_inherits_what_it_is_not_given(registry, tmp_path):
    motion = study(registry, tmp_path, MOTION).sweeps[0].experiment
    assert motion["excitation"]["plant"] == motion["plant"]
    assert motion["excitation"]["friction"] == motion["friction"]
    assert motion["excitation"]["input_dead_time"] == motion["loop"]["input_dead_time"] == 1e-3
    other = (
        study(registry, tmp_path, MOTION, "plant.rigid_body_gain=0.1", "excitation.input_dead_time=0.0")
        .sweeps[0]
        .experiment
    )
    assert (other["excitation"]["plant"]["rigid_body_gain"], other["excitation"]["input_dead_time"]) == (0.1, 0.0)


def test_a_component_without_a_name_is_laid_over_what_would_be_inherited(registry, tmp_path):
    found = study(registry, tmp_path, MOTION, "excitation.plant.rigid_body_gain=0.177").sweeps[0].experiment
    assert found["excitation"]["plant"] == {**found["plant"], "rigid_body_gain": 0.177}
    assert found["plant"]["rigid_body_gain"] == 0.132
    narrow = "estimator.friction.curve.characteristic_displacement=40e-6"
    sweep = study(registry, tmp_path, HEAD, narrow).sweeps[0]
    friction = sweep.experiment["friction"]
    assert sweep.estimator["friction"] == {
        **friction,
        "curve": {**friction["curve"], "characteristic_displacement": 40e-6},
    }
    method = 'method = { name = "effective_input", friction = { curve = { characteristic_displacement = 40e-6 } } }'
    nested = study(
        registry, tmp_path, HEAD.replace('name = "effective_input"', f'name = "modal_fit"\n{method}')
    ).sweeps[0]
    assert nested.estimator["method"]["friction"]["curve"] == {
        **friction["curve"],
        "characteristic_displacement": 40e-6,
    }


def test_another_component_is_laid_over_nothing(registry, tmp_path):
    without = study(registry, tmp_path, MOTION, 'excitation.friction={name = "none"}').sweeps[0].experiment
    assert without["excitation"]["friction"]["name"] == "none"
    assert without["friction"]["name"] == "rolling"
    preset = study(registry, tmp_path, HEAD, 'estimator.friction={name = "rolling", preset = "linear_motor_table"}')
    assert preset.sweeps[0].estimator["friction"]["curve"]["coulomb_force"] == 17.9


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("estimater = 1", ["'estimater'", "'estimator'"]),
        (HEAD.replace("amplitude", "amplitud"), ["stepped_sine", "'amplitud'", "'amplitude'"]),
        (HEAD.replace("= 12", "= -1"), ["amplitude", "0 N"]),
        (HEAD.replace("= 12", "= nan"), ["amplitude"]),
        (HEAD.replace("= 12", '= "12 mm"'), ["amplitude", "'mm'", "'N'"]),
        (HEAD.replace("= 12", "= true"), ["amplitude", "true"]),
        (HEAD.replace("amplitude = 12", "points = 1e9"), ["points", 1000000000]),
        (HEAD.replace("stepped_sine", "steped_sine"), ["'steped_sine'", "'stepped_sine'"]),
        (HEAD.replace("linear_motor_table", "linear_motor"), ["'linear_motor'", "'linear_motor_table'"]),
        (HEAD + "[loop]\ninput_time_constants = [0.0]", ["[loop]", "lag"]),
        (HEAD + '[grid]\n"excitation.amplitude" = []', ["excitation.amplitude"]),
        (HEAD + f'[grid]\n"loop.seed" = {[1] * 2000}\n"excitation.amplitude" = {[1] * 2000}', ["4,000,000"]),
        (HEAD + "[[case]]\nestimator = {}", ["[[case]] number 1", "'label'"]),
        (HEAD + '[[case]]\nlabel = "a"\n' * 2, ["number 2", "case 'a'"]),
        (HEAD + '[case]\nlabel = "a"', ["[[case]]"]),
        (HEAD + '[[case]]\nlabel = "a"\nloop = 1', ["case 'a'", "loop", "[loop]"]),
        (HEAD + '[[case]]\nlabel = "a"\nloop.noise = -1', ["case 'a'", "[loop]", "loop.noise", -1]),
        ('figure = "bod"' + HEAD, ["'bod'", "'bode'"]),
        (HEAD.replace("amplitude = 12", "amplitude = 12\nmax_frequency = 1e6"), ["Nyquist", "1000 Hz"]),
        (HEAD.replace("amplitude = 12", "amplitude = 12\nmin_frequency = 1e-9"), ["samples"]),
        ("x = " + "[" * 3000 + "]" * 3000, ["TOML"]),
        ("x = " + "9" * 5000, ["TOML"]),
        ('title = "no machine"\n[estimator]\nname = "effective_input"', ["friction"]),
    ],
)  # fmt: skip
def test_what_is_wrong_is_one_sentence_with_its_place(registry, tmp_path, text, names):
    with refused(FraexpError, "s.toml", *names):
        study(registry, tmp_path, text)


COMING_ALONG = sorted(
    path.relative_to(packaged_studies()).with_suffix("").as_posix()
    for path in packaged_studies().rglob("*.toml")
    if path.parent.name != "machines"
)


@pytest.mark.parametrize("name", COMING_ALONG)
def test_every_study_that_comes_along_is_sound_and_says_what_it_asks(registry, tmp_path, name):
    ((found, file),) = find_studies(name, tmp_path)
    loaded = load(found, file, tmp_path, registry)
    assert loaded.sweeps
    assert loaded.title != name
    assert "?" in loaded.question


def test_a_byte_order_mark_is_no_error_and_another_coding_is(registry, tmp_path):
    file = tmp_path / "s.toml"
    file.write_bytes(b"\xef\xbb\xbf" + HEAD.encode())
    assert len(load("s", file, tmp_path, registry).sweeps) == 1
    file.write_bytes("title = 'µ'".encode("latin-1"))
    with refused(StudyError, file, "UTF-8"):
        load("s", file, tmp_path, registry)


def test_studies_are_found_by_name_path_and_folder(tmp_path):
    (tmp_path / "studies" / "mine").mkdir(parents=True)
    (tmp_path / "studies" / "mine" / "a.toml").write_text("", encoding="utf-8")
    (tmp_path / "studies" / "loop").symlink_to(tmp_path / "studies" / "loop")
    assert find_studies("mine/a", tmp_path)[0][0] == "mine/a"
    assert [name for name, _ in find_studies("mine", tmp_path)] == ["mine/a"]
    assert find_studies("quick", tmp_path)[0][0] == "quick"  # comes along
    with refused(StudyError, "'minee'", "'mine/a'"):
        find_studies("minee", tmp_path)


def test_a_name_that_may_mean_two_files_of_a_workspace_is_refused(tmp_path):
    """The terminal UI lists the second one; a measurement of the first one would move another axis."""
    (tmp_path / "studies").mkdir()
    for folder in (tmp_path, tmp_path / "studies"):
        (folder / "axis.toml").write_text("", encoding="utf-8")
    with refused(StudyError, "'axis'", tmp_path / "axis.toml", tmp_path / "studies/axis.toml"):
        find_studies("axis", tmp_path)
    assert find_studies("axis.toml", tmp_path)[0][1] == tmp_path / "axis.toml"
    assert find_studies("studies/axis", tmp_path)[0][1] == tmp_path / "studies" / "axis.toml"
