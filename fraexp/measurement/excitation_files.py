"""Files of an excitation: tables for instruments and programs, and source code for controllers."""

import wave
from collections.abc import Callable
from pathlib import Path

import numpy as np

from fraexp.data.atomic_file import atomic_file
from fraexp.errors import FraexpError, StudyError
from fraexp.measurement.controller_source import write_c, write_structured_text
from fraexp.measurement.excitation_table import ExcitationTable

WAV_PEAK = 32767
"""Greatest number of a sample of 16 bits."""


def write_excitation(path: Path, table: ExcitationTable) -> str:
    """Write a file in the format of its suffix; return what the user must know to play it."""
    if path.suffix.lower() not in WRITERS:
        known = ", ".join(WRITERS)
        raise StudyError(f"{path}: an excitation cannot be written as '{path.suffix}'; expected one of {known}")
    try:
        with atomic_file(path) as draft:
            return WRITERS[path.suffix.lower()](draft, table)
    except OSError as error:
        raise FraexpError(f"{path}: cannot be written ({error.strerror or error})") from None


def _write_csv(path: Path, table: ExcitationTable) -> str:
    columns = table.columns()
    with path.open("w", encoding="utf-8", newline="\n") as stream:
        stream.write(f"time [s],excitation [{table.unit}],point\n")
        cells = zip(*(values.tolist() for values in columns.values()), strict=True)
        stream.writelines(f"{time:.10g},{force!r},{point:.0f}\n" for time, force, point in cells)
    return f"excitation [{table.unit}] at {1 / table.sample_time:g} Hz"


def _write_mat(path: Path, table: ExcitationTable) -> str:
    from scipy.io import savemat

    content = {**table.columns(), "sample_time": table.sample_time, "unit": table.unit}
    with path.open("wb") as stream:
        savemat(stream, content, oned_as="column", do_compression=True)
    return f"variable 'excitation' [{table.unit}] at {1 / table.sample_time:g} Hz"


def _write_hdf5(path: Path, table: ExcitationTable) -> str:
    import h5py

    with h5py.File(path, "w") as file:
        units = {"time": "s", "excitation": table.unit, "point": "1"}
        for name, values in table.columns().items():
            data = file.create_dataset(name, data=values, compression="gzip", track_times=False)
            data.attrs["unit"] = units[name]
        file.attrs["sample_time"] = table.sample_time
    return f"dataset 'excitation' [{table.unit}] at {1 / table.sample_time:g} Hz"


def _write_wav(path: Path, table: ExcitationTable) -> str:
    rate = 1 / table.sample_time
    if abs(rate - round(rate)) > 1e-6 * rate:
        raise StudyError(f"a WAV file has a whole number of samples per second; 1/loop.sample_time is {rate:.6g} Hz")
    force = table.columns()["excitation"]
    peak = float(np.abs(force).max())
    numbers = np.rint(force / peak * WAV_PEAK).astype("<i2")
    with path.open("wb") as stream, wave.open(stream, "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(round(rate))
        file.writeframes(numbers.tobytes())
    return f"full scale is {peak:.6g} {table.unit}, a step {peak / WAV_PEAK:.3g} {table.unit}; {rate:g} Hz, 16 bit"


def _write_c(path: Path, table: ExcitationTable) -> str:
    path.write_text(write_c(table), encoding="utf-8")
    return (
        f"call fraexp_next every {table.sample_time:g} s, and add what it returns [{table.unit}] to the control input"
    )


def _write_structured_text(path: Path, table: ExcitationTable) -> str:
    path.write_text(write_structured_text(table), encoding="utf-8")
    return f"call FB_FraexpExcitation every {table.sample_time:g} s, and add Force [{table.unit}] to the control input"


WRITERS: dict[str, Callable[[Path, ExcitationTable], str]] = {
    ".csv": _write_csv,
    ".mat": _write_mat,
    ".h5": _write_hdf5,
    ".hdf5": _write_hdf5,
    ".wav": _write_wav,
    ".h": _write_c,
    ".st": _write_structured_text,
}
"""Writers by suffix; each returns what the user must know to play the file."""
