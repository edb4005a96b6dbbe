"""Results as files for other tools: CSV, JSON, MATLAB, HDF5 and universal files, chosen by the suffix.

Beside the response CSV has the metrics in its header, and the curves if there is no response; JSON, MATLAB and HDF5
have everything; universal files (dataset 58) have the response or the curves.
"""

from collections.abc import Callable
from pathlib import Path

from fraexp.data.atomic_file import atomic_file
from fraexp.data.results import Result
from fraexp.errors import FraexpError
from fraexp.figures.export.binary import write_hdf5, write_mat
from fraexp.figures.export.content import Header, outcome_name
from fraexp.figures.export.text import write_csv, write_json
from fraexp.figures.export.universal import write_universal

__all__ = ["WRITERS", "export", "write_file"]

WRITERS: dict[str, Callable[[Result, Header, Path], None]] = {
    ".csv": write_csv,
    ".json": write_json,
    ".mat": write_mat,
    ".h5": write_hdf5,
    ".unv": write_universal,
}
"""Formats by suffix."""


def export(result: Result, header: Header, path: Path, *, force: bool = False) -> None:
    """Write a result to a file in the format of its suffix, with `header` (plain data) as its description.

    The file appears complete or not at all. FraexpError if the suffix is unknown, the file exists and `force` is not
    set, there is nothing to write, or it cannot be written.
    """
    writer = WRITERS.get(path.suffix.lower())
    if writer is None:
        raise FraexpError(f"{path.name}: '{path.suffix}' is not an export format; known: {', '.join(WRITERS)}")
    if result.response is None and not result.curves and not result.metrics:
        why = f"{outcome_name(result)}: {result.message}"
        raise FraexpError(f"{path.name}: the result is empty ({why}); expected a response, metrics or curves")
    write_file(path, lambda draft: writer(result, header, draft), force=force)


def write_file(path: Path, write: Callable[[Path], object], *, force: bool = False) -> None:
    """Write a file, complete or not at all; FraexpError if it exists without `force`, or cannot be written."""
    try:
        if path.exists() and not force:
            raise FraexpError(f"{path}: the file exists; give --force to replace it, or another name")
        with atomic_file(path) as draft:
            write(draft)
    except OSError as error:
        raise FraexpError(f"{path}: cannot be written: {error.strerror or error}; choose another place") from None
