from fraexp.components.registry import Registry
from fraexp.figures.elements.labels import curve_names, drawable, label_text, label_texts
from fraexp.study.paths import label_units


def test_figures_show_names_as_words_and_symbols_as_they_are() -> None:
    texts = {
        "effective_input, 12 N": "effective input, 12 N",
        "h1_h2_hv": "H1 H2 Hv",
        "gms, friction_identification": "GMS, friction identification",
        "Lugre [1]": "LuGre [1]",
        "runs/dahl.csv": "runs/dahl.csv",
        "proposed, ΣF_m + 10 %": "proposed, ΣF_m + 10 %",
        "table_stepped_sine.csv": "table_stepped_sine.csv",
        "damping_ratios.0 0.05": "damping ratios.0 0.05",
        "5 um": "5 µm",
        "_hidden": " _hidden",
    }
    assert {text: drawable(text) for text in texts} == texts


def test_names_hold_what_varies_and_nothing_else() -> None:
    labels = [
        {"estimator": "conventional", "excitation.amplitude": 12.0, "loop.noise": 0.0},
        {"estimator": {"name": "proposed"}, "excitation.amplitude": 75.0, "loop.noise": 0.0},
    ]
    assert curve_names(labels, ["a", "b"]) == ["conventional, amplitude 12", "proposed, amplitude 75"]


def test_parameters_have_their_symbols_and_items_of_lists_count_from_one() -> None:
    labels = {"plant.damping_ratios.0": 0.05, "plant.modal_gain_ratios.1": 0.5, "plant.gain": 0.1}
    others = {path: 2 * value for path, value in labels.items()}
    assert curve_names([labels, others], ["", ""], {"plant.gain": "m/(N s^2)"})[0] == (
        "damping ratio ζ_1 0.05, modal_gain_ratios 2 0.5, 0.1 m/(N s²)"
    )
    assert curve_names([{"compensation.gain": 0.5}, {"compensation.gain": 0.9}], ["", ""])[0] == "gain α = 0.5"
    both = {"plant.frequencies.0": 39.0, "estimator.frequencies.0": 40.0}
    assert curve_names([both], [""])[0] == "plant frequencies 1 39, estimator frequencies 1 40"


def test_friction_laws_are_proper_names() -> None:
    laws = [{"friction": {"name": name}} for name in ("rolling", "lugre", "none")]
    assert [drawable(name) for name in curve_names(laws, [""] * 3)] == ["Rolling", "LuGre", "no friction"]


def test_a_number_with_a_unit_needs_no_title() -> None:
    labels = [{"estimator.name": name, "excitation.amplitude": 12} for name in ("conventional", "proposed")]
    labels[1]["excitation.amplitude"] = 75.0
    assert curve_names(labels, ["a", "b"], {"excitation.amplitude": "N"}) == ["conventional, 12 N", "proposed, 75 N"]
    strokes = [{"excitation.amplitude": 25e-6}, {"excitation.amplitude": 2.5e-3}]
    assert curve_names(strokes, ["a", "b"], {"excitation.amplitude": "m"}) == ["25 µm", "2.5 mm"]
    forces = [{"a.first": 1, "a.second": 2}, {"a.first": 2, "a.second": 1}]
    assert curve_names(forces, ["a", "b"], {"a.first": "N", "a.second": "N"})[0] == "first 1 N, second 2 N"


def test_units_are_those_that_the_components_declare(registry: Registry) -> None:
    labels = {
        "excitation.amplitude": 12,
        "estimator.name": "effective_input",
        "estimator.friction.viscous_coefficient": 1.0,
    }
    sections = {
        "excitation": {"name": "stepped_sine"},
        "estimator": {"name": "effective_input", "friction": {"name": "rolling"}},
    }
    assert label_units([({**labels, "loop.seed": 3, "x": 1}, sections)], registry) == {
        "excitation.amplitude": "N",
        "estimator.friction.viscous_coefficient": "N s/m",
    }


def test_one_curve_keeps_its_labels_and_an_unlabelled_one_gets_its_key() -> None:
    assert curve_names([{"estimator": "H1"}], ["3f9c"]) == ["H1"]
    assert curve_names([{}, {}], ["3f9c", "81aa"]) == ["3f9c", "81aa"]


def test_equal_names_are_told_apart() -> None:
    assert curve_names([{"a.x": 1}, {"a.x": 1}], ["3f9c", "81aa"]) == ["x 1 (3f9c)", "x 1 (81aa)"]


def test_components_of_one_name_are_told_apart_by_what_differs() -> None:
    rolling = {"name": "rolling", "coulomb": 17.9}
    found = [
        {"name": "proposed", "friction": rolling, "hold": True},
        {"name": "proposed", "friction": {"name": "lugre", "stiffness": 1e5}, "hold": True},
        {"name": "conventional", "hold": False},
    ]
    texts = ["proposed (friction rolling)", "proposed (friction lugre)", "conventional"]
    assert label_texts(found) == texts
    assert curve_names([{"estimator": value} for value in found], ["a", "b", "c"]) == texts
    assert label_text(found[0]) == "proposed"


def test_nested_components_of_one_name_are_told_apart_too() -> None:
    estimators = [{"name": "proposed", "friction": {"name": "rolling", "coulomb": force}} for force in (17.9, 20.0)]
    assert label_texts(estimators) == [
        "proposed (friction rolling (coulomb 17.9))",
        "proposed (friction rolling (coulomb 20))",
    ]
    assert label_texts(["proposed", {"name": "proposed", "hold": False, "lags": list(range(20))}]) == [
        "proposed",
        "proposed (hold false, lags [0, ..., 19])",
    ]
