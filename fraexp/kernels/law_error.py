"""Errors of friction laws in the compiler and in compiled code; the compiler itself need not have been imported."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MAX_PLAUSIBLE_SPEED_M_S = 1.0
"""Speed up to which a law must give finite numbers."""


class LawError(Exception):
    """A law uses something that the compiler does not support; the text is one line, with the law's file and line."""


@dataclass(frozen=True)
class LawCall:
    """A call of a law in compiled code: from which state, and by which step."""

    z: NDArray[np.float64]
    """State before the step, shape (states,)."""
    dy: float
    """Displacement increment [m]."""
    dt: float
    """Time step [s]."""


class LawCallError(Exception):
    """A compiled law failed in a call; the text says how, as far as compiled code tells it."""

    def __init__(self, reason: str, law: Callable[..., float], call: LawCall | None = None) -> None:
        super().__init__(reason)
        self.law = law
        self.call = call
        """The call that failed; None if it is not known."""
