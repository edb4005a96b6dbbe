"""The components that were found, by kind and name; the modules of a package are imported when one is asked for."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from inspect import cleandoc
from pathlib import Path
from threading import RLock

from fraexp.components.kinds import KINDS, Component
from fraexp.data.identity import file_hash

DEFINITION = re.compile(r"^class \w+\([^)]*\bname=[\"']([^\"']+)[\"']", re.MULTILINE)
"""A class statement that names a component."""
COMPONENT_KINDS = frozenset(kind.kind for kind in KINDS)
"""Sections such as ``loop`` are none of them: nothing is imported to look for one."""
Key = tuple[str, str]
"""Kind and name of a component."""


@dataclass(frozen=True)
class Provider:
    """A component class and where it comes from."""

    component: type[Component]
    file: Path
    distribution: str
    """Name and version of the installed package, or ``workspace`` for a dropped-in file."""
    loaded: str = ""
    """Content hash of a dropped-in source as it was loaded; empty for a module of a package."""

    @cached_property
    def source_hash(self) -> str:
        """Content hash of the source that defines the component."""
        return self.loaded or file_hash(self.file)

    @property
    def paragraphs(self) -> list[str]:
        """The paragraphs of the component's description, each as one line."""
        text = cleandoc(self.component.__doc__ or "")
        return [" ".join(part.split()) for part in text.split("\n\n") if part.strip()]


def component_modules(package: str, folders: Iterable[str]) -> dict[str, list[str]]:
    """Return the modules of a package, without importing them, each with the names of components that its text defines.

    Modules and folders with a leading underscore are helpers and left out. A name that this overlooks costs time, but
    no component: if a name is not found, all modules are imported.
    """
    files = [(Path(folder), file) for folder in folders for file in sorted(Path(folder).rglob("*.py"))]
    modules = {}
    for folder, file in files:
        parts = file.relative_to(folder).with_suffix("").parts
        inner = parts[:-1] if parts[-1] == "__init__" else parts
        if inner and not any(part.startswith("_") for part in inner):
            modules[".".join((package, *inner))] = DEFINITION.findall(file.read_text(encoding="utf-8"))
    return modules


class Providers(Mapping[Key, Provider]):
    """Providers by kind and name: those that were added, and those of modules that are loaded when they are needed."""

    def __init__(self, known: Mapping[Key, Provider] | None = None) -> None:
        self._known = dict(known or {})
        self._postponed: dict[Callable[[], None], frozenset[str]] = {}
        self._lock = RLock()  # the terminal UI asks from several threads

    def postpone(self, load: Callable[[], None], names: Iterable[str]) -> None:
        """Call `load`, which adds providers, when one of these names is asked for, or all that there are."""
        self._postponed[load] = frozenset(names)

    def add(self, provider: Provider) -> Provider:
        """Add a provider; return the one that has its kind and name: the first one."""
        key = (provider.component.kind, provider.component.name)
        self.load(provider.component.name)  # a package's component comes before a dropped-in one
        return self._known.setdefault(key, provider)

    def replace(self, provider: Provider) -> None:
        """Add a provider in place of the one that has its kind and name, such as a class that was defined anew."""
        self.load(provider.component.name)
        self._known[provider.component.kind, provider.component.name] = provider

    def load(self, name: str | None = None) -> None:
        """Load the modules that define a name, or all that are left."""
        with self._lock:
            for load in [load for load, names in self._postponed.items() if name is None or name in names]:
                if self._postponed.pop(load, None) is not None:
                    load()

    def __getitem__(self, key: Key) -> Provider:
        self.load(key[1])
        if key not in self._known and key[0] in COMPONENT_KINDS:
            self.load()
        return self._known[key]

    def __iter__(self) -> Iterator[Key]:
        self.load()
        return iter(self._known)

    def __len__(self) -> int:
        self.load()
        return len(self._known)
