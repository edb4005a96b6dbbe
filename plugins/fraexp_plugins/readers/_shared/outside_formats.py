"""What readers share that use the library of a format: it may be missing, and may raise anything at a damaged file."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fraexp.api import RecordError
from fraexp_plugins.readers._shared.mat_arrays import column_hint, extract_signal, shape_text, split_indices
from fraexp_plugins.readers._shared.record_checks import missing_column

NUMERIC_KINDS = "biuf"
"""Kinds of numpy types that are real numbers."""


def load_package(path: Path, module: str, extra: str) -> Any:
    """Return a module of an optional package; RecordError names the extra if it is not installed."""
    try:
        return import_module(module)
    except ImportError:
        raise RecordError(
            f"{path.name}: reading it needs the package {module.partition('.')[0]}; pip install 'fraexp[{extra}]'"
        ) from None


@contextmanager
def format_errors(path: Path, what: str) -> Iterator[None]:
    """Turn whatever a library raises at a damaged file into RecordError."""
    try:
        yield
    except RecordError:
        raise
    except Exception as error:
        lines = str(error).splitlines()
        text = f"{type(error).__name__}: {lines[0][:200]}" if lines else type(error).__name__
        raise RecordError(f"{path.name}: this cannot be read as {what} ({text}); export it again") from None


def real_vector(path: Path, name: str, values: NDArray[Any], indices: tuple[str, ...] = ()) -> NDArray[np.float64]:
    """Return the samples of a variable, or of the part that indices in parentheses name, shape (n,)."""
    if values.dtype.kind not in NUMERIC_KINDS:
        kind = "complex numbers" if values.dtype.kind == "c" else "text or objects"
        raise RecordError(f"{path.name}: '{name}' holds {kind}; expected real numbers")
    if indices:
        return np.asarray(extract_signal(path, name, values, indices), dtype=float)
    if values.size != max(values.shape, default=1):
        raise RecordError(f"{path.name}: '{name}' is {shape_text(values)}; {column_hint(name, values.shape)}")
    return np.asarray(values, dtype=float).ravel()


def matrix_column(values: NDArray[Any], number: str) -> NDArray[Any] | None:
    """Return a column of a matrix by its number from 1, whose longer side is time; None if it has none such."""
    upright = values if values.ndim == 2 and values.shape[0] >= values.shape[1] else values.T
    index = int(number) - 1 if number.isdigit() else -1
    return upright[:, index] if upright.ndim == 2 and 0 <= index < upright.shape[1] else None


def pick_arrays(path: Path, arrays: dict[str, NDArray[Any]], columns: Sequence[str]) -> dict[str, NDArray[np.float64]]:
    """Return columns from named arrays: ``name``, ``name.2`` for a column of a matrix, or ``name(:,1)``."""
    found = {}
    for column in columns:
        name, indices = split_indices(column)
        values: NDArray[Any] | None = arrays.get(name)
        if values is None:
            head, _, number = name.rpartition(".")
            values = matrix_column(arrays[head], number) if head in arrays else None
        if values is None:
            raise missing_column(path, column, arrays)
        found[column] = real_vector(path, name, values, indices)
    return found
