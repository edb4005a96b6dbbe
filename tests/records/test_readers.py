"""Every layout of text and MATLAB file gives the same numbers; what is wrong is said in one line."""

import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from fraexp_plugins.readers.csv_reader import CsvReader
from fraexp_plugins.readers.mat_reader import MatReader
from scipy.io import savemat

from fraexp.components.registry import Registry
from fraexp.errors import RecordError
from fraexp.records.proposals import propose_import
from fraexp.records.record_files import list_contents

POSITION = [0.25, -1.5, 3e-3]


def csv(tmp_path: Path, text: str, encoding: str = "utf-8") -> Path:
    path = tmp_path / "a.csv"
    path.write_bytes(text.encode(encoding, "surrogateescape"))
    return path


LAYOUTS = {
    "comma": "t [s],Position [mm]\n0,0.25\n1,-1.5\n2,3e-3\n",
    "quoted": '"t [s]","Position [mm]"\n"0","0.25"\n"1","-1.5"\n"2","3e-3"\n',
    "decimal comma": "t [s];Position (mm)\n0;0,25\n1;-1,5\n2;3e-3\n",
    "semicolon and point": "t;Position [mm]\n0;0.25\n1;-1.5\n2;0.003\n",
    "tab": "t [s]\tPosition [mm]\r\n0\t0.25\r\n1\t-1.5\r\n2\t0.003\r\n",
    "blanks": "t Position[mm]\n 0    0.25\n 1   -1.5\n 2 0.003\n",
    "comments": "# made by hand\n% on a Monday\nt [s],Position [mm]\n0,0.25\n# pause\n1,-1.5\n\n2,3e-3\n",
    "commented header": "# bench, axis 2\n# t [s], Position [mm]\n0, 0.25\n1, -1.5\n2, 3e-3\n",
    "line of units": "t,Position\n[s],[mm]\n0,0.25\n1,-1.5\n2,3e-3\n",
    "title above": "Recorder 7\nt [s],Position [mm]\n0,0.25\n1,-1.5\n2,3e-3\n",
    "byte order mark": "\ufefft [s],Position [mm]\n0,0.25\n1,-1.5\n2,3e-3\n",
    "trailing delimiter": "t [s];Position [mm];\n0;0,25;\n1;-1,5;\n2;0,003;\n",
    "block of properties": "Drive,AX5000\nDate,2026-05-04\nt [s],Position [mm]\n0,0.25\n1,-1.5\n2,3e-3\n",
    "flags and text": "t [s],State,Position [mm],Enabled\n0,run,0.25,TRUE\n1,run,-1.5,TRUE\n2,stop,3e-3,FALSE\n",
    "dates in front": "Clock;Position [mm]\n12:00:01;0,25\n12:00:02;-1,5\n12:00:03;0,003\n",
    "several columns of time": "t [s],Speed,t [s],Position [mm]\n0,1,0,0.25\n1,2,1,-1.5\n2,3,2,3e-3\n",
    "units under the names": "Time;Position\ns;mm\n0;0,25\n1;-1,5\n2;0,003\n",
    "sample rate above": "Sample rate: 2.5 kHz\nPosition [mm],Speed\n0.25,1\n-1.5,2\n3e-3,3\n",
}


@pytest.mark.parametrize("text", LAYOUTS.values(), ids=LAYOUTS)
def test_every_layout_of_text_gives_the_same_column_and_unit(tmp_path: Path, text: str) -> None:
    table = CsvReader().read(csv(tmp_path, text), ["Position"])
    assert table.columns["Position"].tolist() == POSITION
    assert table.units["Position"] == "mm"


def test_a_number_in_brackets_behind_a_name_is_an_index(tmp_path: Path) -> None:
    path = csv(tmp_path, "Axis[0],Axis[1],ratio [1]\n1,2,3\n4,5,6\n")
    table = CsvReader().read(path, ["Axis[1]", "ratio"])
    assert table.columns["Axis[1]"].tolist() == [2.0, 5.0]
    assert table.units.get("ratio") == "1"
    assert not table.units["Axis[1]"]


@pytest.mark.parametrize("encoding", ["utf-16", "latin-1"])
def test_units_of_other_encodings_are_read(tmp_path: Path, encoding: str) -> None:
    table = CsvReader().read(csv(tmp_path, "t\tKraft [µN]\n0\t1\n1\t2\n", encoding), ["Kraft"])
    assert table.units["Kraft"] == "µN"
    assert table.columns["Kraft"].tolist() == [1.0, 2.0]


def test_a_column_is_also_found_by_its_whole_heading(tmp_path: Path) -> None:
    path = csv(tmp_path, LAYOUTS["comma"])
    assert CsvReader().read(path, ["Position [mm]"]).columns["Position [mm]"].tolist() == POSITION


BROKEN = {
    "missing column": (
        "t,Position\n0,1\n",
        r"no column is called 'Positon'; it has t, Position; did you mean 'Position'\?",
    ),
    "text": (
        "t,Positon\n0,1\n1,off\n2,off\n",
        r"csv, line 3: 'off' in column 'Positon' is not a finite number \(2 such",
    ),
    "gap": ("t,Positon\n0,\n1,2\n", r"line 2: '' in column 'Positon' is not a finite number;"),
    "short line": ("t,Positon\n0,1\n1\n", r"line 3: '' in column 'Positon'"),
    "nan": ("t,Positon\n0,1\n# note\n1,nan\n", r"line 4: 'nan' in column 'Positon'"),
    "infinite": ("t,Positon\n0,1\n1,-inf\n", r"line 3: '-inf'"),
    "two of a name": ("Positon,Positon\n0,1\n", r"2 columns are called 'Positon'"),
    "no numbers": ("t,Positon\n", r"no line of numbers"),
    "text above": ("t,Positon\n0,off\n1,2\n", r"line 2: 'off' in column 'Positon' is not a finite number"),
    "quote left open": ('t,Positon\n0,1\n"1,2\n', r"line 3: '' in column 'Positon'"),
    "broken character": ("t,Positon\n" + "0,1\n" * 30000 + "1,\udcff\n", r"line 30002: '.' in column 'Positon'"),
    "endless cell": ("t,Positon\n0,1\n1," + "x" * 200_000 + "\n", r"line 3: '' in column 'Positon'"),
    "binary": ("t\0\0", r"this is not a text file"),
    "empty": ("", r"no line of numbers"),
}


@pytest.mark.parametrize(("text", "sentence"), BROKEN.values(), ids=BROKEN)
def test_broken_text_is_told_with_its_line(tmp_path: Path, text: str, sentence: str) -> None:
    with pytest.raises(RecordError, match=sentence) as caught:
        CsvReader().read(csv(tmp_path, text), ["Positon"])
    assert "\n" not in str(caught.value)


def classic(path: Path) -> None:
    signals = np.empty((1, 2), dtype=object)
    signals[0, 0], signals[0, 1] = {"values": [[9.0], [8.0]]}, {"values": [[1.0], [2.0], [3.0]]}
    records = np.zeros((1, 2), dtype=[("y", object)])
    records[0, 0]["y"], records[0, 1]["y"] = np.array([[7.0]]), np.array([[4.0, 5.0, 6.0]])
    savemat(
        path,
        {
            "column": np.array([[1.0], [2.0], [3.0]]),
            "row": np.array([[1.0, 2.0, 3.0]]),
            "counts": np.array([[1, 2, 3]], dtype=np.int16),
            "matrix": np.array([[1.0, 4.0], [2.0, 5.0], [3.0, 6.0]]),
            "lying": np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]),
            "data": {"y": np.array([1.0, 2.0, 3.0]), "deep": {"x": np.array([4.0, 5.0, 6.0])}},
            "signals": signals,
            "records": records,
            "text": "abc",
            "phasor": np.array([1j, 2.0]),
        },
        do_compression=True,
    )


def hdf5(path: Path) -> None:
    with h5py.File(path, "w", userblock_size=512) as file:

        def add(parent: h5py.Group, name: str, values: object, kind: bytes = b"double") -> h5py.Dataset:
            dataset = parent.create_dataset(name, data=values)
            dataset.attrs["MATLAB_class"] = np.bytes_(kind)
            return dataset

        add(file, "column", [[1.0, 2.0, 3.0]])
        add(file, "row", [[1.0], [2.0], [3.0]])
        add(file, "counts", np.array([[1, 2, 3]], dtype=np.int16), b"int16")
        add(file, "matrix", [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
        add(file, "lying", [[1.0, 4.0], [2.0, 5.0], [3.0, 6.0]])
        add(file.create_group("data"), "y", [[1.0, 2.0, 3.0]])
        add(file["data"].create_group("deep"), "x", [[4.0, 5.0, 6.0]])
        hidden = file.create_group("#refs#")
        cells = [hidden.create_group("a"), hidden.create_group("b")]
        add(cells[0], "values", [[9.0, 8.0]])
        add(cells[1], "values", [[1.0, 2.0, 3.0]])
        add(file, "signals", np.array([[cell.ref for cell in cells]], dtype=h5py.ref_dtype), b"cell")
        fields = [add(hidden, "c", [[7.0]]), add(hidden, "d", [[4.0, 5.0, 6.0]])]
        references = np.array([[field.ref for field in fields]], dtype=h5py.ref_dtype)
        file.create_group("records").create_dataset("y", data=references)
        add(file, "text", np.array([[97, 98, 99]], dtype=np.uint16), b"char")
        phasor = np.array([[(0.0, 1.0), (2.0, 0.0)]], dtype=[("real", float), ("imag", float)])
        add(file, "phasor", phasor)
        file["elsewhere"] = h5py.ExternalLink("other.h5", "/x")
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file")


FILES: dict[str, Callable[[Path], None]] = {"version 5": classic, "version 7.3": hdf5}
PLACES = {place: [1.0, 2.0, 3.0] for place in ("column", "row", "counts", "data.y", "signals.2.values")}
PLACES |= {place: [4.0, 5.0, 6.0] for place in ("matrix.2", "lying.2", "data.deep.x", "records.2.y")}


@pytest.mark.parametrize("write", FILES.values(), ids=FILES)
def test_both_versions_of_matlab_files_give_the_same_columns(tmp_path: Path, write: Callable[[Path], None]) -> None:
    write(tmp_path / "a.mat")
    columns = MatReader().read(tmp_path / "a.mat", list(PLACES)).columns
    assert {name: values.tolist() for name, values in columns.items()} == PLACES


WRONG = {
    "colum": r"no column is called 'colum'; it has .*did you mean 'column'\?",
    "data": r"'data' is a struct.*it holds data\.",
    "data.z": r"no column is called 'data\.z'; it has .*data\.y",
    "matrix": r"'matrix' is . x .; expected a vector: name a column, such as 'matrix\.1'",
    "matrix.3": r"no column is called 'matrix\.3'",
    "signals.3.values": r"no column is called 'signals\.3\.values'",
    "text": r"'text' (holds text|is a struct, cell, text)",
    "phasor": r"'phasor' holds (complex|text)",
}


@pytest.mark.parametrize("column", WRONG)
@pytest.mark.parametrize("write", FILES.values(), ids=FILES)
def test_a_wrong_place_in_a_matlab_file_names_what_there_is(
    tmp_path: Path, write: Callable[[Path], None], column: str
) -> None:
    write(tmp_path / "a.mat")
    with pytest.raises(RecordError, match=WRONG[column]):
        MatReader().read(tmp_path / "a.mat", [column])


def test_a_link_to_another_file_is_not_followed(tmp_path: Path) -> None:
    hdf5(tmp_path / "a.mat")
    with pytest.raises(RecordError, match="no column is called 'elsewhere'"):
        MatReader().read(tmp_path / "a.mat", ["elsewhere"])


@pytest.mark.parametrize("write", FILES.values(), ids=FILES)
def test_a_damaged_matlab_file_is_one_line(tmp_path: Path, write: Callable[[Path], None]) -> None:
    path = tmp_path / "a.mat"
    write(path)
    content = path.read_bytes()
    for end in (0, 60, 200, 700, len(content) // 2, len(content) - 40):
        path.write_bytes(content[:end])
        try:
            MatReader().read(path, ["phasor", "row"])
        except RecordError as error:
            assert "\n" not in str(error)
        else:  # pragma: no cover
            pytest.fail(f"a file cut off after {end} bytes was read")


def test_a_text_file_is_refused_by_its_size(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    with path.open("wb") as stream:
        stream.truncate(3 * 1024**3)  # sparse: takes no room
    with pytest.raises(RecordError, match=r"the file takes 3\.0 GiB; expected up to 2 GiB"):
        CsvReader().read(path, ["t"])


def test_a_variable_that_cannot_be_read_does_not_close_the_file(registry: Registry) -> None:
    file = Path(__file__).parents[3] / "shared/data/two_inertia_bench/MultisineTypeA.mat"
    if not file.exists():
        pytest.skip("the bench record is not on this machine")
    found = {one.name: one for one in list_contents(file, registry)}
    assert found["ms"].guess == "unreadable"  # a struct with an object of MATLAB's own
    assert found["iq_adx"].shape == (50000, 1)
    assert (found["iq_adx"].guess, found["theta_mx"].guess, found["time"].guess) == ("u", "y", "time")
    proposal = propose_import(file, list(found.values()), registry)
    command = proposal.command
    assert "u=iq_adx" in command
    assert command.endswith("--sample-rate 2500 --samples-per-period 2500")


def test_a_rate_that_a_number_states_is_proposed_before_a_time_without_a_unit(
    registry: Registry, tmp_path: Path
) -> None:
    ticks = 400 * np.arange(4000)  # microseconds, which nothing says
    wave = np.sin(2 * np.pi * np.arange(4000) / 250)
    np.savez(tmp_path / "bench.npz", time=ticks, fs=2500.0, force=wave, position=wave)
    proposal = propose_import(tmp_path / "bench.npz", list_contents(tmp_path / "bench.npz", registry), registry)
    assert proposal.command.endswith("--sample-rate 2500 --samples-per-period 250")
    np.savez(tmp_path / "other.npz", time_ms=ticks / 1000, fs=2500.0, force=wave, position=wave)
    proposal = propose_import(tmp_path / "other.npz", list_contents(tmp_path / "other.npz", registry), registry)
    assert "--time 'time_ms [ms]'" in proposal.command


@pytest.mark.parametrize(("name", "package", "extra"), [
    ("a.tdms", "nptdms", "tdms"), ("a.mf4", "asammdf", "mdf"), ("a.mcap", "mcap.reader", "mcap"),
    ("a.parquet", "pyarrow.parquet", "parquet"), ("a.unv", "pyuff", "uff"),
])  # fmt: skip
def test_a_format_whose_library_is_missing_names_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, package: str, extra: str, registry: Registry
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    path = tmp_path / name
    path.write_bytes(b"MDF     ")
    with pytest.raises(RecordError, match=rf"{name}: reading it needs .*; pip install 'fraexp\[{extra}\]'$"):
        list_contents(path, registry)
