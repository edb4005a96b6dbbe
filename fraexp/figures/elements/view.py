"""What of a figure is to be seen: a band of frequencies, and how the phase is drawn."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fraexp.errors import FraexpError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

OVER_FREQUENCY = ("bode", "difference", "coherence", "errors", "levels")
"""Kinds of figure of which a band can be seen."""
MARGIN = 0.05
"""Room above and below the curves, as a share of their span."""


@dataclass(frozen=True)
class View:
    """What is to be seen; without anything said, all."""

    band: tuple[float, float] | None = None
    """Lowest and highest frequency [Hz]."""
    wrapped: bool = False
    """Whether the phase of a Bode plot lies within ±180°."""

    @classmethod
    def of(cls, band: str = "", wrapped: bool = False) -> "View":
        """Return the view that a band such as ``4.5:45`` [Hz] tells; FraexpError if it tells none."""
        try:
            low, high = (float(part) for part in band.split(":")) if band else (1.0, 2.0)
        except ValueError:
            low = high = np.nan
        if not 0 < low < high < np.inf:
            raise FraexpError(f"--band '{band}' is no band; expected two frequencies [Hz] above 0 such as 4.5:45")
        return cls((low, high) if band else None, wrapped)

    def options(self) -> list[str]:
        """Return the options of ``fraexp plot`` that give the view; they also tell it from others."""
        band = [f"--band={self.band[0]:.6g}:{self.band[1]:.6g}"] if self.band else []
        return [*band, *(["--wrapped"] if self.wrapped else [])]

    def check(self, kind: str) -> None:
        """Raise FraexpError if there is nothing of it in a kind of figure."""
        if self.band and kind not in OVER_FREQUENCY:
            raise FraexpError(f"--band: the kind {kind} is not drawn over frequency; {', '.join(OVER_FREQUENCY)} are")
        if self.wrapped and kind != "bode":
            raise FraexpError(f"--wrapped: the kind {kind} has no phase to wrap; bode has")


ALL = View()
"""All of a figure."""


def wrap(phase: np.ndarray) -> np.ndarray:
    """Return phases [deg] within -180 and 180."""
    return (phase + 180.0) % 360.0 - 180.0


def interrupt_wrapped(figure: "Figure") -> None:
    """Interrupt the lines of a wrapped phase where they jump from one edge to the other."""
    for axes in figure.axes:
        for line in axes.lines if _of_phase(axes) else ():
            x, y = (np.asarray(of, float) for of in line.get_data())
            jumps = np.flatnonzero(np.abs(np.diff(y)) > 180.0) + 1
            line.set_data(np.insert(x, jumps, np.nan), np.insert(y, jumps, np.nan))


def _of_phase(axes: "Axes") -> bool:
    return axes.get_ylabel().startswith("Phase")


def show_band(figure: "Figure", band: tuple[float, float]) -> None:
    """Show a band [Hz] of the panels over frequency, each as high as what is seen of its lines."""
    from fraexp.figures.elements import canvas

    for axes in figure.axes:
        if axes.get_xscale() == "log":
            canvas.frequency_axis(axes, band)
            _fit(axes, band)
            if _of_phase(axes) and axes.get_yscale() == "linear":
                canvas.phase_axis(axes)


def _fit(axes: "Axes", band: tuple[float, float]) -> None:
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
    room = MARGIN * (ends[1] - ends[0]) or MARGIN
    low, high = ends[0] - room, ends[1] + room
    axes.set_ylim(*((10**low, 10**high) if scale == "log" else (low, high)))
