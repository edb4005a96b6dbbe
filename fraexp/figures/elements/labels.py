"""Names of curves and columns, made from the grid's values at each sweep."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from fraexp.data.sweep import DRAW, Plain
from fraexp.data.texts import printable
from fraexp.data.units import with_powers
from fraexp.figures.elements.scales import DISPLACEMENT_UNITS

MAX_LIST_VALUES = 4
"""Number of values above which only the ends of a list are shown."""
MAX_GROUPS = 6
"""Maximum number of groups of sweeps: the number of colours that can be distinguished."""


NAME_JOINT = re.compile(r"(?<=[^\W_])_(?=[^\W_]{2})")
"""An underscore between the words of a name; a symbol such as F_m keeps its own."""
FILE_NAME = re.compile(r"\.[^\W\d]\w*$")
"""How the name of a file ends, which keeps its underscores."""
MICRO = re.compile(r"(?<=\d) ?u(?=(?:m|rad|s|N)\b)")
"""The prefix micro of a unit as it is typed."""
SYMBOLS = {
    "force_scale": "friction ΣF_m ×",
    "displacement_scale": "presliding Y_m ×",
    "coulomb_force": "Coulomb force F_c",
    "characteristic_displacement": "presliding width x_0",
    "rigid_body_gain": "rigid-body gain k_0",
    "frequencies": "natural frequency f_",
    "damping_ratios": "damping ratio ζ_",
}
"""What figures call parameters, by the last part of their path: their meaning, and their symbol in the literature.

That of a list ends where the number of an item follows.
"""
COMPENSATION_GAIN = {"gain": "gain α ="}
"""What figures call a gain without a unit; one with a unit is that of a plant."""
PROPER_NAMES = {name.lower(): name for name in ("GMS", "LuGre", "Dahl", "Coulomb", "H1", "H2", "Hv", "PID", "PRBS")}
"""Names of the literature as it writes them, by how they are typed in a study."""
WORD = re.compile(r"[^\W_]+")


def drawable(text: str) -> str:
    """Return a text for a legend: in one line, names as words, and without a leading ``_``, which would hide it."""
    shown = " ".join(
        word if FILE_NAME.search(word) else WORD.sub(_proper_name, NAME_JOINT.sub(" ", word))
        for word in printable(text).split(" ")
    )
    shown = MICRO.sub(" µ", shown)
    return f" {shown}" if shown.startswith("_") else shown


def _proper_name(word: re.Match[str]) -> str:
    typed = word[0][:1].lower() + word[0][1:]
    return PROPER_NAMES.get(typed, word[0])


def curve_names(labels: Sequence[Plain], fallback: Sequence[str], units: Mapping[str, str] | None = None) -> list[str]:
    """Return a name for each sweep from the labels that differ between them; `fallback` if there are none.

    `units` are the units of labels, by path: a number needs no title if no other one has its unit. The name of a random
    draw contains its number, not the drawn values.
    """
    labels = [{**nominal_labels(of), **({DRAW: of[DRAW]} if DRAW in of else {})} for of in labels]
    columns = label_columns(labels)
    texts = {path: label_texts([of.get(path) for of in labels]) for path in columns}
    varying = [path for path in columns if len(set(texts[path])) > 1] or list(columns)
    counts = Counter((units or {}).get(path) for path in varying)
    names = []
    for index, (of, spare) in enumerate(zip(labels, fallback, strict=True)):
        parts = []
        for path in (path for path in varying if path in of):
            unit = (units or {}).get(path, "")
            parts.append(_label_part(columns[path], of[path], texts[path][index], unit, counts[unit] == 1))
        names.append(", ".join(parts) or spare)
    repeated = {name for name, count in Counter(names).items() if count > 1}
    return [
        f"{name} ({spare})" if name in repeated and spare and name != spare else name
        for name, spare in zip(names, fallback, strict=True)
    ]


class RandomDraw(NamedTuple):
    """Description of a sweep with randomly drawn values."""

    number: int
    """Number of the draw."""
    family: str
    """Name of the nominal values; empty if all draws have the same."""


def describe_draws(labels: Sequence[Plain], units: Mapping[str, str]) -> list[RandomDraw | None]:
    """Return the description of each randomly drawn sweep, and None for the others."""
    families = curve_names([nominal_labels(of) for of in labels], [""] * len(labels), units)
    pairs = zip(labels, families, strict=True)
    return [RandomDraw(int(str(of[DRAW])), family) if DRAW in of else None for of, family in pairs]


def nominal_labels(labels: Plain) -> dict[str, object]:
    """Return the nominal labels of a sweep: those before its draw."""
    paths = list(labels)
    return {path: labels[path] for path in paths[: paths.index(DRAW) if DRAW in labels else None]}


def drawn_labels(labels: Plain) -> dict[str, object]:
    """Return the values of a sweep that were drawn at random: those after its draw."""
    paths = list(labels)
    return {path: labels[path] for path in paths[paths.index(DRAW) + 1 :]} if DRAW in labels else {}


def label_columns(labels: Sequence[Plain]) -> dict[str, str]:
    """Return the title of each label: the last part of its dotted path (for ``estimator.name`` the part before).

    Where that is ambiguous, the title is the whole path.
    """
    paths = list(dict.fromkeys(path for of in labels for path in of))
    short = {path: _last_part(path.removesuffix(".name")) for path in paths}
    count = Counter(short.values())
    return {path: title if count[title] == 1 else path for path, title in short.items()}


def _last_part(path: str) -> str:
    """Return the last part of a path, with the name of the list if it is an index."""
    *_, before, last = ["", *path.split(".")]
    return f"{before}.{last}" if last.isdecimal() and before else last


def label_text(value: object) -> str:
    """Return a value of a grid as text: a number in short, a component by its name."""
    return label_texts([value])[0]


def label_texts(values: Sequence[object]) -> list[str]:
    """Return the values of a label as texts; components with the same name get the parameters that differ."""
    if any(isinstance(value, Mapping) for value in values):
        values = [{"name": value} if isinstance(value, str) else value for value in values]
    texts = ["" if isinstance(value, Mapping) else _plain_text(value) for value in values]
    found = {index: value for index, value in enumerate(values) if isinstance(value, Mapping)}
    alike: dict[str, list[int]] = {}
    for index, value in found.items():
        alike.setdefault(repr(value.get("name")), []).append(index)
    for indices in alike.values():
        for index, text in zip(indices, _component_texts([found[index] for index in indices]), strict=True):
            texts[index] = text
    return texts


def _component_texts(alike: Sequence[Plain]) -> list[str]:
    """Return the common name of components, each with the parameters that distinguish it."""
    parts: list[list[str]] = [[] for _ in alike]
    for key in dict.fromkeys(key for of in alike for key in of if key != "name"):
        column = [of.get(key) for of in alike]
        differs = any(item != column[0] for item in column)
        for of, differing, text in zip(alike, parts, label_texts(column), strict=True):
            if key in of and (differs or "name" not in of):
                differing.append(f"{key} {text}")
    return [_component_name(of, ", ".join(differing)) for of, differing in zip(alike, parts, strict=True)]


def _component_name(component: Plain, differing: str) -> str:
    if "name" not in component:
        return differing
    return f"{component['name']} ({differing})" if differing else str(component["name"])


def _plain_text(value: object) -> str:
    match value:
        case bool():
            return str(value).lower()
        case float():
            return f"{value:.6g}"
        case list() | tuple():
            texts = label_texts(value)
            return f"[{', '.join(texts if len(texts) <= MAX_LIST_VALUES else [texts[0], '...', texts[-1]])}]"
    return "" if value is None else MICRO.sub(" µ", str(value))


def _label_part(title: str, value: object, text: str, unit: str, alone: bool) -> str:
    if isinstance(value, str | Mapping):
        return text if title != "friction" else "no friction" if text == "none" else text[:1].upper() + text[1:]
    title = _parameter_name(title, SYMBOLS if unit else SYMBOLS | COMPENSATION_GAIN)
    if not unit or not isinstance(value, int | float):
        return f"{title} {text}"
    factor, shown = (
        (1.0, unit)
        if unit not in DISPLACEMENT_UNITS or abs(value) >= 1
        else (1e3, f"m{unit}")
        if abs(value) >= 1e-3
        else (1e6, f"µ{unit}")
    )
    return f"{'' if alone else f'{title} '}{value * factor:.6g} {with_powers(shown)}"


def _parameter_name(title: str, symbols: Mapping[str, str]) -> str:
    """Return what figures call a parameter: its symbol, and the number of an item of a list, beginning with 1."""
    *owner, name = title.split(".")
    number = ""
    if owner and name.isdecimal():
        *owner, name, number = *owner, str(int(name) + 1)
    shown = name if owner else symbols.get(name, name)
    joint = "" if not number or shown.endswith("_") else " "
    return " ".join([*owner, f"{shown}{joint}{number}"])
