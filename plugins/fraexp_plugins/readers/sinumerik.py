"""XML files of Sinumerik controls: frequency response measurements, and traces; arrays are in base 85."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import permutations
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from fraexp.api import RecordError, RecordReader, RecordTable
from fraexp_plugins.readers._shared.record_arrays import check_size, pick_columns

Columns = dict[str, NDArray[np.float64]]
FREQUENCY = "frequency"
FORBIDDEN_MARKUP = (b"<!DOCTYPE", b"<!ENTITY")
"""Markup that these files do not contain, and that may expand without end."""


class Sinumerik(RecordReader, name="sinumerik", version=1):
    """A frequency response measurement or a trace of a Sinumerik control, as XML.

    A measurement has the columns ``node62.series1`` of each repetition, and between each two nodes, from the averaged
    cross spectra, ``response61_62.real``, ``.imaginary`` and ``.coherence`` over ``frequency``: that of node 61 to node
    62. A trace has the columns of its signals, by description or number, each on its own time stamps.
    """

    suffixes = (".xml",)

    def read(self, path: Path, columns: Sequence[str]) -> RecordTable:
        found, times = _read_columns(path)
        chosen = pick_columns(path, columns, found)
        own = {column: times[column] for column in columns if column in times}
        units = {FREQUENCY: "Hz"} if FREQUENCY in columns else {}
        return RecordTable(chosen, None, units, own if len(own) == len(chosen) else {})

    def contents(self, path: Path) -> dict[str, tuple[tuple[int, ...], str]]:
        """Return length and unit of every column by its name."""
        return {
            name: (values.shape, "Hz" if name == FREQUENCY else "") for name, values in _read_columns(path)[0].items()
        }


def _read_columns(path: Path) -> tuple[Columns, Columns]:
    """Return the columns of a file, and the time stamps [s] of those over time."""
    check_size(path, "the file", path.stat().st_size)
    data = path.read_bytes()
    if any(markup in data for markup in FORBIDDEN_MARKUP):
        raise RecordError(f"{path.name}: it declares entities; expected a file of a Sinumerik control")
    try:
        root = ET.fromstring(data)
        found = _measurement(root) if root.find(".//PlatformSignalNode") is not None else _trace(root)
    except (ET.ParseError, ValueError, TypeError, AttributeError) as error:
        raise RecordError(f"{path.name}: it is damaged, or no file of a Sinumerik control: {error}") from None
    if not found[0]:
        raise RecordError(f"{path.name}: it has neither measured signals nor records of a trace; export it again")
    return found


def _measurement(root: ET.Element) -> tuple[Columns, Columns]:
    columns: Columns = {}
    times: Columns = {}
    auto: Columns = {}
    cross: dict[tuple[str, str], NDArray[np.complex128]] = {}
    for node in root.iter("PlatformSignalNode"):
        name = _number(node, "m_uNodeId")
        for count, series in enumerate(node.iter("TimeSeries"), start=1):
            values = _doubles(series.find("NumericArray"))
            stamps = np.linspace(_time(series, "start"), _time(series, "end"), values.size)
            columns[f"node{name}.series{count}"], times[f"node{name}.series{count}"] = values, stamps
        for info in node.iter("SigNodeCrossSpectrumInfo"):
            spectrum, frequency = _spectrum(info)
            if info.get("name") == "m_autospectrumInfo":
                auto[name] = spectrum.real
            else:
                other = _number(info, "m_uSignodeId")
                cross[name, other], cross[other, name] = spectrum, spectrum.conj()
            columns[FREQUENCY] = frequency
    for pair in permutations(auto, 2):
        if pair[::-1] in cross:
            columns |= _response(f"response{pair[0]}_{pair[1]}", auto[pair[0]], auto[pair[1]], cross[pair[::-1]])
    return columns, times


def _response(
    name: str, output: NDArray[np.float64], entry: NDArray[np.float64], cross: NDArray[np.complex128]
) -> Columns:
    """Return the response of two nodes by their averaged spectra, H₁ = S_yu/S_uu, and its coherence."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio, coherence = cross / entry, np.abs(cross) ** 2 / (output * entry)
    return {f"{name}.real": ratio.real, f"{name}.imaginary": ratio.imag, f"{name}.coherence": np.minimum(coherence, 1)}


def _spectrum(info: ET.Element) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
    parts = {part.get("name"): part for part in info.iter("NumericArray")}
    numbers = _doubles(parts["m_ValueVector"], 2)
    return numbers[::2] + 1j * numbers[1::2], _doubles(parts["m_FrequencyVector"])


def _doubles(array: ET.Element | None, parts: int = 1) -> NDArray[np.float64]:
    """Return the numbers of an array whose elements have so many parts."""
    if array is None:
        raise ValueError("an array is missing")
    return decode_doubles(array.findtext("raw", ""), parts * int(_number(array, "m_length")))


def _number(element: ET.Element, name: str) -> str:
    found = element.find(f"*[@name='{name}']")
    if found is None or not found.text:
        raise ValueError(f"'{name}' is missing")
    return found.text


def _time(series: ET.Element, end: str) -> float:
    return float(_number(series, f"m_TimeVector.{end}"))


def _trace(root: ET.Element) -> tuple[Columns, Columns]:
    """Return the signals of a trace; a record states only those that were sampled at its instant."""
    stamps: dict[str, list[float]] = {}
    values: dict[str, list[float]] = {}
    for record in root.iter("rec"):
        time = float(record.get("time", "nan"))
        for key, text in record.attrib.items():
            if key != "time":
                stamps.setdefault(key, []).append(time)
                values.setdefault(key, []).append(float(text))
    names = dict(_signal_names(root, values))
    columns = {names.get(key, key): np.array(numbers) for key, numbers in values.items()}
    return columns, {names.get(key, key): np.array(seconds) for key, seconds in stamps.items()}


def _signal_names(root: ET.Element, known: Mapping[str, object]) -> Iterator[tuple[str, str]]:
    """Yield the key of each signal and the description that another element gives it, if that is unique."""
    described: dict[str, str] = {}
    for element in root.iter():
        key = next((value for value in element.attrib.values() if value in known), "")
        text = element.get("description") or element.get("name") or ""
        if key and text and text != key and element.tag != "rec":
            described[key] = text.strip()
    texts = list(described.values())
    yield from ((key, text) for key, text in described.items() if texts.count(text) == 1)


ALPHABET = b"0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ!#$`()*+-/:;=?@[]^_{|}~"
GROUP_CHARACTERS = 5
"""Characters for each four bytes, the most significant one first."""
ZERO_SIGN, ZERO_GROUP = ".", "00000"
"""A dot stands for four bytes of zeros."""


def decode_doubles(text: str, count: int) -> NDArray[np.float64]:
    """Return `count` doubles, shape (count,); ValueError if the text holds another number of them or no base 85."""
    table = np.full(256, -1, dtype=np.int64)
    table[np.frombuffer(ALPHABET, dtype=np.uint8)] = np.arange(len(ALPHABET))
    characters = "".join(text.split()).replace(ZERO_SIGN, ZERO_GROUP).encode("latin-1", errors="replace")
    digits = table[np.frombuffer(characters, dtype=np.uint8)]
    if digits.size != 2 * GROUP_CHARACTERS * count or digits.min(initial=0) < 0:
        raise ValueError(f"an array does not hold {count} numbers in base 85")
    powers = len(ALPHABET) ** np.arange(GROUP_CHARACTERS - 1, -1, -1, dtype=np.int64)
    words = digits.reshape(-1, GROUP_CHARACTERS) @ powers
    if words.max(initial=0) >= 1 << 32:
        raise ValueError("an array holds a number of more than four bytes")
    return np.frombuffer(words.astype(">u4").tobytes(), dtype=">f8").astype(np.float64)
