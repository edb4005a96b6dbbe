"""How a law's arguments and other numbers lie in memory: of one job, or of eight side by side."""

from typing import Any

import numpy as np

from fraexp.kernels.lanes import WIDTH

CACHE_LINE = 64


def zeros(rows: int, wide: bool) -> np.ndarray:
    """Return zeros of shape (rows, 8), or (rows,) for one job, that begin where a vector register likes it."""
    size = rows * WIDTH if wide else rows
    place = np.zeros(size + CACHE_LINE // 8)
    first = (-place.ctypes.data % CACHE_LINE) // 8
    found = place[first : first + size]
    return found.reshape(rows, WIDTH) if wide else found


def numbers(arguments: Any) -> list[np.ndarray]:
    """Return a law's arguments, nested tuples of floats, arrays and sizes, as arrays one after another; no sizes."""
    if isinstance(arguments, tuple):
        return [part for argument in arguments for part in numbers(argument)]
    return [] if isinstance(arguments, int) else [np.atleast_1d(np.asarray(arguments, dtype=float))]


def views(arguments: Any, store: np.ndarray, used: int = 0) -> tuple[Any, int]:
    """Return a law's arguments as views of `store` from row `used` on, and the row after them.

    A float has shape (lanes,) there, an array of n numbers (n, lanes).
    """
    if isinstance(arguments, tuple):
        found = []
        for argument in arguments:
            view, used = views(argument, store, used)
            found.append(view)
        return tuple(found), used
    if isinstance(arguments, int):
        return arguments, used
    lanes = store.shape[1] if store.ndim > 1 else 1
    if isinstance(arguments, float):
        return store[used : used + 1].reshape(lanes), used + 1
    return store[used : used + arguments.size].reshape(arguments.size, lanes), used + arguments.size


def stored(arguments: Any, wide: bool) -> Any:
    """Return a law's arguments as they are stored, the same ones in each lane."""
    flat = np.concatenate([np.zeros(0), *numbers(arguments)])
    store = zeros(flat.size, wide)
    store[:] = flat[:, None] if wide else flat
    return views(arguments, store)[0]
