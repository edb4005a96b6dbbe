"""Names of curves and columns, made from the grid's values at each sweep."""

import unicodedata
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

COMMANDING = ("Cc", "Cf", "Cs", "Zl", "Zp")
"""Unicode categories that move the cursor, turn the writing direction or break lines."""


def printable(text: str) -> str:
    """Return a text in one line in which control and formatting characters are written out."""
    return "".join(
        repr(character)[1:-1] if unicodedata.category(character) in COMMANDING else character for character in text
    )


def drawable(text: str) -> str:
    """Return a text as a legend takes it: in one line, and without the leading ``_`` that hides it there."""
    shown = printable(text)
    return f" {shown}" if shown.startswith("_") else shown


def curve_names(
    labels: Sequence[Mapping[str, Any]], fallback: Sequence[str], units: Mapping[str, str] | None = None
) -> list[str]:
    """Return a name for each sweep from its labels, without those that all share; `fallback` where none is left.

    `units` are the units of labels, by path: a number with a unit needs no title if it is the only one in it.
    """
    columns = label_columns(labels)
    varying = [path for path in columns if len({label_text(of.get(path)) for of in labels}) > 1] or list(columns)
    counts = Counter((units or {}).get(path) for path in varying)
    names = []
    for of, spare in zip(labels, fallback, strict=True):
        parts = [(columns[path], of[path], (units or {}).get(path, "")) for path in varying if path in of]
        names.append(", ".join(_part(title, value, unit, counts[unit] == 1) for title, value, unit in parts) or spare)
    repeated = {name for name, count in Counter(names).items() if count > 1}
    return [
        f"{name} ({spare})" if name in repeated and name != spare else name
        for name, spare in zip(names, fallback, strict=True)
    ]


def label_columns(labels: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Return the title of each label: the last part of its dotted path (for ``estimator.name`` the part before).

    Where that is ambiguous, the title is the whole path.
    """
    paths = list(dict.fromkeys(path for of in labels for path in of))
    short = {path: path.removesuffix(".name").rpartition(".")[2] for path in paths}
    count = Counter(short.values())
    return {path: title if count[title] == 1 else path for path, title in short.items()}


def label_text(value: Any) -> str:
    """Return one value of a grid as people read it: numbers in short, a component by its name."""
    if isinstance(value, Mapping):
        return str(value.get("name", ", ".join(f"{key} {label_text(item)}" for key, item in value.items())))
    if isinstance(value, float):
        return f"{value:.6g}"
    return "" if value is None else str(value)


def _part(title: str, value: Any, unit: str, alone: bool) -> str:
    if isinstance(value, str | Mapping):
        return label_text(value)
    if not unit or not isinstance(value, int | float):
        return f"{title} {label_text(value)}"
    factor, shown = (
        (1.0, unit) if unit != "m" or abs(value) >= 1 else (1e3, "mm") if abs(value) >= 1e-3 else (1e6, "µm")
    )
    return f"{'' if alone else f'{title} '}{value * factor:.6g} {shown}"
