"""Exports of TwinCAT 3 Scope: every layout gives the same numbers; what is wrong is said in one line."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from fraexp_plugins.readers.twincat_scope import TwinCatScope

from fraexp.components.kinds import RecordReader
from fraexp.errors import RecordError
from fraexp.records.proposals import propose_import
from fraexp.records.record_files import find_reader, list_contents
from tests.records.corpus_writers import twincat_export

TRACES = Path(__file__).parents[3] / "shared" / "data" / "traces"
CHANNELS = {
    "Torque": ("N (Newton)", 1.0, [0.5, -1.25, 2.0, 3.0]),
    "ActPos": ("mm (Millimeter)", 1.0, [1.0, 2.0, 3.0, 4.0]),
}
FAST = ("(None)", 0.5, [float(value) for value in range(8)])


def export(*, fast=False, **more):
    """Return the text of an export of two channels of 1 ms, and one of 0.5 ms if asked for."""
    return twincat_export({**CHANNELS, **({"Fast": FAST} if fast else {})}, **more)


def written(tmp_path, text, encoding="utf-8"):
    path = tmp_path / "axis.csv"
    path.write_bytes(text.encode(encoding, "surrogateescape"))
    return path


@pytest.mark.parametrize("delimiter", ["\t", ";", ":"])
@pytest.mark.parametrize(("shared", "point", "end"), list(itertools.product((False, True), ".,", (False, True))))
def test_every_layout_gives_the_same_values_and_units(tmp_path, delimiter, shared, point, end):
    path = written(tmp_path, export(delimiter=delimiter, shared=shared, point=point, end=end))
    table = TwinCatScope().read(path, ["ActPos", "Torque"])
    assert table.columns["Torque"].tolist() == CHANNELS["Torque"][2]
    assert table.columns["ActPos"].tolist() == CHANNELS["ActPos"][2]
    assert table.units == {"Torque": "N", "ActPos": "mm"}
    assert table.sample_time == pytest.approx(1e-3)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "latin-1"])
@pytest.mark.parametrize("quoted", [False, True])
def test_an_export_is_recognised_in_any_encoding(tmp_path, registry, encoding, quoted):
    path = written(tmp_path, export(quoted=quoted), encoding)
    assert isinstance(find_reader("", path, registry), TwinCatScope)
    assert TwinCatScope().read(path, ["Torque"]).columns["Torque"].tolist() == CHANNELS["Torque"][2]


def test_another_text_file_is_not_taken_for_one(tmp_path, registry):
    path = written(tmp_path, "Name,SampleTime\n1,2\n3,4\n")
    found = find_reader("", path, registry)
    assert not isinstance(found, TwinCatScope)
    assert isinstance(found, RecordReader)


def test_the_listing_states_lengths_units_and_a_command_without_a_clock(tmp_path, registry):
    path = written(tmp_path, export(fast=True))
    contents = list_contents(path, registry)
    assert [(one.name, one.size, one.unit) for one in contents] == [
        ("Torque", 4, "N"), ("ActPos", 4, "mm"), ("Fast", 8, ""),
    ]  # fmt: skip
    assert "--sample-rate" not in propose_import(path, contents, registry).command
    assert "--time" not in propose_import(path, contents, registry).command


def test_stamps_that_are_rounded_are_accepted(tmp_path):
    text = export().replace("0\t0.5", "0.0\t0.5").replace("\n1\t-1.25", "\n1.1\t-1.25")
    assert TwinCatScope().read(written(tmp_path, text), ["Torque"]).sample_time == pytest.approx(1e-3)


def test_full_time_stamps_and_exports_without_any_give_the_stated_clock(tmp_path):
    whole = export(shared=True)
    full, none = whole, whole
    for k in range(4):
        full = full.replace(f"\n{k}\t", f"\n{132959733843760000 + 10000 * k}\t", 1)
        none = none.replace(f"\n{k}\t", "\n\t", 1)
    for text in (full, none):
        table = TwinCatScope().read(written(tmp_path, text), ["Torque", "ActPos"])
        assert table.columns["ActPos"].tolist() == CHANNELS["ActPos"][2]
        assert table.sample_time == pytest.approx(1e-3)


def test_full_time_stamps_with_a_gap_are_refused(tmp_path):
    full = export(shared=True)
    for k in range(4):
        full = full.replace(f"\n{k}\t", f"\n{132959733843760000 + 10000 * (k + (k > 1))}\t", 1)
    with pytest.raises(RecordError, match=r"steps by 0\.002 s after sample 2"):
        TwinCatScope().read(written(tmp_path, full), ["Torque"])


def test_a_factor_that_may_be_in_the_values_or_not_is_said(tmp_path, registry):
    plain = export(shared=True)
    assert TwinCatScope().remarks(written(tmp_path, plain)) == []
    factor = plain.replace("Unit\t", "Offset\t0\t2\nScaleFactor\t1\t0,5\nUnit\t", 1)
    path = written(tmp_path, factor)
    (remark,) = propose_import(path, list_contents(path, registry), registry).findings[-1:]
    assert remark.startswith("Scope states ScaleFactor 0,5, Offset 2 for 'ActPos': its values count as scaled, unless")
    assert TwinCatScope().read(path, ["ActPos"]).columns["ActPos"].tolist() == CHANNELS["ActPos"][2]


BROKEN = {
    "no sample time": (export().replace("SampleTime[ms]", "Sample"), ["Torque"], r"no line 'SampleTime\[ms\]'"),
    "a sample time that is text": (
        export().replace("\t1\tSample", "\tfast\tSample"),
        ["Torque"],
        r"'fast'; expected milli",
    ),
    "no values": (export().replace("\n\n0\t", "\n0\t"), ["Torque"], r"no empty line ends the properties"),
    "text as a value": (export().replace("-1.25", "off"), ["Torque"], r"line 9: channel 'Torque' is 'off'"),
    "a gap": (export().replace("-1.25", ""), ["Torque"], r"line 10: channel 'Torque' after an empty cell"),
    "a leap of time": (export().replace("\n2\t2\t", "\n7\t2\t"), ["Torque"], r"steps by 0\.006 s after sample 2"),
    "a time that is no number": (export().replace("\n2\t2\t", "\nnan\t2\t"), ["Torque"], r"steps by nan s"),
    "a wrong name": (export(), ["Torqe"], r"Torqe.*Torque"),
    "names lost": (export().replace("Name\tActPos", "Name"), ["Torque"], r"names of the channels .* do not match"),
}


@pytest.mark.parametrize(("text", "columns", "message"), BROKEN.values(), ids=BROKEN)
def test_what_is_wrong_is_said_in_one_line(tmp_path, text, columns, message):
    with pytest.raises(RecordError, match=message) as caught:
        TwinCatScope().read(written(tmp_path, text), columns)
    assert "\n" not in str(caught.value)


@pytest.mark.skipif(not TRACES.is_dir(), reason="the traces of strangers are not in the checkout")
@pytest.mark.parametrize("name", ["twincat_scope_default.csv", "twincat_scope_shared_time.csv"])
def test_a_strangers_exports_are_read(registry, name):
    path = TRACES / name
    assert isinstance(find_reader("", path, registry), TwinCatScope)
    sizes = {one.name: one.size for one in list_contents(path, registry)}
    assert (sizes["var_REAL64"], sizes["func_OS"], sizes["func_freesample"]) == (1000, 4996, 201)
    table = TwinCatScope().read(path, ["func_units_unscaled", "func_units_scaled"])
    assert table.units == {"func_units_unscaled": "V", "func_units_scaled": "dV"}
    assert table.sample_time == pytest.approx(1e-3)
    scaled, unscaled = table.columns["func_units_scaled"], table.columns["func_units_unscaled"]
    assert np.isfinite(scaled).all()
    assert scaled.shape == unscaled.shape == (1000,)
    factor = TwinCatScope().read(path, ["func_scaled", "var_REAL32"]).columns
    # The same channels, exported with the option "Scale values before export" off and on: the file does not say which.
    is_scaled = name == "twincat_scope_shared_time.csv"
    assert scaled == pytest.approx(10 - 10 * unscaled if is_scaled else unscaled)
    assert factor["func_scaled"] == pytest.approx(1 - factor["var_REAL32"] if is_scaled else factor["var_REAL32"])
    assert len(TwinCatScope().remarks(path)) == 3
