"""What hostile inputs have found: each was a traceback, a hang, a crash, or memory without end."""

import contextlib
import itertools
import struct
import time
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from fraexp_plugins.readers._shared import record_arrays
from scipy.io import savemat

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.components.registry import Registry
from fraexp.data import toml, units
from fraexp.errors import FraexpError, ParameterError, RecordError, StoreError, StudyError
from fraexp.records.channels import parse_channel
from fraexp.records.record_files import find_reader, list_contents
from fraexp.store.codec import decode_array
from fraexp.store.validation import parse_json
from fraexp.study.sections import override
from fraexp.study.study_file import load, read
from fraexp.study.study_file import resolve as study_of_data
from tests.refusals import refused

SOON = 5.0
"""Time that a refusal may take [s]; those that were found took minutes, or for ever."""


@pytest.fixture(autouse=True)
def soon() -> object:
    started = time.process_time()
    yield
    assert time.process_time() - started < SOON


TOWERS = ("9**9**9**9", "((9**9)**9)**9", "9⁹⁹⁹⁹⁹⁹⁹⁹", "9**9_999_999_999", "m" * 100_000, "(" * 10_000)


@pytest.mark.parametrize("text", TOWERS, ids=lambda text: text[:12])
def test_a_unit_that_takes_for_ever_is_none(text: str) -> None:
    with refused(ParameterError) as found:
        units.number(f"1 {text}", "m")
    assert len(str(found.value)) < 300


@pytest.mark.parametrize("text", ["m/s**2", "kg*m^2/s^2", "(m/s)**2", "m**0.5", "N/m**(1/2)", "m²", "s⁻¹", "m squared"])
def test_the_powers_of_units_are_known(text: str) -> None:
    assert units.si(text)[0] == pytest.approx(1.0)


@pytest.mark.parametrize("text", ["a" + " " * 20_000 + "*", " [ " * 20_000, "a * " + "1" * 5000, "(" * 5000])
def test_a_long_channel_is_refused(text: str) -> None:
    with refused(ParameterError, "channels.u", "1,000"):
        parse_channel(text, "channels.u")


DEEP = {"lists": "[" * 10_000 + "1" + "]" * 10_000, "long number": "1" * 5000, "65 bits": str(2**64)}


@pytest.mark.parametrize("text", DEEP.values(), ids=DEEP)
def test_deep_and_long_values_are_texts(text: str) -> None:
    assert toml.value(text) == text
    assert override(f"plant.rigid_body_gain={text}") == ("plant.rigid_body_gain", text)


LARGE = {
    "name of many parts": ("a" + ".a" * 20_000 + " = 1", ["32 parts"]),
    "header of many parts": ("[a" + ".a" * 20_000 + "]", ["32 parts"]),
    "lists in lists": (f"a = {'[' * 33}{']' * 33}", ["32 levels"]),
    "millions of characters": ("# " + "x" * toml.MAX_CHARACTERS, ["4,000,002", "4,000,000"]),
    "bytes": ("#" * (4 * toml.MAX_CHARACTERS + 1), ["16,000,001 bytes"]),
}


@pytest.mark.parametrize(("text", "names"), LARGE.values(), ids=LARGE)
def test_absurd_studies_are_refused_before_they_are_parsed(text: str, names: list[str], tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(text)
    with refused(StudyError, "a.toml", *names):
        read(tmp_path / "a.toml")


def test_paths_of_many_parts_are_refused() -> None:
    with refused(StudyError, "--set", "20001 parts", 32):
        override("plant" + ".a" * 20_000 + "=1")


ABSURD = {
    "grid": ('[grid]\n"excitation.amplitude" = [{values}]\n"excitation.ramp" = [{values}]', "1,002,001 points"),
    "draws": (
        '[monte_carlo]\ncount = 1000000000000\ndraw = [{{ paths = "plant.rigid_body_gain", relative = 0.1 }}]',
        "1,000,000,000,000 sweeps",
    ),
    "points": ("[excitation]\npoints = 1000000000000", "1000000000000"),
    "points as float": ("[excitation]\npoints = 1e12", "1000000000000"),
    "all samples": ("[excitation]\npoints = 100000\nmin_frequency = 0.01", "'min_frequency'"),
    "record time": ("[excitation]\npoints = 100000\nmin_record_time = 10000", "'min_record_time'"),
    "table": ("[excitation]\npreset = [[]]", "preset"),
    "loop": ("loop = 'x'", "table"),
    "record": ("record = -1", "table"),
    "no frequency": ("[excitation]\nmin_frequency = 5e-324", "'min_frequency'"),
    "machine": ("machine = '" + "x" * 5000 + "'", "studies/machines"),
}


@pytest.mark.parametrize(("text", "name"), ABSURD.values(), ids=ABSURD)
def test_absurd_sizes_are_refused_with_the_number(text: str, name: str, tmp_path: Path, registry: Registry) -> None:
    text = text.format(values=", ".join(str(number + 1) for number in range(1001))) if "{values}" in text else text
    head = "" if text.startswith("machine") else 'machine = "linear_motor_table"\n'
    lead = text if text.startswith(("machine", "loop", "record")) else ""
    rest = "" if lead else text.replace("{{", "{").replace("}}", "}")
    section = '[excitation]\nname = "stepped_sine"\namplitude = 12.0\n'
    body = rest.replace("[excitation]\n", section) if "[excitation]" in rest else f"{section}{rest}"
    (tmp_path / "a.toml").write_text(f'{head}{lead}\n{body}\n[estimator]\nname = "conventional"\n')
    with refused(FraexpError, "a.toml", name):
        load("a", tmp_path / "a.toml", tmp_path, registry)


def read_file(path: Path, registry: Registry, column: str) -> np.ndarray:
    return find_reader("", path, registry).read(path, [column]).columns[column]


TEXTS = {
    "a line without end": ("u,y\n1,2\n" + "1," * 3_000_000, "4,194,304 characters"),
    "a header without end": ("u [" * 2_000_000 + "\n1,2\n", "4,194,304 characters"),
    "brackets": ("u" + "[" * 100_000 + ",y\n1,2\n", "column"),
    "many columns": (",".join(f"c{n}" for n in range(30_000)) + "\n" + "1," * 29_999 + "1\n", "'u'"),
}


@pytest.mark.parametrize(("text", "name"), TEXTS.values(), ids=TEXTS)
def test_absurd_texts_are_refused(text: str, name: str, tmp_path: Path, registry: Registry) -> None:
    (tmp_path / "a.csv").write_text(text)
    with refused(RecordError, "a.csv", name):
        read_file(tmp_path / "a.csv", registry, "u")


def matlab(path: Path, change: Callable[[bytearray], None]) -> Path:
    savemat(path, {"t": np.arange(40.0), "s": {"a": np.arange(3)}})
    data = bytearray(path.read_bytes())
    change(data)
    path.write_bytes(data)
    return path


def one_byte(place: int, value: int) -> Callable[[bytearray], None]:
    return lambda data: data.__setitem__(place, value)


def test_no_damaged_matlab_file_crashes(tmp_path: Path, registry: Registry) -> None:
    """scipy's reader ends the process for some of these."""
    for place, value in itertools.product(range(128, 220), (0, 9, 255)):
        path = matlab(tmp_path / "a.mat", one_byte(place, value))
        with contextlib.suppress(RecordError):
            assert read_file(path, registry, "t").size <= 40
        with contextlib.suppress(RecordError):
            list_contents(path, registry)


def test_a_compressed_variable_larger_than_it_says_is_refused(
    tmp_path: Path, registry: Registry, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(record_arrays, "UNCHECKED_SIZE_BYTES", 1 << 20)
    path = matlab(tmp_path / "a.mat", lambda data: None)
    zeros = struct.pack("<II", 14, 100) + path.read_bytes()[136:184] + struct.pack("<II", 9, 1 << 26) + bytes(1 << 26)
    packed = zlib.compress(zeros)
    path.write_bytes(path.read_bytes()[:128] + struct.pack("<II", 15, len(packed)) + packed)
    with refused(RecordError, "0.1 GiB", "50 times"):
        read_file(path, registry, "t")


def test_a_huge_array_in_a_small_hdf5_file_is_refused(tmp_path: Path, registry: Registry) -> None:
    with h5py.File(tmp_path / "a.mat", "w", userblock_size=512) as file:
        file.create_dataset("x", (2**27,), float, chunks=True, compression="gzip")
        file.create_dataset("y", (2**40, 2**10), float, chunks=True)
        file.create_dataset("r", (2**30,), h5py.ref_dtype, chunks=True)
    for name in ("x", "y", "r.1"):
        with refused(RecordError, "a.mat"):
            read_file(tmp_path / "a.mat", registry, name)


def test_groups_that_hold_themselves_are_listed_in_time(tmp_path: Path, registry: Registry) -> None:
    with h5py.File(tmp_path / "a.mat", "w", userblock_size=512) as file:
        group = file.create_group("g")
        for number in range(30):
            group[f"again{number}"] = group
        file["x"] = np.arange(3.0)
    assert [found.name for found in list_contents(tmp_path / "a.mat", registry)] == ["x"]


NPY = b"\x93NUMPY\x01\x00"
HEADERS = (
    "{'descr':'<f8','fortran_order':False,'shape':(1180591620717411303424,)}",
    "{'descr':'|O','fortran_order':False,'shape':(1,)}",
    "{'descr':'<f8','fortran_order':False,'shape':(-1,)}",
    "(" * 5000,
    "{'descr':'|V0','fortran_order':False,'shape':(9,)}",
    "{'descr':[('a','<f8')],'fortran_order':False,'shape':()}",
    "__import__('os').system('true')",
    "{",
    "\x00",
    "'" * 3,
)


@pytest.mark.parametrize("header", HEADERS, ids=range(len(HEADERS)))
def test_no_header_of_an_array_gets_through(header: str) -> None:
    with refused(StoreError, "--rerun all"):
        decode_array(NPY + len(header).to_bytes(2, "little") + header.encode() + bytes(64))


def test_deep_and_large_json_is_refused() -> None:
    for text in ('{"a":' * 70 + "1" + "}" * 70, f'{{"a": {2**70}}}', "[" * 100_000):
        with pytest.raises((ValueError, RecursionError)):
            parse_json(text)


@pytest.mark.parametrize(
    "change", [{"duration": 1e308}, {"dwell_time": 160.0}, {"duration": 0.1, "targets": [1e-3, 2e-3] * 9999}]
)
def test_a_long_motion_is_refused_before_it_is_planned(change: dict[str, Any], registry: Registry) -> None:
    motion = {"name": "point_to_point", "targets": [1e-3], **change}
    data = {"machine": "linear_motor_table", "excitation": motion, "estimator": {"name": "positioning_metrics"}}
    with refused(FraexpError, "a.toml", "[excitation]", "point_to_point", "250,000"):
        study_of_data("a", Path("a.toml"), data, Path(), registry)


def test_a_study_writes_nowhere_but_in_its_workspace(tmp_path: Path) -> None:
    """A study's name, a link below figures/, and links in studies/ lead nowhere else."""
    workspace, outside = tmp_path / "workspace", tmp_path / "outside"
    (workspace / "studies").mkdir(parents=True)
    outside.mkdir()
    (outside / "evil.toml").write_text(Path("studies/quick.toml").read_text())
    (workspace / "studies" / "sub").symlink_to(outside)
    (workspace / "figures").symlink_to(outside)
    for name in ("../outside/evil", "sub/evil"):
        before = {path.name for path in outside.iterdir()}
        words = ["run", name, "--workspace", str(workspace), "--set", "excitation.points=2", "--executor", "serial"]
        assert main(words) in (ExitCode.OK, ExitCode.INCOMPLETE)
        assert {path.name for path in outside.iterdir()} == before
    assert {path.name for path in tmp_path.iterdir()} == {"workspace", "outside"}
