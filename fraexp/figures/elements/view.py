"""The view of a figure: its frequency range, and how the phase is drawn."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fraexp.errors import FraexpError
from fraexp.figures.elements import canvas

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FREQUENCY_KINDS = ("bode", "difference", "coherence", "errors", "levels")
"""Kinds of figures over frequency, whose range can be chosen."""
PHASE_LABEL = "phase"
"""Label of the axes that show a phase, also where they have no title."""
VERTICAL_MARGIN = 0.05
"""Margin above and below the curves, relative to their span."""


@dataclass(frozen=True)
class View:
    """The part of a figure that is shown; by default all of it."""

    band: tuple[float, float] | None = None
    """Lowest and highest frequency [Hz]."""
    wrapped: bool = False
    """Whether the phase of a Bode plot lies within ±180°."""

    @classmethod
    def parse(cls, band: str = "", wrapped: bool = False) -> "View":
        """Return the view of a frequency range such as ``4.5:45`` [Hz]; FraexpError if it is invalid."""
        try:
            low, high = (float(part) for part in band.split(":")) if band else (1.0, 2.0)
        except ValueError:
            low = high = np.nan
        if not 0 < low < high < np.inf:
            expected = "expected two frequencies [Hz] above 0 in ascending order, such as 4.5:45"
            raise FraexpError(f"--frequency-range '{band}' is invalid; {expected}")
        return cls((low, high) if band else None, wrapped)

    def options(self) -> list[str]:
        """Return the options of ``fraexp plot`` that set the view, which also identify it."""
        band = [f"--frequency-range={self.band[0]:.6g}:{self.band[1]:.6g}"] if self.band else []
        return [*band, *(["--wrap-phase"] if self.wrapped else [])]

    def check(self, kind: str, frequencies: Sequence[NDArray[np.float64]] = ()) -> None:
        """Raise FraexpError if a kind of figure does not support the view, or none of `frequencies` [Hz] lies in it."""
        if self.band and kind not in FREQUENCY_KINDS:
            known = ", ".join(FREQUENCY_KINDS)
            raise FraexpError(f"frequency range: {kind} figures have no frequency axis; choose one of {known}")
        everything = np.concatenate([*frequencies, np.empty(0)])
        if self.band and everything.size and not ((self.band[0] <= everything) & (everything <= self.band[1])).any():
            raise FraexpError(
                f"frequency range: no response has a point between {self.band[0]:g} and {self.band[1]:g} Hz; they "
                f"lie between {everything.min():.4g} and {everything.max():.4g} Hz"
            )
        if self.wrapped and kind != "bode":
            raise FraexpError(f"--wrap-phase: {kind} figures show no phase; only bode does")


FULL_VIEW = View()
"""The view of all of a figure."""


def wrap_phase(phase: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return phases [deg] within -180 and 180."""
    return (phase + 180.0) % 360.0 - 180.0


def break_wrapped_lines(figure: "Figure") -> None:
    """Interrupt the lines of a wrapped phase where they jump between the edges."""
    for axes in figure.axes:
        for line in axes.lines if _is_phase_axis(axes) else ():
            x, y = (np.asarray(of, float) for of in line.get_data())
            jumps = np.flatnonzero(np.abs(np.diff(y)) > 180.0) + 1
            line.set_data(np.insert(x, jumps, np.nan), np.insert(y, jumps, np.nan))


def _is_phase_axis(axes: "Axes") -> bool:
    return axes.get_label() == PHASE_LABEL or axes.get_ylabel().startswith("Phase")


def zoom_to_band(figure: "Figure", band: tuple[float, float]) -> None:
    """Show a frequency range [Hz] of the panels, each as high as the visible part of its lines."""
    for axes in figure.axes:
        if axes.get_xscale() == "log":
            canvas.set_log_abscissa(axes, band)
            _fit_vertically(axes, band)
            if _is_phase_axis(axes) and axes.get_yscale() == "linear":
                canvas.set_phase_ticks(axes)


def _fit_vertically(axes: "Axes", band: tuple[float, float]) -> None:
    values = []
    for line in axes.lines:
        x, y = (np.asarray(of, float) for of in line.get_data())
        if x.shape == y.shape and line.get_transform() == axes.transData:
            values.append(y[(x >= band[0]) & (x <= band[1]) & np.isfinite(y)])
    seen = np.concatenate(values) if values else np.empty(0)
    scale = axes.get_yscale()
    if scale not in ("linear", "log") or not seen.size or (scale == "log" and seen.min() <= 0):
        return
    ends = np.log10([seen.min(), seen.max()]) if scale == "log" else np.array([seen.min(), seen.max()])
    room = VERTICAL_MARGIN * (ends[1] - ends[0]) or VERTICAL_MARGIN
    low, high = ends[0] - room, ends[1] + room
    axes.set_ylim(*((10**low, 10**high) if scale == "log" else (low, high)))
