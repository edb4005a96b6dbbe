"""All keys of the terminal UI by the names under which settings change them."""

import importlib
import inspect
import pkgutil
import sys
import unicodedata
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from textual.app import App
from textual.binding import Binding
from textual.dom import DOMNode
from textual.keys import KEY_NAME_REPLACEMENTS, Keys, _character_to_key
from textual.screen import ModalScreen, Screen
from textual.widget import Widget

import fraexp.tui
from fraexp.errors import FraexpError, did_you_mean

NOT_SCREENS = ("fraexp.tui.services.browser_server",)
"""Modules without keys that need what the terminal does not."""
WRITTEN = {
    "enter": "Enter", "escape": "Esc", "space": "Space", "tab": "Tab", "minus": "-", "plus": "+", "slash": "/",
    "up": "↑", "down": "↓", "left": "←", "right": "→", "pageup": "PgUp", "pagedown": "PgDn",
    "home": "Home", "end": "End",
}  # fmt: skip
MODIFIERS = ("ctrl", "shift", "alt", "super")
NAMED = [str(key.value) for key in Keys if not key.value.startswith("<")] + list(KEY_NAME_REPLACEMENTS.values())
"""Keys that are written by a name."""


@dataclass(frozen=True)
class Known:
    """A key of a screen or of a part of it, as the program has it."""

    name: str
    keys: tuple[str, ...]
    meaning: str
    owner: str
    """Name of the class that has it."""


@dataclass(frozen=True)
class Screens:
    """Which keys are there together."""

    owners: tuple[frozenset[str], ...]
    """For each screen the names of the classes whose keys it has."""

    def meet(self, one: Known, other: Known) -> bool:
        """Return whether there is a screen with both keys."""
        return any(one.owner in of and other.owner in of for of in self.owners)


def shown(key: str) -> str:
    """Return a key as it is written on the keyboard: ``?`` for question_mark."""
    if key in WRITTEN:
        return WRITTEN[key]
    if len(key) > 1 and _is_character(key):
        return unicodedata.lookup(key.replace("_", " ").upper())
    return key.upper() if key[:1] == "f" and key[1:].isdecimal() else key


def known() -> dict[str, Known]:
    """Return all keys that have a name, by it."""
    found: dict[str, Known] = {}
    for owner in _owners():
        for binding in owner.__dict__.get("BINDINGS", ()):
            if isinstance(binding, Binding) and binding.id:
                meaning = binding.tooltip or binding.description
                keys = tuple(key.strip() for key in binding.key.split(","))
                found.setdefault(binding.id, Known(binding.id, keys, meaning, owner.__name__))
    return found


def _owners() -> Iterator[type[DOMNode]]:
    for info in sorted(pkgutil.walk_packages(fraexp.tui.__path__, "fraexp.tui."), key=lambda info: info.name):
        if info.name not in NOT_SCREENS:
            module = importlib.import_module(info.name)
            for _, cls in inspect.getmembers(module, inspect.isclass):
                if issubclass(cls, DOMNode) and cls.__module__ == module.__name__:
                    yield cls


def check(wished: Mapping[str, str], place: str) -> None:
    """Raise FraexpError for a name that no key has, or a key that no keyboard has."""
    names = known()
    for name, keys in wished.items():
        if name not in names:
            raise FraexpError(f"{place}: keys has no '{name}'{_nearest(name, names, 'see docs/terminal-ui.md')}")
        wrong = next((key for key in keys.split(",") if not is_key(key.strip())), None)
        if wrong is not None:
            hint = _nearest(wrong.strip(), NAMED, "expected a character, or a name such as space or ctrl+k")
            raise FraexpError(f"{place}: keys.{name} has '{wrong.strip()}', which is no key{hint}")

    _check_apart(wished, names, place)


def _check_apart(wished: Mapping[str, str], names: Mapping[str, Known], place: str) -> None:
    """Raise FraexpError if a key that is given has another meaning on the same screen."""
    now = {name: _keys(wished[name].split(",") if name in wished else of.keys) for name, of in names.items()}
    together = screens()
    for name in wished:
        given = now[name] - _keys(names[name].keys)
        for other, keys in now.items():
            both = sorted(given & keys)
            if both and other != name and together.meet(names[name], names[other]):
                raise FraexpError(
                    f"{place}: keys.{name} has '{both[0]}', which is '{other}' on the same screen; "
                    f"choose another key, or give keys.{other} another one too"
                )


def _keys(keys: Iterable[str]) -> set[str]:
    """Return keys as the toolkit names them: question_mark for ``?``."""
    return {_character_to_key(key.strip()) if len(key.strip()) == 1 else key.strip() for key in keys}


def screens() -> Screens:
    """Return which keys are there together: a screen's own, those of its parts, and the application's."""
    found, owners = [], list(_owners())
    applications = [owner for owner in owners if issubclass(owner, App)]
    for owner in owners:
        if issubclass(owner, Screen):
            parts = [of for of in vars(sys.modules[owner.__module__]).values() if inspect.isclass(of)]
            there: list[type] = [owner, *(of for of in parts if issubclass(of, Widget) and not issubclass(of, Screen))]
            there += [] if issubclass(owner, ModalScreen) else applications
            found.append(frozenset(of.__name__ for one in there for of in one.__mro__))
    return Screens(tuple(found))


def _nearest(name: str, options: Iterable[str], instead: str) -> str:
    """Return the nearest name; what helps instead if there is none, for all of them are too many for a line."""
    near = did_you_mean(name, options)
    return near if near.startswith("; did you mean") else f"; {instead}"


def is_key(text: str) -> bool:
    """Return whether a text names a key."""
    *modifiers, key = text.split("+") if len(text) > 1 else [text]
    if not key or any(modifier not in MODIFIERS for modifier in modifiers):
        return False
    return len(key) == 1 or key in NAMED or _is_character(key)


def _is_character(name: str) -> bool:
    try:
        unicodedata.lookup(name.replace("_", " ").upper())
    except KeyError:
        return False
    return True
