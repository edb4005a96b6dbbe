"""The sweeps that a user has marked, on whatever screen, in the order of marking."""

from collections.abc import Iterable, Iterator


class Marks:
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
        """Mark a sweep, or take its mark away; return whether it is marked now."""
        if key in self._keys:
            del self._keys[key]
            return False
        self._keys[key] = None
        return True

    def add(self, keys: Iterable[str]) -> None:
        """Mark sweeps."""
        self._keys |= dict.fromkeys(keys)

    def remove(self, keys: Iterable[str]) -> None:
        """Take the marks of sweeps away."""
        for key in keys:
            self._keys.pop(key, None)

    def clear(self) -> None:
        """Take all marks away."""
        self._keys.clear()
