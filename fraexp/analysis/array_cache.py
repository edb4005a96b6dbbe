"""A cache of arrays that frequencies, estimators and sweeps share, limited by its memory."""

import random
import threading
from collections.abc import Callable
from functools import wraps
from typing import Any, ParamSpec

from numpy.typing import NDArray

P = ParamSpec("P")
Compute = Callable[P, NDArray[Any]]


def cached_arrays(max_bytes: int) -> Callable[[Compute[P]], Compute[P]]:
    """Return a decorator that keeps what a function of hashable arguments returns, up to a number of bytes.

    Once they are full a random array gives way to a new one. A sweep takes its frequencies in turn: if the oldest gave
    way, one frequency more than there is room for would lose them all. So the time grows with what there is no room
    for. The arrays are read-only.
    """

    def decorate(compute: Compute[P]) -> Compute[P]:
        kept = _KeptArrays(max_bytes)

        @wraps(compute)
        def cached(*arguments: P.args, **options: P.kwargs) -> NDArray[Any]:
            key = (*arguments, *options.items())
            found = kept.arrays.get(key)
            if found is None:
                found = compute(*arguments, **options)
                found.flags.writeable = False
                kept.add(key, found)
            return found

        return cached

    return decorate


class _KeptArrays:
    """Arrays by their keys, which count as their memory too."""

    def __init__(self, max_bytes: int) -> None:
        self.arrays: dict[tuple[object, ...], NDArray[Any]] = {}
        self._keys: list[tuple[object, ...]] = []
        self._max_bytes, self._bytes = max_bytes, 0
        self._choice, self._lock = random.Random(0), threading.Lock()

    def add(self, key: tuple[object, ...], array: NDArray[Any]) -> None:
        """Keep an array, and drop others until there is room for it."""
        size = _size(key, array)
        with self._lock:
            if key in self.arrays or size > self._max_bytes:
                return
            while self._bytes + size > self._max_bytes:
                self._drop()
            self.arrays[key] = array
            self._keys.append(key)
            self._bytes += size

    def _drop(self) -> None:
        place = self._choice.randrange(len(self._keys))
        self._keys[place], self._keys[-1] = self._keys[-1], self._keys[place]
        key = self._keys.pop()
        self._bytes -= _size(key, self.arrays.pop(key))


def _size(key: tuple[object, ...], array: NDArray[Any]) -> int:
    return array.nbytes + sum(len(part) for part in key if isinstance(part, bytes))
