"""Every format gives back the numbers that went in, as precisely as it can hold them."""

import json
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import loadmat

from fraexp.data.findings import remarks
from fraexp.data.results import Curve, FrequencyResponse, Metric, Outcome, Result
from fraexp.errors import FraexpError
from fraexp.figures.result_files import WRITERS, export
from tests.refusals import refused
from tests.responses import frequency_response

HEADER = {"study": "studies/a b.toml", "key": "fx1-00", "experiment": {"A": [12, 75], "plant": {"name": "modal"}}}
COUNT = 40


@pytest.fixture
def response() -> FrequencyResponse:
    rng = np.random.default_rng(5)
    halves = np.exp(rng.normal(size=COUNT))
    complex_noise = rng.normal(size=(2, COUNT)) * 1e-7
    return frequency_response(
        np.geomspace(1, 200, COUNT) + 1e-9 / 3,
        complex_noise[0] + 1j * complex_noise[1],
        covariance=halves[:, None, None] * np.array([[1.0, 0.1], [0.1, 2.0]]) * 1e-16,
        input_amplitude=np.full(COUNT, 12.0),
        output_amplitude=rng.uniform(size=COUNT),
        settled=np.arange(COUNT) % 3 > 0,
        settling_time=np.where(np.arange(COUNT) % 3 > 0, 0.1, np.nan),
        residual=np.full(COUNT, 1e-7),
        harmonics=rng.normal(size=(COUNT, 6)) + 1j * rng.normal(size=(COUNT, 6)),
    )


@pytest.fixture
def result(response: FrequencyResponse) -> Result:
    loop = Curve(
        "loop 1/a", {"y": np.array([0.0, 1e-5, 0.0]), "f,1": np.array([1.0, -1.0, 1.0])}, {"y": "m", "f,1": "N"}
    )
    metric = Metric("settling time", 0.25, "s")
    return Result(Outcome.NOT_SETTLED, remarks("13 had not\nsettled"), response, (metric,), (loop,))


def test_csv_holds_every_number_exactly(tmp_path: Path, result: Result, response: FrequencyResponse) -> None:
    path = tmp_path / "a.csv"
    export(result, HEADER, path)
    text = path.read_text("utf-8")
    assert "# study: studies/a b.toml\n# key: fx1-00\n" in text
    assert "# message: 13 had not settled\n" in text
    assert "# metric settling time: 0.25 s\n" in text
    assert "# outcome: not_settled\n" in text
    assert "# response: y/u [m/N]\n" in text
    assert "# output_amplitude: [m]\n# input_amplitude: [N]\n" in text
    table = np.genfromtxt([line for line in text.splitlines() if not line.startswith("#")], delimiter=",", names=True)
    np.testing.assert_array_equal(table["frequency_Hz"], response.frequency)
    np.testing.assert_array_equal(table["real"] + 1j * table["imag"], response.response)
    np.testing.assert_array_equal(table["std"], response.standard_deviation)
    np.testing.assert_array_equal(table["cov_ii"], response.covariance[:, 1, 1])
    np.testing.assert_array_equal(table["settled"], response.settled)
    np.testing.assert_array_equal(table["settling_time_s"], response.settling_time)
    np.testing.assert_array_equal(table["thd"], response.distortion)
    np.testing.assert_allclose(10 ** (table["magnitude_dB"] / 20), np.abs(response.response), rtol=1e-13)


def test_json_holds_everything_without_nan(tmp_path: Path, result: Result, response: FrequencyResponse) -> None:
    export(result, HEADER, tmp_path / "a.json")

    def refuse(name: str) -> float:
        raise AssertionError(f"{name} is not JSON")

    content = json.loads((tmp_path / "a.json").read_text("utf-8"), parse_constant=refuse)
    assert content["header"] == HEADER
    assert content["outcome"] == "not_settled"
    pairs = np.array(content["response"]["response"])
    np.testing.assert_array_equal(pairs[:, 0] + 1j * pairs[:, 1], response.response)
    assert np.array(content["response"]["harmonics"]).shape == (COUNT, 6, 2)
    assert content["response"]["settling_time"][:2] == [None, 0.1]
    assert content["response"]["settled"][:2] == [False, True]
    assert content["units"]["response"] == "m/N"
    assert (content["units"]["input_amplitude"], content["units"]["output_amplitude"]) == ("N", "m")
    assert content["metrics"] == {"settling time": {"value": 0.25, "unit": "s"}}
    assert content["curves"]["loop 1/a"]["columns"]["f,1"] == [1.0, -1.0, 1.0]


def test_matlab_gets_structs_of_arrays(tmp_path: Path, result: Result, response: FrequencyResponse) -> None:
    export(result, HEADER, tmp_path / "a.mat")
    content = loadmat(tmp_path / "a.mat", simplify_cells=True)["fraexp"]
    assert json.loads(content["header"]) == HEADER
    for name in ("frequency", "response", "covariance", "settled", "settling_time", "harmonics"):
        np.testing.assert_array_equal(content["response"][name], getattr(response, name))
    assert content["response"]["unit"] == "m/N"
    assert content["metrics"]["settling_time"]["value"] == 0.25
    assert content["curves"]["loop_1_a"]["columns"]["f_1"].tolist() == [1.0, -1.0, 1.0]


def test_hdf5_gets_datasets_with_units(tmp_path: Path, result: Result, response: FrequencyResponse) -> None:
    export(result, HEADER, tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5") as file:
        assert json.loads(file["header"].asstr()[()]) == HEADER
        for name in ("frequency", "response", "covariance", "settled", "settling_time", "harmonics"):
            np.testing.assert_array_equal(file["response"][name][()], getattr(response, name))
        assert file["response/frequency"].attrs["unit"] == "Hz"
        assert file["response/response"].attrs["unit"] == "m/N"
        assert file["response/input_amplitude"].attrs["unit"] == "N"
        assert file["response/output_amplitude"].attrs["unit"] == "m"
        assert file.attrs["outcome"] == "not_settled"
        assert file["curves/loop 1_a/y"].attrs["unit"] == "m"
        assert file["metrics/settling time"][()] == 0.25


@pytest.fixture
def loops() -> Result:
    loop = Curve("loop", {"y": np.array([0.0, 1e-5, 0.0]), "f": np.array([1.0, -1.0, 0.1])}, {"y": "m", "f": "N"})
    virgin = Curve("virgin", {"x": np.array([0.0, 1.0])}, {})
    return Result(Outcome.OK, curves=(loop, virgin))


def test_curves_are_exported_where_there_is_no_response(tmp_path: Path, loops: Result) -> None:
    for suffix in WRITERS:
        export(loops, {}, tmp_path / f"a{suffix}")
    text = (tmp_path / "a.csv").read_text("utf-8")
    assert "# curve: loop\ny [m],f [N]\n0.0,1.0\n1e-05,-1.0\n0.0,0.1\n# curve: virgin\nx\n" in text
    assert loadmat(tmp_path / "a.mat", simplify_cells=True)["fraexp"]["curves"]["loop"]["units"]["f"] == "N"


def test_a_file_is_replaced_only_by_force(tmp_path: Path, result: Result) -> None:
    path = tmp_path / "a.csv"
    path.write_text("precious")
    with refused(FraexpError, path, "--force"):
        export(result, HEADER, path)
    assert path.read_text() == "precious"
    export(result, HEADER, path, force=True)
    assert "precious" not in path.read_text("utf-8")


def test_a_failed_export_leaves_the_old_file_and_nothing_else(tmp_path: Path, loops: Result) -> None:
    path = tmp_path / "a.csv"
    path.write_text("precious")
    loops.curves[0].columns["f"] = np.zeros(2)  # of another length than y: a broken result
    with pytest.raises(ValueError):
        export(loops, {}, path, force=True)
    assert [(file.name, file.read_text()) for file in tmp_path.iterdir()] == [("a.csv", "precious")]


@pytest.mark.parametrize("unit", ["m/s/N", "1"])
def test_units_of_amplitudes_that_are_not_known_are_left_out(
    unit: str, tmp_path: Path, response: FrequencyResponse
) -> None:
    export(Result(Outcome.OK, response=replace(response, unit=unit)), {}, tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5") as file:
        assert file["response/response"].attrs["unit"] == unit
        assert "unit" not in file["response/input_amplitude"].attrs


@pytest.mark.parametrize("suffix", WRITERS)
def test_a_file_where_a_folder_should_be_is_one_line(suffix: str, tmp_path: Path, result: Result) -> None:
    (tmp_path / "file").touch()
    with refused(FraexpError, tmp_path / f"file/a{suffix}"):
        export(result, HEADER, tmp_path / f"file/a{suffix}")


@pytest.mark.parametrize(
    ("given", "file", "names"),
    [
        (None, "a.xls", ("a.xls", "'.xls'", ".json")),
        (None, "a", ("''", ".json")),
        (None, "x/a.csv", ("x/a.csv",)),
        (Result(Outcome.DIVERGED, remarks("why")), "a.csv", ("a.csv", "diverged: why")),
    ],
)
def test_what_cannot_be_exported_is_refused_in_one_line(
    tmp_path: Path, result: Result, given: Result | None, file: str, names: tuple[str, ...]
) -> None:
    with refused(FraexpError, *names):
        export(given or result, {}, tmp_path / file)
    assert not list(tmp_path.iterdir())


def test_resonances_stand_in_the_comments_of_a_table(tmp_path: Path, response: FrequencyResponse) -> None:
    columns = {"frequency": np.array([38.8, 80.5]), "damping ratio": np.array([0.046, 0.02])}
    curve = Curve("resonances", columns, {"frequency": "Hz", "damping ratio": "1"})
    export(Result(Outcome.OK, response=response, curves=(curve,)), {}, tmp_path / "a.csv")
    text = (tmp_path / "a.csv").read_text("utf-8")
    assert "# curve: resonances\n# frequency [Hz],damping ratio [1]\n# 38.8,0.046\n# 80.5,0.02\n" in text
    names, *rows = [line.split(",") for line in text.splitlines() if not line.startswith("#")]
    assert [float(row[names.index("frequency_Hz")]) for row in rows] == response.frequency.tolist()
