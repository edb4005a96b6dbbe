"""TOML from strangers: what would take much time or memory, or nest without end, is refused as what is no TOML is."""

import json
import re
import tomllib
from collections.abc import Mapping
from typing import Any

MAX_CHARACTERS = 4_000_000
"""Characters of a file: its parser takes seconds for them."""
MAX_DEPTH = 32
"""Levels of tables and lists, and parts of a name."""
MAX_INTEGER = 2**64
"""Whole numbers are smaller than this: formats and databases to come must hold them."""
PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
LONG_NAME = re.compile(rf"(?<![\w-]){PART}(?:[ \t]*+\.[ \t]*+{PART}){{{MAX_DEPTH}}}")
"""The parser's time rises with the square of a name's parts."""


def loads(text: str) -> dict[str, Any]:
    """Return the data in a TOML text; ValueError says in one line why there are none."""
    if len(text) > MAX_CHARACTERS:
        raise ValueError(f"it has {len(text):,} characters; expected {MAX_CHARACTERS:,} at most")
    if LONG_NAME.search(text):
        raise ValueError(f"a name has more than {MAX_DEPTH} parts")
    try:
        data = tomllib.loads(text)
    except RecursionError:
        raise ValueError(f"it is nested deeper than {MAX_DEPTH} levels") from None
    check_plain(data)
    return data


def value(text: str) -> Any:
    """Return the value that a text says as the right side of a TOML line; what says none is itself a text."""
    try:
        return loads(f"value = {text}")["value"]
    except ValueError:
        return text.strip()


def dumps(data: Any) -> str:
    """Return plain data as the right side of a TOML line; a table leaves out what is None."""
    match data:
        case Mapping():
            items = [f"{_key(key)} = {dumps(item)}" for key, item in data.items() if item is not None]
            return f"{{ {', '.join(items)} }}" if items else "{}"
        case list() | tuple():
            return f"[{', '.join(map(dumps, data))}]"
        case bool():
            return str(data).lower()
        case str():
            return json.dumps(data, ensure_ascii=False)  # a TOML text in double quotes has JSON's escapes
    return repr(data)


def _key(name: str) -> str:
    return name if BARE_KEY.fullmatch(name) else json.dumps(name, ensure_ascii=False)


def as_text(data: Any) -> str:
    """Return plain data as a user has written them: true and [1, 2], not as Python writes them; texts in quotes."""
    match data:
        case None:
            return "nothing"
        case bool():
            return str(data).lower()
        case float():
            return f"{data:.15g}"
        case list() | tuple():
            return f"[{', '.join(map(as_text, data))}]"
        case dict():
            return f"{{{', '.join(f'{key} = {as_text(item)}' for key, item in data.items())}}}"
    return repr(data)


def check_plain(data: Any, levels: int = MAX_DEPTH) -> None:
    """Raise ValueError for plain data that nest deeper, or have a whole number of more than 64 bits."""
    level = [data]
    for _ in range(levels):
        inner: list[Any] = []
        for one in level:
            if isinstance(one, dict):
                inner += one.values()
            elif isinstance(one, list):
                inner += one
            elif isinstance(one, int) and abs(one) >= MAX_INTEGER:
                raise ValueError(f"a whole number has {one.bit_length()} bits; expected 64 at most")
        level = inner
    if level:
        raise ValueError(f"it is nested deeper than {levels} levels")
