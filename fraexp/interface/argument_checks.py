"""What arguments of the Python interface must be: a wrong one is named before anything is computed."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fraexp.data.units import number
from fraexp.errors import ParameterError
from fraexp.figures.elements.view import FULL_VIEW, View


def require_text(value: Any, what: str) -> str:
    """Return a text; ParameterError for anything else."""
    if not isinstance(value, str):
        raise ParameterError(f"{what} is {value!r:.60}; expected a text")
    return value


def require_path(value: Any, what: str) -> Path:
    """Return a path; ParameterError for what is none."""
    if not isinstance(value, str | Path) or "\0" in str(value):
        raise ParameterError(f"{what} is {value!r:.60}; expected a path")
    return Path(value)


def is_there(path: Path) -> bool:
    """Return whether there is a file of this name; False for a name that the file system cannot have."""
    try:
        return path.exists()
    except OSError:  # such as a name that is too long: writing reports it
        return False


def require_mapping(value: Any, what: str, example: str) -> Mapping[str, Any]:
    """Return a mapping whose keys are texts; ParameterError for anything else."""
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        raise ParameterError(f"{what}: found {value!r:.60}; expected a table such as {example}")
    return value


def require_positive(value: Any, what: str) -> float:
    """Return a finite number above 0; ParameterError for anything else."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = np.nan
    if isinstance(value, str) or not 0 < number < np.inf:
        raise ParameterError(f"{what} is {value!r:.60}; expected a finite number above 0")
    return number


def with_unit(value: Any, unit: str, what: str) -> Any:
    """Return a text such as ``"10 um"``, or those in a list, as numbers in SI units; anything else as it is."""
    if isinstance(value, str):
        try:
            return number(value, unit)
        except ParameterError as error:
            raise ParameterError(f"{what}: {error}") from None
    return [with_unit(one, unit, what) for one in value] if isinstance(value, list | tuple) else value


def numbers_of(values: ArrayLike, what: str, unit: str) -> NDArray[np.float64]:
    """Return values, of which texts have a unit, as an array of SI numbers; ParameterError if they are none."""
    values = with_unit(values, unit, what)
    try:
        if np.iscomplexobj(values):
            raise ParameterError(f"{what} is complex; expected real numbers")
        return np.array(values, dtype=float, order="C")
    except (TypeError, ValueError):
        raise ParameterError(f"{what} is {values!r:.60}; expected numbers") from None


def frequency_view(frequency_range: Any) -> View:
    """Return the view of a figure between two frequencies [Hz], or all of it."""
    if frequency_range is None:
        return FULL_VIEW
    try:
        low, high = (float(value) for value in frequency_range)
    except (TypeError, ValueError):
        low = high = np.nan
    if isinstance(frequency_range, str) or not 0 < low < high < np.inf:
        raise ParameterError(
            f"frequency_range is {frequency_range!r:.60}; expected two frequencies [Hz] above 0 in ascending order, "
            "such as (4.5, 45)"
        )
    return View((low, high))
