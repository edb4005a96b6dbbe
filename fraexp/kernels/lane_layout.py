"""How the numbers of machines lie in memory: those of one machine alone, or those of several side by side in lanes."""

from collections.abc import Callable
from typing import Any, NamedTuple

from fraexp.kernels.addresses import array_view, gather_scalar, read_only_view, row_viewer, scalar_view
from fraexp.kernels.decorators import compiled
from fraexp.kernels.lane_rows import RowsType
from fraexp.kernels.lanes import NARROW, WIDE, all_within, lane_gatherer

View = Callable[[int, int], Any]
"""Takes an address and a size, and returns what lies there."""


class LaneLayout(NamedTuple):
    """How many machines are computed side by side, and whether their constants are the same; code is compiled for it.

    Shared constants are read once for all lanes: without them, most of what a sample reads would be constants.
    """

    width: int
    """Lanes of a vector; 1 for one machine alone."""
    is_shared: bool
    """Whether all lanes have the constants of one machine."""

    @property
    def is_vectorised(self) -> bool:
        """Whether several machines are computed side by side."""
        return self.width > 1

    @property
    def view(self) -> View:
        """Numbers of the loop; no index is checked."""
        return row_viewer(self._rows(wraps=False)) if self.is_vectorised else scalar_view

    @property
    def constant_view(self) -> View:
        """Constants of the loop; no index is checked."""
        return row_viewer(self.constant_rows(wraps=False)) if self.is_vectorised else scalar_view

    @property
    def state_view(self) -> View:
        """What a law writes. Of one machine it is an array, whose methods the law may use."""
        return self.view if self.is_vectorised else array_view

    @property
    def present_view(self) -> View:
        """What a law only reads."""
        return self.view if self.is_vectorised else read_only_view

    @property
    def gather(self) -> Callable[[int, int, int], float]:
        """Function of two addresses and an offset that returns numbers[indices[lane] + offset] for each lane."""
        return lane_gatherer(self.width) if self.is_vectorised else gather_scalar

    @property
    def is_within(self) -> Callable[[float, float], bool]:
        """Function that returns whether the magnitudes of all lanes are below a limit; that of a NaN is not."""
        return all_within if self.is_vectorised else _is_within

    @property
    def constants_width(self) -> int:
        """Numbers in a row of constants."""
        return 1 if self.is_shared else self.width

    def constant_rows(self, wraps: bool) -> RowsType:
        """Return the type of constants in lanes."""
        return RowsType(self.width, wraps, self.is_shared)

    def _rows(self, wraps: bool) -> RowsType:
        return RowsType(self.width, wraps, is_shared=False)


ONE_MACHINE = LaneLayout(1, is_shared=False)
"""One machine."""
MOTION_LANES = LaneLayout(NARROW, is_shared=True)
"""Friction models driven along several motions."""


def choose_layout(is_vectorised: bool, experiments: int, machines: int) -> LaneLayout:
    """Return the layout of a number of experiments on a number of machines: no more lanes than experiments can fill."""
    if not is_vectorised:
        return ONE_MACHINE
    return LaneLayout(WIDE if experiments > NARROW else NARROW, is_shared=machines == 1)


@compiled(forceinline=True)
def _is_within(value: float, limit: float) -> bool:
    return abs(value) < limit
