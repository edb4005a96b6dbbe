"""Generate the reference: components, sections of a study, commands, keys, and the names of both Python interfaces.

The site generates it when it is built (docs/site/hooks.py). To read it as files:

python docs/make_reference.py FOLDER
"""

import argparse
import importlib
import inspect
import pkgutil
import re
import sys
import unicodedata
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, Literal, get_args, get_origin

from pydantic.fields import FieldInfo

import fraexp.api
import fraexp.tui
from fraexp.cli.exits import ExitCode
from fraexp.cli.main import _parser
from fraexp.cli.options import COMMANDS
from fraexp.components.kinds import KINDS, Component, nested_kind
from fraexp.components.measurement_settings import MeasurementSettings
from fraexp.components.parameters import Parameters, inherited_from, unit_of
from fraexp.components.position_dependence import Cogging, PositionDependence, Ripple
from fraexp.components.registry import Registry, discover
from fraexp.records.channels import Channel
from fraexp.records.record_settings import PlayedSegment, RecordSettings, Step
from fraexp.simulation.experiments import Compensation
from fraexp.simulation.machine import ControlLoop, Numerics
from fraexp.simulation.motion_limits import MotionLimits
from fraexp.views.components import BOUND_SIGNS

SECTIONS: Mapping[str, type[Parameters]] = {
    "loop": ControlLoop,
    "numerics": Numerics,
    "compensation": Compensation,
    "limits": MotionLimits,
    "measurement": MeasurementSettings,
    "record": RecordSettings,
    "friction over the stroke: position_dependence": PositionDependence,
    "a ripple over the stroke": Ripple,
    "a cogging force over the stroke": Cogging,
    "a channel of record": Channel,
    "a step of record": Step,
    "a segment of record": PlayedSegment,
}
"""Sections of a study that are not components, by heading."""
SECTIONS_PAGE = "sections.md"
PAGES = {
    "friction": ("friction.md", "Friction laws", "Components of the section `[friction]`."),
    "plant": ("plants.md", "Plants", "Components of the section `[plant]`."),
    "controller": ("controllers.md", "Controllers", "Components of the section `[controller]`."),
    "excitation": ("excitations.md", "Excitations", "Components of the section `[excitation]`."),
    "estimator": ("estimators.md", "Estimators", "Components of the section `[estimator]`."),
    "reader": ("readers.md", "Readers of records", "Components of the key `record.reader`."),
    "machine": ("machines.md", "Machines", "Components of the key `measurement.machine`."),
}
"""By kind of component: the file name of its page, the title, and what the components are."""
HOW_TO_READ = "The [reference](README.md#how-to-read-the-tables) explains the columns."
WORDS = {float: "number", int: "whole number", str: "text", bool: "true or false"}
DOCUMENTED = ("Workspace", "Study", "Run", "Results", "SweepResult", "Recording", "FrictionLaw", "run", "simulate",
              "read_record", "estimate", "identify", "friction_law")  # fmt: skip
"""Names of the Python interface whose arguments, units and errors follow the table."""


def main(folder: Path) -> None:
    """Write all pages into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in pages(discover()).items():
        (folder / name).write_text(text, encoding="utf-8")
        print(folder / name)


def pages(registry: Registry) -> dict[str, str]:
    """Return the text of each page by its file name."""
    found = {SECTIONS_PAGE: _section_page(), "commands.md": _commands(), "keys.md": _keys()}
    for kind, of in _by_kind(registry).items():
        page, title, section = PAGES[kind]
        lines = [f"# {title}", "", f"{section} {HOW_TO_READ}", "", *_component_table(kind, of, "")]
        found[page] = [*lines, *_component_pages(of)]
    found["python.md"] = _python_interface()
    found["plugin-interface.md"] = _plugin_interface()
    return {name: "\n".join(lines) + "\n" for name, lines in found.items()}


def contents(registry: Registry) -> str:
    """Return links to all sections and components, which the site appends to its page about the reference."""
    lines = ["", "## Sections of a study", "", f"Parameters: [sections of a study]({SECTIONS_PAGE}).", ""]
    lines += [f"- [{_section_title(name)}]({SECTIONS_PAGE}#{_slug(_section_title(name))})" for name in SECTIONS]
    for kind, of in _by_kind(registry).items():
        page, title, _section = PAGES[kind]
        lines += ["", f"## {title}", "", f"Parameters: [{title.lower()}]({page}).", ""]
        lines += _component_table(kind, of, page)
    return "\n".join(lines) + "\n"


def _by_kind(registry: Registry) -> dict[str, list[type[Component]]]:
    return {of.kind: [registry.provider(of.kind, name).component for name in registry.names(of.kind)] for of in KINDS}


def _python_interface() -> list[str]:
    lines = ["# Python interface", "", "All names of `import fraexp`, with arguments, units and errors."]
    lines += ["The [guide](../python.md) shows them at work.", "", *_names(fraexp, with_members=True)]
    options = "    options: {show_root_heading: true, show_root_toc_entry: true, show_root_full_path: false}"
    for name in DOCUMENTED:
        lines += [f"::: fraexp.{name}", options, ""]
    return lines


def _plugin_interface() -> list[str]:
    lines = ["# Plugin interface", "", "All names of `fraexp.api`, the only module that a plugin imports."]
    lines += ["[Writing a plugin](../writing-a-plugin.md) has an example of each kind of component."]
    return [*lines, "", *_names(fraexp.api), "::: fraexp.api"]


def _names(module: ModuleType, with_members: bool = False) -> list[str]:
    """Return a table of a module's public names, each with its first sentence, and those of its classes' members."""
    public = {name: getattr(module, name) for name in module.__all__}
    lines = _table(["name", "what it is"], ([_called(name, of), _sentence(of)] for name, of in public.items()))
    for name, of in public.items():
        members = _members(of) if with_members and inspect.isclass(of) else {}
        if members:
            rows = ([_called(member, value), _sentence(value)] for member, value in members.items())
            lines += ["", f"**{name}**", "", *_table(["member", "what it is"], rows)]
    return [*lines, ""]


def _members(owner: type) -> dict[str, Any]:
    """Return the properties and methods that a class itself defines."""
    return {
        name: of
        for name, of in sorted(vars(owner).items())
        if not name.startswith("_") and (inspect.isfunction(of) or isinstance(of, property | classmethod))
    }


def _called(name: str, of: Any) -> str:
    """Return a name, with the arguments of what can be called."""
    function = getattr(of, "__func__", of)
    if not inspect.isfunction(function):
        return f"`{name}`"
    open_ended = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    words = [
        "..." if of.kind in open_ended else of.name
        for of in inspect.signature(function).parameters.values()
        if of.name not in ("self", "cls")
    ]
    return f"`{name}({', '.join(words)})`"


def _sentence(of: Any) -> str:
    """Return the first sentence of what is documented, on one line; the value of a constant."""
    if not (inspect.isclass(of) or callable(of) or isinstance(of, property | classmethod)):
        return repr(of)
    return (inspect.getdoc(of) or "").partition("\n\n")[0].replace("\n", " ").replace("``", "`")


def _component_table(kind: str, components: Sequence[type[Component]], page: str) -> list[str]:
    """Return the table of a kind's components, with links to their headings on a page; empty: the same page."""
    rows = [
        [f"[`{component.name}`]({page}#{_slug(_heading(component))})", _summary(component)] for component in components
    ]
    return _table([kind, "what it is"], rows)


def _section_page() -> list[str]:
    lines = ["# Sections of a study", "", f"Sections of a study that are not components. {HOW_TO_READ}"]
    for name, owner in SECTIONS.items():
        lines += ["", f"## {_section_title(name)}", "", *_described(owner), *_parameters(owner)]
    return lines


def _section_title(name: str) -> str:
    return f"`[{name}]`" if " " not in name else name.capitalize()


def _component_pages(components: Sequence[type[Component]]) -> list[str]:
    lines = []
    for component in components:
        lines += ["", f"## {_heading(component)}", ""]
        lines += [*_described(component), *_parameters(component), *_presets(component)]
    for (name, table), owners in _inner_tables(components).items():
        shared = ", ".join(f"`{owner}`" for owner in owners)
        lines += ["", f"## `{name}` of {shared}", "", *_described(table), *_parameters(table)]
    return lines


def _heading(component: type[Component]) -> str:
    return f"{component.kind} `{component.name}`, version {component.version}"


def _slug(heading: str) -> str:
    """Return the anchor that GitHub, and the site, give a heading."""
    return re.sub(r"[^\w\s-]", "", heading.lower()).replace(" ", "-")


def _summary(component: type[Component]) -> str:
    """Return the first line of a component's description."""
    return inspect.cleandoc(component.__doc__ or "").partition("\n")[0].replace("``", "`")


def _inner_tables(components: Iterable[type[Component]]) -> dict[tuple[str, type[Parameters]], list[str]]:
    """Return the tables that parameters take, such as `curve`, with the names of the components that have them."""
    found: dict[tuple[str, type[Parameters]], list[str]] = {}
    for component in components:
        for name, info in component.model_fields.items():
            table = _inner_table(info.annotation)
            if table:
                found.setdefault((name, table), []).append(component.name)
    return found


def _inner_table(annotation: Any) -> type[Parameters] | None:
    """Return the parameters within a parameter; None for a component or plain data."""
    for candidate in (annotation, *get_args(annotation)):
        if inspect.isclass(candidate) and issubclass(candidate, Parameters) and not issubclass(candidate, Component):
            return candidate
    return None


def _described(owner: type[Parameters]) -> list[str]:
    return [*inspect.cleandoc(owner.__doc__ or "").replace("``", "`").splitlines(), ""]


def _parameters(owner: type[Parameters]) -> list[str]:
    fields = owner.model_fields.items()
    if not fields:
        return ["No parameters."] if not getattr(owner, "suffixes", ()) else [f"Reads {', '.join(_suffixes(owner))}."]
    return list(_table(["parameter", "kind", "unit", "default", "bounds", "meaning"], (_row(*pair) for pair in fields)))


def _presets(component: type[Component]) -> list[str]:
    names = ", ".join(f"`{name}`" for name in component.presets)
    return ["", f"Presets: {names}."] if names else []


def _suffixes(owner: Any) -> list[str]:
    return [f"`{suffix}`" for suffix in owner.suffixes]


def _row(name: str, info: FieldInfo) -> list[str]:
    bounds = [
        f"{BOUND_SIGNS[word]} {getattr(item, word):g}"
        for item in info.metadata
        for word in BOUND_SIGNS
        if hasattr(item, word)
    ]
    return [f"`{name}`", _kind(info), unit_of(info), _default(info), ", ".join(bounds), info.description or ""]


def _kind(info: FieldInfo) -> str:
    nested = nested_kind(info)
    if nested is None:
        return _word(info.annotation)
    several = get_origin(info.annotation) is tuple
    return f"list of {nested.kind} components" if several else f"{nested.kind} component"


def _word(annotation: Any) -> str:
    origin, parts = get_origin(annotation), [part for part in get_args(annotation) if part not in (type(None), ...)]
    if origin is Literal:
        return " or ".join(f'`"{choice}"`' for choice in parts)
    if origin is tuple:
        return f"list of {_plural(_word(parts[0]))}"
    if origin is dict:
        return "table" if parts[1] is Any else f"table of {_word(parts[1])}s"
    if inspect.isclass(annotation) and issubclass(annotation, Parameters) and annotation not in SECTIONS.values():
        return "table"
    if parts:  # optional
        return _word(parts[0])
    return WORDS.get(annotation) or annotation.__name__.lower()


def _plural(word: str) -> str:
    return f"lists{word.removeprefix('list')}" if word.startswith("list") else f"{word}s"


def _default(info: FieldInfo) -> str:
    place = inherited_from(info)
    if place:
        return f"from `{place}`"
    if info.is_required():
        return "required"
    value = info.default
    if value is None or value == "":
        return ""
    return f"`{str(value).lower() if isinstance(value, bool) else list(value) if isinstance(value, tuple) else value}`"


PLACES = {
    "FraexpApp": "everywhere", "Page": "everywhere", "PagedTable": "lists", "SweepTable": "lists of sweeps",
    "FilterLine": "filter", "SweepFilter": "filter", "TaggingPage": "sweeps", "TextSection": "sweep",
    "HelpPage": "help", "InputDialog": "questions", "ConfirmDialog": "yes or no",
    "NumberInput": "trial",
}  # fmt: skip
"""Where keys are found, by the class that has them; others by its name."""


KEY_TEXTS = {
    "escape": "Esc",
    "space": "Space",
    "minus": "-",
    "plus": "+",
    "slash": "/",
    "pageup": "PgUp",
    "pagedown": "PgDn",
}
"""Texts of keys whose name is neither their character nor its name in Unicode."""


def _keys() -> list[str]:
    rows = [
        [
            PLACES.get(owner.__name__, owner.__name__.removesuffix("Page").lower()),
            " ".join(f"`{_key_text(key)}`" for key in binding.key.split(",")),
            binding.tooltip or binding.description,
        ]
        for owner in _screens_and_widgets()
        for binding in owner.__dict__.get("BINDINGS", ())
        if binding.tooltip or binding.description
    ]
    first = list(dict.fromkeys(PLACES.values()))
    rows.sort(key=lambda row: (first.index(row[0]) if row[0] in first else len(first), row[0]))
    return ["# Keys of the terminal UI", "", *_table(["where", "keys", "what it does"], rows)]


def _screens_and_widgets() -> Iterator[type]:
    """Yield the classes of the terminal UI that may have keys."""
    for info in sorted(pkgutil.walk_packages(fraexp.tui.__path__, "fraexp.tui."), key=lambda info: info.name):
        module = importlib.import_module(info.name)
        for _, owner in inspect.getmembers(module, inspect.isclass):
            if owner.__module__ == module.__name__:
                yield owner


def _key_text(key: str) -> str:
    """Return the text of a key: ``?`` for question_mark."""
    if key in KEY_TEXTS or len(key) == 1:
        return KEY_TEXTS.get(key, key)
    try:
        return unicodedata.lookup(key.replace("_", " "))
    except KeyError:
        return key.capitalize()


def _commands() -> list[str]:
    lines = ["# Commands and options", "", "The same as `fraexp COMMAND --help`.", "", "## Exit codes", ""]
    lines += _table(["code", "meaning"], ([str(code.value), code.sentence] for code in ExitCode))
    parser = _parser(list(COMMANDS))
    common = [action for action in parser._actions if action.option_strings]
    known = {option for action in common for option in action.option_strings}
    lines += ["", "## Options of every command", "", *_options(common)]
    (commands,) = (action.choices for action in parser._actions if isinstance(action.choices, Mapping))
    for name, command in commands.items():
        own = [action for action in command._actions if not known.issuperset(action.option_strings or [""])]
        optional = [] if all(action.required for action in own) else ["[options]"]
        usage = ["fraexp", name, *optional, *(_usage(action) for action in own if action.required)]
        lines += ["", f"## `fraexp {name}`", "", str(command.description), "", f"    {' '.join(usage)}"]
        lines += ["", *_options(own)] if own else []
    return [*lines, ""]


def _usage(action: argparse.Action) -> str:
    value = action.metavar or (action.dest.upper() if action.nargs != 0 else "")
    if action.choices:
        value = "|".join(action.choices)
    text = " ".join([*action.option_strings[:1], str(value)]).strip()
    if action.nargs == "*":
        return f"[{text} ...]"
    return f"{text} [{text} ...]" if action.nargs == "+" else text


def _options(actions: Iterable[argparse.Action]) -> list[str]:
    rows = []
    for action in actions:
        value = _usage(action).removeprefix((action.option_strings or [""])[0]).strip()
        names = ", ".join(sorted(action.option_strings, key=len)) or str(action.metavar)
        rows.append([f"`{names} {value}`" if action.option_strings and value else f"`{names}`", action.help or ""])
    return _table(["argument", "meaning"], rows)


def _table(titles: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return a table without the columns in which nothing stands."""
    cells = [[cell.replace("|", "\\|").replace("*", "\\*") for cell in row] for row in rows]
    kept = [index for index in range(len(titles)) if any(row[index] for row in cells)]
    lines = [titles, ["---"] * len(titles), *cells]
    return ["| " + " | ".join(line[index] for index in kept) + " |" for line in lines]


if __name__ == "__main__":
    main(Path(sys.argv[1]))
