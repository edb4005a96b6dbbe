"""Results as xarray, pandas, python-control, HTML and files: nothing is lost on the way."""

import csv
import json
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray

import fraexp
from fraexp.interface.datasets import stack_datasets
from tests.interface.conftest import POINTS
from tests.refusals import refused


def test_a_dataset_survives_netcdf_with_units_covariance_and_provenance(run: fraexp.Run, tmp_path: Path) -> None:
    found = run.one("estimator=effective_input excitation.amplitude=12")
    data = found.to_xarray()
    data.to_netcdf(tmp_path / "result.nc")
    with xarray.open_dataset(tmp_path / "result.nc") as read:
        assert read.identical(data)
        assert read.response.attrs["units"] == "m/N"
        assert read.frequency.attrs["units"] == "Hz"
        np.testing.assert_array_equal(read.covariance, found.frequency_response.covariance)
        np.testing.assert_array_equal(read.response, found.response)
        assert json.loads(read.attrs["estimator"])["name"] == "effective_input"
        assert json.loads(read.attrs["experiment"])["plant"]["rigid_body_gain"] == 0.132
        assert "estimator:effective_input" in json.loads(read.attrs["sources"])
        assert json.loads(read.attrs["metrics"])["stroke"]["unit"] == "m"


def test_a_run_is_one_dataset_over_its_grid(run: fraexp.Run, tmp_path: Path) -> None:
    data = run.to_xarray()
    assert dict(data.response.sizes) == {"amplitude": 2, "estimator": 2, "frequency": POINTS}
    assert data.amplitude.attrs == {"path": "excitation.amplitude", "units": "N"}
    for result in run:
        chosen = data.sel(amplitude=result.labels["excitation.amplitude"], estimator=result.estimator)
        np.testing.assert_array_equal(chosen.response, result.response)
        assert str(chosen.key.values) == result.key
    assert (data.attrs["study"], data.attrs["run"]) == ("quick", run.number)
    assert json.loads(data.attrs["provenance"])["fraexp"]
    data.to_netcdf(tmp_path / "run.nc")
    with xarray.open_dataset(tmp_path / "run.nc") as read:
        assert read.identical(data)


def test_results_that_are_no_grid_are_stacked(run: fraexp.Run) -> None:
    part = run.filter("-key:" + run[0].key)
    data = part.to_xarray()
    assert data.sizes["sweep"] == len(part) == 3
    assert list(data.amplitude.values) == [of.labels["excitation.amplitude"] for of in part]


def test_python_control_gets_the_response_to_the_last_bit(run: fraexp.Run) -> None:
    for result in run:
        found = result.to_frd()
        np.testing.assert_array_equal(found.frdata[0, 0], result.response)
        np.testing.assert_array_equal(found.omega, 2 * np.pi * result.frequency)
        assert (found.input_labels, found.output_labels) == ([result.result.response.input], ["y"])


def test_a_table_has_the_columns_of_the_csv_file(run: fraexp.Run, tmp_path: Path) -> None:
    result = run[0]
    table = result.to_pandas()
    path = result.export(tmp_path / "result.csv")
    rows = list(csv.reader(line for line in path.read_text("utf-8").splitlines() if not line.startswith("#")))
    assert rows[0] == ["frequency_Hz", *table.columns]
    np.testing.assert_array_equal(table["real"], [float(row[1]) for row in rows[1:]])
    whole = run.to_pandas()
    assert len(whole) == 4 * POINTS
    assert list(whole.columns[:4]) == ["key", "amplitude", "estimator", "outcome"]
    chosen = whole[(whole.amplitude == 12.0) & (whole.estimator == "conventional")]
    np.testing.assert_array_equal(
        chosen["real"], run.one("estimator=conventional excitation.amplitude=12").response.real
    )


def test_metrics_alone_make_a_table(workspace: fraexp.Workspace) -> None:
    run = workspace.run("friction/hysteresis", progress=False, executor="serial")
    table = run.to_pandas()
    assert len(table) == len(run)
    assert (table["energy per cycle"] > 0).all()
    assert run[0].to_xarray().sizes == {"point": run[0].result.curves[0].columns["force"].size}
    with refused(fraexp.FraexpError, "to_pandas()"):
        run.to_xarray()
    with refused(fraexp.FraexpError, "hysteresis"):
        _ = run[0].frequency


@pytest.mark.thorough
def test_a_cell_shows_figure_and_table(run: fraexp.Run, workspace: fraexp.Workspace) -> None:
    law = workspace.friction_law("coulomb", coulomb_force=5.0)
    study = workspace.study("quick")
    for shown in (run, run[0], law):
        html = shown._repr_html_()
        assert "data:image/png;base64,iVBOR" in html
    assert run._repr_html_().count("<tr>") == 5
    assert "stepped_sine" in study._repr_html_()
    named = fraexp.Study("named", title="<script>alert(1)</script>")
    assert "<script>" not in named._repr_html_()


@pytest.mark.parametrize("kind", ["", "nyquist", "errors"])
def test_a_figure_is_drawn_in_each_kind(run: fraexp.Run, kind: str) -> None:
    assert run.plot(kind).axes


def test_a_figure_shows_a_range_of_frequencies(run: fraexp.Run) -> None:
    axes = run[0].plot(frequency_range=(5.0, 50.0)).axes[0]
    assert axes.get_xlim()[0] > 4
    assert axes.get_xlim()[1] < 60


def test_a_range_without_a_point_is_refused(run: fraexp.Run) -> None:
    for shown in (run, run[0]):
        with refused(fraexp.FraexpError, "frequency range", "2000 Hz", "200.2 Hz"):
            shown.plot(frequency_range=(1000.0, 2000.0))


def test_a_slice_has_what_results_have(run: fraexp.Run) -> None:
    part = run[2:]
    assert [of.key for of in part] == [of.key for of in run][2:]
    assert part.to_xarray().sizes["amplitude"] * part.to_xarray().sizes["estimator"] == 2
    assert part.plot(group_by="estimator").axes


def test_labels_are_named_as_filters_name_them(run: fraexp.Run) -> None:
    with refused(fraexp.FraexpError, "4 results", "excitation.amplitude=12", "estimator=conventional"):
        run.one()
    assert run.one("excitation.amplitude=12 estimator=conventional").labels["excitation.amplitude"] == 12


def test_draws_are_a_dimension_with_the_drawn_values_along_it(workspace: fraexp.Workspace, tmp_path: Path) -> None:
    study = fraexp.Study(
        "drawn",
        machine="linear_motor_table",
        excitation={"name": "stepped_sine", "amplitude": 75.0, "points": 2},
        grid={"estimator": ["conventional", "effective_input"]},
        monte_carlo={"count": 2, "seed": 1, "draw": [{"paths": "plant.rigid_body_gain", "relative": 0.01}]},
    )
    run = fraexp.Workspace(tmp_path).run(study, executor="serial", progress=False)
    data = run.to_xarray()
    assert dict(data.response.sizes) == {"estimator": 2, "draw": 2, "frequency": 2}
    for result in run:
        chosen = data.sel(estimator=result.estimator, draw=result.labels["draw"])
        np.testing.assert_array_equal(chosen.response, result.response)
        assert chosen.rigid_body_gain == result.labels["plant.rigid_body_gain"]
    assert data.rigid_body_gain.dims == ("draw",)


@pytest.mark.thorough
def test_sweeps_over_other_frequencies_share_a_dataset(workspace: fraexp.Workspace, tmp_path: Path) -> None:
    excitation = {"name": "stepped_sine", "amplitude": 75.0}
    case = [
        {"label": f"{points} points", "excitation": {"points": points, "max_frequency": 50.0 * points}}
        for points in (2, 3)
    ]
    study = fraexp.Study(
        "two_grids", machine="linear_motor_table", excitation=excitation, case=case, estimator="conventional"
    )
    run = workspace.run(study, executor="serial", progress=False)
    data = run.to_xarray()
    assert data.sizes["frequency"] == len(set(run[0].frequency) | set(run[1].frequency))
    for result in run:
        own = data.sel(case=result.labels["case"], frequency=result.frequency)
        np.testing.assert_array_equal(own.response, result.response)
        assert int(data.sel(case=result.labels["case"]).settled.sum()) == result.frequency_response.settled.sum()
    data.to_netcdf(tmp_path / "two.nc")
    with xarray.open_dataset(tmp_path / "two.nc") as read:
        assert read.identical(data)
        assert read.settled.dtype == bool


def test_responses_of_different_units_are_not_mixed(run: fraexp.Run) -> None:
    first, second = (of.to_xarray() for of in run[:2])
    second.response.attrs["units"] = "rad/A"
    with refused(fraexp.FraexpError, "m/N, rad/A"):
        stack_datasets([first, second], {"estimator": ["one", "other"]}, {})


def test_a_frequency_that_is_repeated_is_not_lost(run: fraexp.Run) -> None:
    first = run[0].to_xarray()
    twice = xarray.concat(
        [first, first], "frequency", data_vars="minimal", coords="minimal", compat="override", join="override"
    )
    whole = stack_datasets([twice, twice], {"estimator": ["one", "other"]}, {})
    assert whole.sizes["frequency"] == 2 * POINTS
    with refused(fraexp.FraexpError, "frequency"):
        stack_datasets([first, twice], {"estimator": ["one", "other"]}, {})


def test_what_is_missing_is_said_with_its_reason(workspace: fraexp.Workspace) -> None:
    parts = [{"name": "stepped_sine", "amplitude": amplitude, "points": 2} for amplitude in (12.0, 30.0)]
    study = fraexp.Study(
        "fails",
        machine="linear_motor_table",
        excitation={"name": "concatenated", "parts": parts},
        estimator="conventional",
    )
    run = workspace.run(study, executor="serial", progress=False)
    assert len(run) == 0
    (reason,) = run.missing.values()
    with pytest.raises(IndexError) as raised:
        run[0]
    assert "1 Hz" in reason
    assert reason in str(raised.value)
    assert "1 failed" in run._repr_html_()


@pytest.mark.parametrize("name", ["xarray", "pandas", "control"])
def test_a_missing_package_is_named_with_its_remedy(
    run: fraexp.Run, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, name, None)
    convert = {"xarray": run[0].to_xarray, "pandas": run[0].to_pandas, "control": run[0].to_frd}[name]
    with refused(fraexp.FraexpError, f"pip install {name}"):
        convert()
