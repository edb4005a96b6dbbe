"""Published values beside computed ones: which sweep is compared, in which unit, and how both are written."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from fraexp.data.results import Metric, Outcome
from fraexp.data.sweep import Sweep
from fraexp.errors import FraexpError, StudyError
from fraexp.study.published_values import Candidate, PublishedComparison, PublishedNumber, check, number_text
from fraexp.study.study_file import describe_study, packaged_studies
from tests.refusals import refused

WHERE = {"estimator.method": "proposed", "excitation.amplitude": 12}
SWEEPS = [
    Candidate(
        {"excitation.amplitude": f"{amplitude} N"},
        {"excitation": {"amplitude": float(amplitude)}, "estimator": {"method": {"name": "proposed", "version": 1}}},
        [Metric("k0", k0, "m/(N s**2)"), Metric("f1", float("nan"), "Hz")],
    )
    for amplitude, k0 in ((12, 0.1321), (75, 0.132))
]


def beside(**changes: Any) -> PublishedComparison:
    given = {"what": "k0", "value": 132, "unit": "mm/(N s**2)", "tolerance": "0.1 %", "metric": "k0", "where": WHERE}
    return PublishedNumber.parse({**given, **changes}, "[[published]]").compare_with(SWEEPS)


def test_a_printed_number_finds_ours_in_its_own_unit() -> None:
    found = beside()
    assert found.ours == pytest.approx(132.1)
    assert found.difference == pytest.approx(0.1)
    assert found.agrees
    assert not beside(tolerance="0.05 %").agrees
    assert beside(tolerance=0.11).agrees
    assert not beside(tolerance=0.09).agrees
    assert beside(tolerance="11e-5 m/(N s**2)").agrees
    assert beside(compare="above", tolerance=None).agrees
    assert not beside(compare="below", tolerance=None).agrees
    assert beside(compare="within", tolerance=None, value=132.2).agrees
    assert not beside(compare="within", tolerance=None, value=132).agrees
    assert beside(where={"excitation.amplitude": "75 N"}).ours == pytest.approx(132)  # as the label has it


def test_a_bound_of_the_magnitude_holds_on_both_sides() -> None:
    given = {"what": "error", "value": 4, "unit": "um", "compare": "within", "metric": "error"}
    number = PublishedNumber.parse(given, "[[published]]")
    for metres, agrees in ((3.9e-6, True), (-3.9e-6, True), (4.1e-6, False), (-4.1e-6, False), (float("nan"), False)):
        found = number.compare_with([Candidate({}, {}, [Metric("error", metres, "m")])])
        assert found.agrees is agrees


def test_origin_and_note_are_kept_and_an_origin_is_not_assumed() -> None:
    assert beside().published.origin == "unstated"
    stated = beside(origin="calibrated", note="k0 was chosen").published
    assert (stated.origin, stated.note) == ("calibrated", "k0 was chosen")


def test_a_number_of_a_sweep_with_a_reservation_agrees_but_is_not_met() -> None:
    number = beside().published
    for outcome, is_met in ((Outcome.OK, True), (Outcome.NOT_SETTLED, False), (Outcome.INACCURATE, False)):
        found = number.compare_with([replace(SWEEPS[0], outcome=outcome)])
        assert found.agrees
        assert found.is_met is is_met


def test_a_number_that_is_published_of_an_inaccurate_model_may_be_met_by_one() -> None:
    number = beside(accepts_inaccurate=True).published
    for outcome, is_met in ((Outcome.OK, True), (Outcome.INACCURATE, True), (Outcome.NOT_SETTLED, False)):
        assert number.compare_with([replace(SWEEPS[0], outcome=outcome)]).is_met is is_met


@pytest.mark.parametrize(
    ("changes", "remark"),
    [
        ({"metric": "k"}, "no sweep with estimator.method = proposed, excitation.amplitude = 12 has a metric 'k'"),
        ({"metric": "f1", "unit": "Hz"}, "metric 'f1' has no value with"),
        ({"unit": "Hz"}, "metric 'k0': 'm/(N s**2)' is not a unit of the same kind as 'Hz'"),
        ({"where": {}}, "2 sweeps have a metric 'k0': say which one"),
        ({"where": {"case": "nominal"}}, "there is no sweep with case = nominal"),
        ({"where": {"estimator.method": {"version": 2}}}, "there is no sweep with estimator.method"),
    ],
)
def test_a_printed_number_without_ours_says_why_and_does_not_agree(changes: dict[str, Any], remark: str) -> None:
    found = beside(**changes)
    assert remark in found.remark
    assert found.ours != found.ours
    assert not found.agrees


@pytest.mark.parametrize(
    ("table", "complaint"),
    [
        ('unit = "Hz"', "lacks 'tolerance', such as '1 %'"),
        ('tolerance = "1 mm"\nunit = "Hz"', "'mm' is not a unit of the same kind as 'Hz'"),
        ("tolerance = 0", "tolerance is 0.0; expected more than 0"),
        ('compare = "above"\ntolerance = 1', "has a tolerance; leave it out"),
        ('compare = "over"', "expected 'about', 'above', 'below' or 'within'"),
        ('compare = "within"\norigin = "guessed"', "expected 'input', 'calibrated', 'predicted' or 'unstated'"),
        ('unit = "Herz"\ntolerance = 1', "'Herz' is no known unit"),
        ('compare = "within"\nunit = "Hz"\nvalue = 0.0', "expected a value above 0"),
        ("tolerance = 1\nlabel = 1", "has no parameter 'label'"),
    ],
)
def test_a_wrong_printed_number_is_refused_in_one_line(tmp_path: Path, table: str, complaint: str) -> None:
    file = tmp_path / "study.toml"
    value = "" if "value" in table else "value = 1.0"
    file.write_text(f'[[published]]\nwhat = "f"\n{value}\nmetric = "f"\n{table}\n', "utf-8")
    with refused(FraexpError, "study.toml", "[[published]] number 1") as error:
        describe_study("study", file)
    assert complaint in str(error.value)


def test_a_printed_number_of_no_sweep_is_refused_when_the_study_is_read() -> None:
    numbers = [
        PublishedNumber.parse({"what": "k0", "value": 1, "compare": "above", "metric": "k0", "where": WHERE}, "one")
    ]
    method = {"name": "modal_fit", "method": {"name": "proposed"}}
    sweeps = [Sweep({"excitation": {"amplitude": 12.0}}, method, {"case": "right"})]
    wrong = {"case": "rihgt"}, {"excitation.amplitud": 12}, {"excitation.amplitude": 13}
    assert check([replace_where(numbers[0], {"case": "right", "excitation.amplitude": 12})], sweeps, "a.toml") is None
    for where, complaint in zip(
        wrong,
        ("no sweep has case = 'rihgt'; did you mean 'right'?", "has no 'amplitud'; did you mean", "first one has 12.0"),
        strict=True,
    ):
        with refused(StudyError, "a.toml", "[[published]] number 1") as error:
            check([replace_where(numbers[0], where)], sweeps, "a.toml")
        assert complaint in str(error.value)


def replace_where(number: PublishedNumber, where: dict[str, Any]) -> PublishedNumber:
    return number.model_copy(update={"where": where})


def test_every_published_number_of_the_paper_states_its_origin() -> None:
    numbers = [
        (file.stem, number)
        for file in sorted((packaged_studies() / "paper").glob("*.toml"))
        for number in describe_study(file.stem, file).published
    ]
    assert len(numbers) >= 21
    assert [(study, number.what) for study, number in numbers if number.origin == "unstated"] == []
    assert {number.origin for _, number in numbers} == {"input", "calibrated", "predicted"}


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ((131.99542,), "132"),
        ((131.99542, 0.0193), "131.995 ± 0.019"),
        ((131.99542, 0.0996), "132.00 ± 0.10"),
        ((397248.4, 1234.0), "397200 ± 1200"),
        ((-1e-5, 0.2), "0.00 ± 0.20"),
        ((2.0,), "2"),
        ((176.742, float("nan"), 1.77), "176.7"),
        ((float("nan"), 1.0), "–"),
        ((1.25e-153,), "1.25e-153"),
    ],
)
def test_numbers_are_rounded_to_the_second_digit_of_their_interval(given: tuple[float, ...], text: str) -> None:
    assert number_text(*given) == text
