"""The grouping rule: what shares a panel, a colour and a band."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from fraexp.data.results import Outcome, Result
from fraexp.errors import FraexpError
from fraexp.figures.drawing import draw_figure
from fraexp.figures.elements.grouping import MAX_FACETS, MAX_MAPS, ShownResult, group_sweeps, point_indices
from fraexp.figures.elements.labels import MAX_GROUPS
from tests.figures.curves import make_response
from tests.refusals import refused

UNITS = {"excitation.amplitude": "N"}


def grid(draws: int = 0, **values: list[object]) -> list[dict[str, object]]:
    """Return the labels of all combinations; a double underscore is the dot of a path."""
    found: list[dict[str, object]] = [{}]
    for name, column in values.items():
        found = [{**of, name.replace("__", "."): value} for of in found for value in column]
    return [{**of, "draw": n + 1, "plant.gain": 0.1 + n} for of in found for n in range(draws)] if draws else found


def test_all_nominal_labels_separate_groups() -> None:
    labels = grid(estimator=["conventional", "effective_input"], excitation__amplitude=[12.0, 75.0])
    places = group_sweeps(labels, UNITS)
    assert [place.group for place in places] == [
        "conventional, 12 N", "conventional, 75 N", "effective_input, 12 N", "effective_input, 75 N",
    ]  # fmt: skip
    assert {place.facet for place in places} == {""}


def test_labels_with_the_most_values_share_colours_where_nothing_could_distinguish_all() -> None:
    labels = grid(
        excitation__amplitude=[8.0, 12.0, 25.0, 50.0, 75.0], plant__rigid_body_gain=[0.1 + n / 100 for n in range(8)],
        loop__resolution=["0.05 um", "0.1 um", "0.5 um", "1 um"], estimator=["conventional", "effective_input"],
    )  # fmt: skip
    places = group_sweeps(labels, UNITS)
    assert len({of.facet for of in places}) == 8
    assert {of.group for of in places} == {"8 N", "12 N", "25 N", "50 N", "75 N"}
    assert all(len(of) == 1 for of in point_indices(places).values())
    assert not any(of.is_mapped for of in places)
    assert places == group_sweeps(labels, UNITS, ["amplitude", "resolution", "estimator"])
    names = [f"bench {n}" for n in range(60)]
    assert all(of.is_mapped for of in group_sweeps(grid(case=names)))  # of one label none can be left out


def test_random_draws_and_realisations_share_a_point() -> None:
    places = group_sweeps(grid(5, case=["a", "b"]))
    assert [len(of) for of in point_indices(places).values()] == [5, 5]
    assert {place.sample for place in places} == {"draw"}
    seeds = group_sweeps(grid(case=["a", "b"], excitation__seed=[1, 2, 3]))
    assert [len(of) for of in point_indices(seeds).values()] == [3, 3]
    assert {place.sample for place in seeds} == {"realisation"}


def test_an_amount_with_many_values_is_a_map() -> None:
    labels = grid(10, estimator=["a", "b", "c", "d"], excitation__amplitude=[float(2**n) for n in range(8)])
    places = group_sweeps(labels, UNITS)
    assert all(place.is_mapped for place in places)
    assert {place.axis for place in places} == {"Amplitude [N]"}
    assert {place.row for place in places} == {float(2**n) for n in range(8)}
    assert len({place.facet for place in places}) == 4 <= MAX_MAPS
    assert len(point_indices(places)) == 32


def test_groups_merge_and_split_by_any_label() -> None:
    labels = grid(estimator=["a", "b"], excitation__amplitude=[12.0, 75.0])
    assert [of.group for of in group_sweeps(labels, UNITS, by=["estimator"])] == ["a", "a", "b", "b"]
    assert [of.group for of in group_sweeps(labels, UNITS, by=["amplitude"])] == ["12 N", "75 N", "12 N", "75 N"]
    assert [of.group for of in group_sweeps(labels, UNITS, by=[])] == [""] * 4
    merged = group_sweeps(labels, UNITS, by=[])
    assert len(point_indices(merged)) == 4, "a grid is no sample, also in one colour"
    with refused(FraexpError, "'estimatr'", "estimator, amplitude", "'estimator'"):
        group_sweeps(labels, UNITS, by=["estimatr"])
    with refused(FraexpError, "'draw'", "case"):
        group_sweeps(grid(2, case=["a"]), by=["draw"])


def test_sweeps_with_equal_labels_are_told_apart_by_their_keys() -> None:
    places = group_sweeps([{"case": "a"}, {"case": "a"}], keys=["1a2b", "3c4d"])
    assert [place.group for place in places] == ["1a2b", "3c4d"]
    assert len(point_indices(places)) == 2


values = st.lists(st.integers(1, 99), min_size=1, max_size=9, unique=True)


@given(st.lists(values, min_size=0, max_size=3), st.integers(0, 2))
def test_no_panel_is_a_tangle_and_no_sweep_is_lost(columns: list[list[int]], draws: int) -> None:
    labels = grid(draws, **{f"part{n}__label{n}": list(column) for n, column in enumerate(columns)})
    places = group_sweeps(labels)
    assert len(places) == len(labels)
    nominal = [tuple(value for path, value in of.items() if path.startswith("part")) for of in labels]
    points = [(place.facet, place.point) for place in places]
    assert len(set(zip(points, nominal, strict=True))) == len(set(points)) == len(set(nominal))
    groups: dict[str, set[str]] = {}
    for place in places:
        groups.setdefault(place.facet, set()).add(place.group)
    if any(place.is_mapped for place in places):
        assert len(groups) <= MAX_MAPS
        assert len(set(nominal)) > MAX_GROUPS
    else:
        assert len(groups) <= MAX_FACETS
        assert max(map(len, groups.values())) <= MAX_GROUPS


def figure_of(labels: list[dict[str, object]]) -> object:
    frequency = np.geomspace(1, 200, 12)
    shown = [
        ShownResult(str(n), Result(Outcome.OK, response=make_response(frequency, -(1 + n) / frequency**2)), place)
        for n, place in enumerate(group_sweeps(labels, UNITS))
    ]
    return draw_figure(shown, title="Grid")


def test_a_map_is_drawn_with_the_median_of_the_draws() -> None:
    figure = figure_of(grid(3, excitation__amplitude=[float(n) for n in range(1, 10)]))
    upper = figure.axes[0]
    assert upper.get_ylabel() == "Amplitude [N]"
    magnitudes = np.asarray(upper.collections[0].get_array())
    middle = 20 * np.log10(1e3 * (2 + 3 * np.arange(9)))
    np.testing.assert_allclose(magnitudes[:, 0], middle, err_msg="the second of three draws in each row")


def test_rows_with_names_read_from_the_top() -> None:
    figure = figure_of(grid(case=[f"case {n}" for n in range(12)]))
    upper = figure.axes[0]
    assert [text.get_text() for text in upper.get_yticklabels()] == [f"case {n}" for n in range(12)]
    assert upper.get_ylim()[0] > upper.get_ylim()[1]
