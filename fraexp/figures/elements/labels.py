"""Names of curves and columns, made from the grid's values at each sweep."""

import unicodedata
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from fraexp.data.sweep import DRAW
from fraexp.data.units import with_powers

COMMANDING = ("Cc", "Cf", "Cs", "Zl", "Zp")
"""Unicode categories that move the cursor, turn the writing direction or break lines."""

LONG = 4
"""Lists with more values are shown by their ends."""
GROUPS = 6
"""Most groups into which many sweeps are told apart: as many as there are colours that are."""


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

    `units` are the units of labels, by path: a number with a unit needs no title if it is the only one in it. A sweep
    that was drawn at random has the number of its draw in its name, not what was drawn.
    """
    labels = [{**_nominal(of), **({DRAW: of[DRAW]} if DRAW in of else {})} for of in labels]
    columns = label_columns(labels)
    texts = {path: label_texts([of.get(path) for of in labels]) for path in columns}
    varying = [path for path in columns if len(set(texts[path])) > 1] or list(columns)
    counts = Counter((units or {}).get(path) for path in varying)
    names = []
    for index, (of, spare) in enumerate(zip(labels, fallback, strict=True)):
        parts = []
        for path in (path for path in varying if path in of):
            unit = (units or {}).get(path, "")
            parts.append(_part(columns[path], of[path], texts[path][index], unit, counts[unit] == 1))
        names.append(", ".join(parts) or spare)
    repeated = {name for name, count in Counter(names).items() if count > 1}
    return [
        f"{name} ({spare})" if name in repeated and spare and name != spare else name
        for name, spare in zip(names, fallback, strict=True)
    ]


def group_names(labels: Sequence[Mapping[str, Any]], units: Mapping[str, str] | None = None) -> list[str]:
    """Return for each sweep the name of its group: its value of the label that has the fewest values, 2 to `GROUPS`.

    The names are empty if there is no such label: the sweeps are one group. Random draws make no groups.
    """
    labels = [_nominal(of) for of in labels]
    counts = {path: len(set(label_texts([of.get(path) for of in labels]))) for path in label_columns(labels)}
    telling = [path for path, count in counts.items() if 1 < count <= GROUPS]
    if not telling:
        return [""] * len(labels)
    chosen = min(telling, key=lambda path: counts[path])
    return curve_names([{chosen: of[chosen]} if chosen in of else {} for of in labels], [""] * len(labels), units)


class Drawn(NamedTuple):
    """What is to be told of a sweep that was drawn at random."""

    number: int
    """Of its draw."""
    family: str
    """Name of what it was drawn around; empty if there is one."""
    values: str
    """What was drawn."""


def drawn_names(labels: Sequence[Mapping[str, Any]], units: Mapping[str, str]) -> list[Drawn | None]:
    """Return for each sweep what was drawn; None for one that was not drawn at random."""
    families = curve_names([_nominal(of) for of in labels], [""] * len(labels), units)
    drawn = [{path: of[path] for path in list(of)[len(_nominal(of)) + 1 :]} for of in labels]
    titles = label_columns(drawn)
    texts = [
        ", ".join(
            _part(titles[path], rounded := float(f"{value:.5g}"), f"{rounded:g}", units.get(path, ""), False)
            for path, value in of.items()
        )
        for of in drawn
    ]
    return [
        Drawn(int(of[DRAW]), family, text) if DRAW in of else None
        for of, family, text in zip(labels, families, texts, strict=True)
    ]


def _nominal(labels: Mapping[str, Any]) -> dict[str, Any]:
    """Return the labels of what a sweep was drawn around: those before its draw."""
    paths = list(labels)
    return {path: labels[path] for path in paths[: paths.index(DRAW) if DRAW in labels else None]}


def label_columns(labels: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Return the title of each label: the last part of its dotted path (for ``estimator.name`` the part before).

    Where that is ambiguous, the title is the whole path.
    """
    paths = list(dict.fromkeys(path for of in labels for path in of))
    short = {path: _last_part(path.removesuffix(".name")) for path in paths}
    count = Counter(short.values())
    return {path: title if count[title] == 1 else path for path, title in short.items()}


def _last_part(path: str) -> str:
    """Return the last part of a path, with the name of the list where it is a place in one."""
    *_, before, last = ["", *path.split(".")]
    return f"{before}.{last}" if last.isdecimal() and before else last


def label_text(value: Any) -> str:
    """Return one value of a grid as people read it: numbers in short, a component by its name."""
    return label_texts([value])[0]


def label_texts(values: Sequence[Any]) -> list[str]:
    """Return values of one label as people read them; components of one name get the parameters that differ."""
    if any(isinstance(value, Mapping) for value in values):
        values = [{"name": value} if isinstance(value, str) else value for value in values]
    texts = ["" if isinstance(value, Mapping) else _plain_text(value) for value in values]
    alike: dict[str, list[int]] = {}
    for index, value in enumerate(values):
        if isinstance(value, Mapping):
            alike.setdefault(repr(value.get("name")), []).append(index)
    for indices in alike.values():
        for index, text in zip(indices, _component_texts([values[index] for index in indices]), strict=True):
            texts[index] = text
    return texts


def _component_texts(alike: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the name of components that share it, each with those of its parameters that tell it from the others."""
    parts: list[list[str]] = [[] for _ in alike]
    for key in dict.fromkeys(key for of in alike for key in of if key != "name"):
        column = [of.get(key) for of in alike]
        differs = any(item != column[0] for item in column)
        for of, told, text in zip(alike, parts, label_texts(column), strict=True):
            if key in of and (differs or "name" not in of):
                told.append(f"{key} {text}")
    return [_named(of, ", ".join(told)) for of, told in zip(alike, parts, strict=True)]


def _named(component: Mapping[str, Any], told: str) -> str:
    if "name" not in component:
        return told
    return f"{component['name']} ({told})" if told else str(component["name"])


def _plain_text(value: Any) -> str:
    match value:
        case bool():
            return str(value).lower()
        case float():
            return f"{value:.6g}"
        case list() | tuple():
            texts = label_texts(value)
            return f"[{', '.join(texts if len(texts) <= LONG else [texts[0], '...', texts[-1]])}]"
    return "" if value is None else str(value)


def _part(title: str, value: Any, text: str, unit: str, alone: bool) -> str:
    if isinstance(value, str | Mapping):
        return text
    if not unit or not isinstance(value, int | float):
        return f"{title} {text}"
    factor, shown = (
        (1.0, unit) if unit != "m" or abs(value) >= 1 else (1e3, "mm") if abs(value) >= 1e-3 else (1e6, "µm")
    )
    return f"{'' if alone else f'{title} '}{value * factor:.6g} {with_powers(shown)}"
