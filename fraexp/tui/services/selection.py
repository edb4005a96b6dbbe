"""The sweeps that the user has marked on any screen, in the order of marking."""

from collections.abc import Iterable, Iterator


class Selection:
    """Keys of marked sweeps."""

    def __init__(self) -> None:
        self._keys: dict[str, None] = {}

    def __contains__(self, key: object) -> bool:
        return key in self._keys

    def __iter__(self) -> Iterator[str]:
        return iter(self._keys)

    def __len__(self) -> int:
        return len(self._keys)

    def toggle(self, key: str) -> bool:
        """Mark or unmark a sweep; return whether it is marked now."""
        if key in self._keys:
            del self._keys[key]
            return False
        self._keys[key] = None
        return True

    def add(self, keys: Iterable[str]) -> None:
        """Mark sweeps."""
        self._keys |= dict.fromkeys(keys)

    def remove(self, keys: Iterable[str]) -> None:
        """Unmark sweeps."""
        for key in keys:
            self._keys.pop(key, None)

    def clear(self) -> None:
        """Unmark all sweeps."""
        self._keys.clear()
