"""What a reader returns: columns of a measured record."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class RecordTable:
    """Columns of a measured record, as stored in the file."""

    columns: Mapping[str, NDArray[np.float64]]
    """Values by column name, each of shape (n,)."""
    sample_time: float | None = None
    """Sample time [s] if the file states it."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Units by column name; none or an empty one where the file states none."""
    times: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    """Time stamps [s] of columns that have their own, each of shape (n,); the lengths of such columns may differ."""
