"""Studies: what overrides and grids mean, and how what is wrong is said."""

from pathlib import Path

import pytest

from fraexp.errors import FraexpError, StudyError
from fraexp.study import find_studies, load

HEAD = """
machine = "linear_motor_table"
[excitation]
name = "stepped_sine"
amplitude = 12
[estimator]
name = "proposed"
"""


def study(registry, folder: Path, text: str, *overrides: str):
    file = folder / "s.toml"
    file.write_text(text, encoding="utf-8")
    return load("s", file, folder, registry, overrides)


def test_the_grid_multiplies(registry, tmp_path):
    text = HEAD + '[grid]\n"excitation.amplitude" = [1, 2, 3]\n"estimator.force_scale" = [0.9, 1.1]\n'
    sweeps = study(registry, tmp_path, text).sweeps
    assert len(sweeps) == 6
    assert len({sweep.experiment_key for sweep in sweeps}) == 3
    assert sweeps[0].labels == {"excitation.amplitude": 1, "estimator.force_scale": 0.9}


def test_points_that_say_the_same_are_one_sweep(registry, tmp_path):
    text = HEAD + '[grid]\n"estimator" = [{ force_scale = 1.0 }, {}, { force_scale = 1.1 }]\n'
    assert len(study(registry, tmp_path, text).sweeps) == 2


def test_an_override_replaces_the_axis_of_the_grid(registry, tmp_path):
    text = HEAD + '[grid]\n"excitation.amplitude" = [1, 2, 3]\n'
    sweeps = study(registry, tmp_path, text, "excitation.amplitude=7").sweeps
    assert [sweep.experiment["excitation"]["amplitude"] for sweep in sweeps] == [7.0]


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


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("estimater = 1", "there is no section or key 'estimater'; did you mean 'estimator'?"),
        (HEAD + "[loops]", "there is no section or key 'loops'; did you mean 'loop'?"),
        (HEAD.replace("amplitude", "amplitud"), "stepped_sine has no parameter 'amplitud'; did you mean 'amplitude'?"),
        (HEAD.replace("= 12", "= -1"), "the amplitude A must be above 0 N"),
        (HEAD.replace("= 12", "= nan"), "amplitude"),
        (HEAD.replace("= 12", '= "12 mm"'), "amplitude: 'mm' is not a unit of the same kind as 'N'"),
        (HEAD.replace("= 12", '= "12 frobs"'), "amplitude: 'frobs' is no known unit"),
        (HEAD.replace("= 12", "= true"), "amplitude is True; expected a number"),
        (HEAD.replace("stepped_sine", "steped_sine"), "no excitation is called 'steped_sine'; did you mean"),
        (HEAD.replace("linear_motor_table", "linear_motor"), "there is no machine 'linear_motor'; did you mean"),
        (HEAD + "[loop]\ninput_lags = [0.0]", "lag"),
        (HEAD + '[grid]\n"excitation.amplitude" = []', "expected a list"),
        (HEAD + '[grid]\n"excitatio.amplitude" = [1]', "leads nowhere; did you mean 'excitation'?"),
        (HEAD + f'[grid]\n"loop.seed" = {[1] * 2000}\n"excitation.amplitude" = {[1] * 2000}', "4,000,000"),
        (HEAD.replace("amplitude = 12", "amplitude = 12\nhighest = 1e6"), "the Nyquist frequency is 1000 Hz"),
        (HEAD.replace("amplitude = 12", "amplitude = 12\nlowest = 1e-9"), "samples per period"),
        ("x = " + "[" * 3000 + "]" * 3000, "TOML"),
        ("x = " + "9" * 5000, "TOML"),
        ('title = "no machine"\n[estimator]\nname = "proposed"', "friction"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_one_sentence_with_its_place(registry, tmp_path, text, sentence):
    with pytest.raises(FraexpError) as caught:
        study(registry, tmp_path, text)
    said = str(caught.value)
    assert sentence in said
    assert "s.toml" in said
    assert "\n" not in said


def test_a_byte_order_mark_is_no_error_and_another_coding_is(registry, tmp_path):
    file = tmp_path / "s.toml"
    file.write_bytes(b"\xef\xbb\xbf" + HEAD.encode())
    assert len(load("s", file, tmp_path, registry).sweeps) == 1
    file.write_bytes("title = 'µ'".encode("latin-1"))
    with pytest.raises(StudyError, match="no text in UTF-8"):
        load("s", file, tmp_path, registry)


def test_studies_are_found_by_name_path_and_folder(tmp_path):
    (tmp_path / "studies" / "mine").mkdir(parents=True)
    (tmp_path / "studies" / "mine" / "a.toml").write_text("", encoding="utf-8")
    (tmp_path / "studies" / "loop").symlink_to(tmp_path / "studies" / "loop")
    assert find_studies("mine/a", tmp_path)[0][0] == "mine/a"
    assert [name for name, _ in find_studies("mine", tmp_path)] == ["mine/a"]
    assert find_studies("quick", tmp_path)[0][0] == "quick"  # comes along
    with pytest.raises(StudyError, match="there is no study 'minee'; did you mean"):
        find_studies("minee", tmp_path)
