"""All key bindings of the terminal UI, by the names under which settings change them."""

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
from textual.keys import KEY_NAME_REPLACEMENTS, Keys
from textual.screen import ModalScreen, Screen
from textual.widget import Widget

import fraexp.tui
from fraexp.errors import FraexpError, did_you_mean

MODULES_WITHOUT_KEYS = ("fraexp.tui.services.browser_server",)
"""Modules without keys, which import packages that the terminal UI does not need."""
KEY_TEXTS = {
    "enter": "Enter", "escape": "Esc", "space": "Space", "tab": "Tab", "minus": "-", "plus": "+", "slash": "/",
    "up": "↑", "down": "↓", "left": "←", "right": "→", "pageup": "PgUp", "pagedown": "PgDn",
    "home": "Home", "end": "End",
}  # fmt: skip
MODIFIERS = ("ctrl", "shift", "alt", "super")
KEY_NAMES = [str(key.value) for key in Keys if not key.value.startswith("<")] + list(KEY_NAME_REPLACEMENTS.values())
"""Keys that are written as a name."""


@dataclass(frozen=True)
class NamedBinding:
    """A key binding of a screen or widget, with its default keys."""

    name: str
    keys: tuple[str, ...]
    meaning: str
    owner: str
    """Name of the class that declares it."""


@dataclass(frozen=True)
class KeyScopes:
    """The scopes in which bindings are active together."""

    owners: tuple[frozenset[str], ...]
    """For each screen, the names of the classes whose bindings are active."""

    def meet(self, one: NamedBinding, other: NamedBinding) -> bool:
        """Return whether a screen has both bindings."""
        return any(one.owner in of and other.owner in of for of in self.owners)


def key_text(key: str) -> str:
    """Return the text of a key: ``?`` for question_mark."""
    if key in KEY_TEXTS:
        return KEY_TEXTS[key]
    if len(key) > 1 and _is_character(key):
        return unicodedata.lookup(key.replace("_", " ").upper())
    return key.upper() if key[:1] == "f" and key[1:].isdecimal() else key


def named_bindings() -> dict[str, NamedBinding]:
    """Return all named bindings, by name."""
    found: dict[str, NamedBinding] = {}
    for owner in _binding_owners():
        for binding in owner.__dict__.get("BINDINGS", ()):
            if isinstance(binding, Binding) and binding.id:
                meaning = binding.tooltip or binding.description
                keys = tuple(key.strip() for key in binding.key.split(","))
                found.setdefault(binding.id, NamedBinding(binding.id, keys, meaning, owner.__name__))
    return found


def _binding_owners() -> Iterator[type[DOMNode]]:
    for info in sorted(pkgutil.walk_packages(fraexp.tui.__path__, "fraexp.tui."), key=lambda info: info.name):
        if info.name not in MODULES_WITHOUT_KEYS:
            module = importlib.import_module(info.name)
            for _, cls in inspect.getmembers(module, inspect.isclass):
                if issubclass(cls, DOMNode) and cls.__module__ == module.__name__:
                    yield cls


def check_keys(wished: Mapping[str, str], place: str) -> None:
    """Raise FraexpError for an unknown binding, an unknown key, or a key that is already used."""
    names = named_bindings()
    for name, keys in wished.items():
        if name not in names:
            raise FraexpError(f"{place}: unknown key binding '{name}'{_advice(name, names, 'see docs/terminal-ui.md')}")
        wrong = next((key for key in keys.split(",") if not is_key(key.strip())), None)
        if wrong is not None:
            hint = _advice(wrong.strip(), KEY_NAMES, "expected a character, or a name such as space or ctrl+k")
            raise FraexpError(f"{place}: keys.{name}: unknown key '{wrong.strip()}'{hint}")

    _check_collisions(wished, names, place)


def _check_collisions(wished: Mapping[str, str], names: Mapping[str, NamedBinding], place: str) -> None:
    """Raise FraexpError if a changed key has another meaning on the same screen."""
    now = {name: _toolkit_keys(wished[name].split(",") if name in wished else of.keys) for name, of in names.items()}
    together = key_scopes()
    for name in wished:
        given = now[name] - _toolkit_keys(names[name].keys)
        for other, keys in now.items():
            both = sorted(given & keys)
            if both and other != name and together.meet(names[name], names[other]):
                raise FraexpError(
                    f"{place}: keys.{name}: key '{both[0]}' is already '{other}' on the same screen; "
                    f"choose another key, or change keys.{other} too"
                )


def _toolkit_keys(keys: Iterable[str]) -> set[str]:
    """Return keys by their names in Textual: question_mark for ``?``."""
    return {binding.key for binding in Binding.make_bindings((key, "", "") for key in keys)}


def key_scopes() -> KeyScopes:
    """Return the scopes of bindings: those of a screen, its widgets and the application are active together."""
    found, owners = [], list(_binding_owners())
    applications = [owner for owner in owners if issubclass(owner, App)]
    for owner in owners:
        if issubclass(owner, Screen):
            parts = [of for of in vars(sys.modules[owner.__module__]).values() if inspect.isclass(of)]
            there: list[type] = [owner, *(of for of in parts if issubclass(of, Widget) and not issubclass(of, Screen))]
            there += [] if issubclass(owner, ModalScreen) else applications
            found.append(frozenset(of.__name__ for one in there for of in one.__mro__))
    return KeyScopes(tuple(found))


def _advice(name: str, options: Iterable[str], instead: str) -> str:
    """Return the nearest name, or `instead` if none is near, as all names would not fit into a line."""
    near = did_you_mean(name, options)
    return near if near.startswith("; did you mean") else f"; {instead}"


def is_key(text: str) -> bool:
    """Return whether a text names a key."""
    *modifiers, key = text.split("+") if len(text) > 1 else [text]
    if not key or any(modifier not in MODIFIERS for modifier in modifiers):
        return False
    return len(key) == 1 or key in KEY_NAMES or _is_character(key)


def _is_character(name: str) -> bool:
    try:
        unicodedata.lookup(name.replace("_", " ").upper())
    except KeyError:
        return False
    return True
