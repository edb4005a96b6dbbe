"""The sweeps that the user has marked on any screen, in the order of marking."""

from collections.abc import Iterable, Iterator, Sequence


class Selection:
    """Keys of marked sweeps."""

    def __init__(self) -> None:
        self._keys: dict[str, None] = {}
        self.origin: tuple[str, ...] = ()
        """Arguments of a command line that name the same sweeps, such as a run; empty if only their keys do."""

    def __contains__(self, key: object) -> bool:
        return key in self._keys

    def __iter__(self) -> Iterator[str]:
        return iter(self._keys)

    def __len__(self) -> int:
        return len(self._keys)

    def toggle(self, key: str) -> bool:
        """Mark or unmark a sweep; return whether it is marked now."""
        self.origin = ()
        if key in self._keys:
            del self._keys[key]
            return False
        self._keys[key] = None
        return True

    def add(self, keys: Sequence[str], origin: tuple[str, ...] = ()) -> None:
        """Mark sweeps, which `origin` names in a command line."""
        self._keys |= dict.fromkeys(keys)
        self.origin = origin if list(self._keys) == list(keys) else ()

    def remove(self, keys: Iterable[str]) -> None:
        """Unmark sweeps."""
        for key in keys:
            if key in self._keys:
                self.toggle(key)

    def clear(self) -> None:
        """Unmark all sweeps."""
        self.origin = ()
        self._keys.clear()
