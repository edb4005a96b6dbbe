"""What can be set of a study before it is launched: each parameter by its path, with what it means and may be."""

import inspect
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, get_args

from pydantic.fields import FieldInfo

from fraexp.components.kinds import Component, nested_kind
from fraexp.components.parameters import Parameters, inherited_from
from fraexp.components.registry import Registry
from fraexp.data import toml
from fraexp.errors import FraexpError, did_you_mean
from fraexp.execution.executors import workers_of
from fraexp.study.paths import unit_at
from fraexp.study.sections import COMPONENTS, GRID, SECTIONS, SETTINGS, override
from fraexp.views.components import parameter_document
from fraexp.views.entries import ParameterEntry
from fraexp.views.fields import toml_value

Plain = Mapping[str, Any]
EXECUTOR, RERUN = "--executor", "--rerun"
"""Paths of what is no parameter but an option of the command."""
RERUNS = ("stale", "failed", "all")
DIFFER = "the cases differ"
FIRST = ("excitation", "estimator", "friction", "loop")
ORDER = (*FIRST, *(key for key in SECTIONS if key not in (*FIRST, "record")))
"""Sections, first those in which most is changed."""


def unknown(text: str) -> str:
    """Return what is wrong with a text of which nothing can be told alone: nothing."""
    return ""


@dataclass(frozen=True)
class FormField:
    """A value that can be written."""

    path: str
    """As ``--set`` takes it, or the name of an option."""
    text: str = ""
    """As the study writes it; empty where it does not."""
    unit: str = ""
    hint: str = ""
    """Meaning, bounds and default in one line."""
    instead: str = ""
    """What holds where nothing is written."""
    choices: tuple[str, ...] = ()
    fault: Callable[[str], str] = unknown
    """What is wrong with a text; empty if nothing can be told of it alone."""
    named: tuple[str, ...] = ()
    """How errors name it."""

    @property
    def chooses(self) -> bool:
        """Whether other fields follow from it."""
        return self.path.endswith((".name", ".preset"))


@dataclass(frozen=True)
class FieldGroup:
    """The fields of a section."""

    title: str
    fields: tuple[FormField, ...]


def form(cases: Sequence[Plain], axes: Mapping[str, list[Any]], random: Any, registry: Registry) -> list[FieldGroup]:
    """Return all fields of a study, from the sections of its cases and the axes of its grid: those first."""
    simulated = "record" not in cases[0]  # whose settings are the file's: a record is not varied
    kinds = [key for key in ORDER if key in cases[0] or (key == "numerics" and simulated)]
    every = {kind: list(_section(kind, [case.get(kind, {}) for case in cases], registry)) for kind in kinds}
    leaves = {field.path: field for fields in every.values() for field in fields}
    groups = [FieldGroup("grid", tuple(_axis(path, axes[path], cases[0], leaves, registry) for path in axes))]
    groups += [FieldGroup("random", _random(random))] if isinstance(random, Mapping) else []
    groups += [FieldGroup("run", OPTIONS)]
    for kind, fields in every.items():
        free = [field for field in fields if not _taken(field.path, axes)]
        groups.append(FieldGroup(kind, tuple(free)))
    return [group for group in groups if group.fields]


def overrides(changes: Mapping[str, str]) -> list[str]:
    """Return what ``--set`` is given for changed fields, by path."""
    return [f"{path}={text}" for path, text in changes.items() if path not in (EXECUTOR, RERUN)]


def concerned(error: str, fields: Sequence[FormField]) -> FormField | None:
    """Return the field that an error is about; None if that cannot be told."""
    for field in fields:
        if any(re.search(rf"(?<![\w.]){re.escape(name)}(?![\w.])", error) for name in (field.path, *field.named)):
            return field
    return None


def _taken(path: str, axes: Mapping[str, Any]) -> bool:
    return any(path == axis or path.startswith(f"{axis}.") for axis in axes)


def _section(kind: str, specs: Sequence[Any], registry: Registry) -> Iterator[FormField]:
    """Yield the fields of a section, from what each case writes into it."""
    if kind not in COMPONENTS:
        yield from _parameters(kind, SETTINGS[kind], specs, registry, kind)
    else:
        yield from _component(kind, kind, specs, registry)


def _component(path: str, kind: str, specs: Sequence[Any], registry: Registry) -> Iterator[FormField]:
    """Yield a component's name, then its parameters."""
    names = {str(spec.get("name", "")) if isinstance(spec, Mapping) else "" for spec in specs}
    name = names.pop() if len(names) == 1 else ""
    choices = tuple(registry.names(kind))
    hint = f"which {kind}: {', '.join(choices)}"
    instead = "needed" if not names else DIFFER
    yield FormField(f"{path}.name", name, "", hint, instead, choices, lambda text: _no_component(kind, text, registry))
    supply = registry.supplies.get((kind, name))
    if supply is not None:
        yield from _parameters(path, supply.component, specs, registry, name)


def _no_component(kind: str, text: str, registry: Registry) -> str:
    names = registry.names(kind)
    return "" if text in names else f"no {kind} is called '{text}'{did_you_mean(text, names)}"


def _parameters(
    path: str, owner: type[Parameters], specs: Sequence[Any], registry: Registry, title: str
) -> Iterator[FormField]:
    presets = getattr(owner, "presets", {})
    spec = specs[0] if isinstance(specs[0], Mapping) else {}
    if presets:
        hint = f"named set of values: {', '.join(presets)}"
        text = str(spec.get("preset", ""))
        yield FormField(
            f"{path}.preset", text, "", hint, "none", tuple(presets), lambda text: _no_preset(text, presets)
        )
    base = presets.get(spec.get("preset"), {}) if isinstance(spec.get("preset"), str) else {}
    for name, info in owner.model_fields.items():
        values = [of.get(name) if isinstance(of, Mapping) else None for of in specs]
        place, inner, group = f"{path}.{name}", nested_kind(info), _group(info)
        if inner is not None and all(isinstance(value, Mapping) and "name" in value for value in values):
            yield from _component(place, inner.kind, values, registry)
        elif group is not None and all(isinstance(value, Mapping) for value in values):
            yield from _parameters(place, group, values, registry, f"{title}.{name}")
        else:
            yield _leaf(place, owner, info, values, spec, base.get(name), title, registry)


def _leaf(
    path: str, owner: type[Parameters], info: FieldInfo, values: Sequence[Any], spec: Plain, preset: Any, title: str,
    registry: Registry,
) -> FormField:  # fmt: skip
    name = path.rpartition(".")[2]
    document = parameter_document(name, info)
    origin, same = inherited_from(info), all(value == values[0] for value in values)
    instead = "needed" if document["required"] else text_of(document["default"])
    instead = f"from {origin}" if origin else text_of(preset) if preset is not None else instead
    entry = ParameterEntry(path, info, "")
    given = {key: value for key, value in spec.items() if key not in ("name", "version", "preset")}

    def fault(text: str) -> str:
        value, inner = parsed(text), nested_kind(info)
        if inner is not None and isinstance(value, Mapping):  # as a whole it is checked with the study
            return _no_component(inner.kind, str(value["name"]), registry) if "name" in value else ""
        return owner.fault({**given, name: value}, name, title)

    return FormField(
        path,
        text_of(values[0]) if same else "",
        document["unit"],
        entry.hint,
        (instead or "not given") if same else DIFFER,
        entry.choices,
        fault,
        (f"{title}.{name}", f"{title} lacks '{name}'", f"{title}: {name}"),
    )


def _no_preset(text: str, presets: Mapping[str, Any]) -> str:
    return "" if text in presets else f"there is no preset '{text}'{did_you_mean(text, presets)}"


def _group(info: FieldInfo) -> type[Parameters] | None:
    """Return the parameters that one holds which is no component, such as a friction's curve."""
    for of in (info.annotation, *get_args(info.annotation)):
        if inspect.isclass(of) and issubclass(of, Parameters) and not issubclass(of, Component):
            return of
    return None


def _axis(
    path: str, values: list[Any], sections: Plain, leaves: Mapping[str, FormField], registry: Registry
) -> FormField:  # fmt: skip
    leaf = leaves.get(path, FormField(path))

    def fault(text: str) -> str:
        try:
            _, found = override(f"{GRID}{path}={text}")
        except FraexpError as error:
            return str(error).partition(": ")[2]
        return next((wrong for value in found if (wrong := leaf.fault(text_of(value)))), "")

    unit = leaf.unit or unit_at(sections, path, registry)
    hint = f"all these values, each with each of the other axes. {leaf.hint}".strip()
    return replace(
        leaf, path=f"{GRID}{path}", text=toml_value(values), unit=unit, hint=hint, choices=(), instead="", fault=fault
    )


def _random(section: Plain) -> tuple[FormField, ...]:
    count, seed = text_of(section.get("count")), text_of(section.get("seed", 0))
    return (
        FormField("random.count", count, hint="how many machines are drawn", fault=lambda text: _whole(text, 1)),
        FormField("random.seed", seed, hint="another seed draws other machines", fault=lambda text: _whole(text, 0)),
    )


def _whole(text: str, least: int) -> str:
    return "" if text.isdecimal() and int(text) >= least else f"expected a whole number, {least} at least"


def _no_executor(text: str) -> str:
    try:
        workers_of(text)
    except FraexpError as error:
        return str(error)
    return ""


def _no_rerun(text: str) -> str:
    return "" if text in RERUNS else f"expected one of {', '.join(RERUNS)}{did_you_mean(text, RERUNS)}"


OPTIONS = (
    FormField(
        EXECUTOR, hint="serial, or processes:N for N at once", instead="all cores, or one where that is faster",
        choices=("serial", "processes"), fault=_no_executor,
    ),
    FormField(
        RERUN, hint="what is computed again: stale (a plugin's source has changed), failed, or all",
        instead="nothing that is stored", choices=RERUNS, fault=_no_rerun,
    ),
)  # fmt: skip


def parsed(text: str) -> Any:
    """Return the value of a text as ``--set`` reads it."""
    try:
        return toml.value(text.strip())
    except ValueError:
        return text.strip()


def text_of(value: Any) -> str:
    """Return a value as it is written; nothing for none."""
    if value is None or value in ([], ()):
        return ""
    if isinstance(value, float):
        return f"{value:.10g}"
    return value if isinstance(value, str) else toml_value(value)
