"""The launch form of a study: a field for each parameter, with its path, meaning and allowed values."""

import inspect
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, get_args

from pydantic.fields import FieldInfo

from fraexp.components.kinds import KINDS_BY_PORT, Component, nested_kind
from fraexp.components.parameters import Parameters, inherited_from
from fraexp.components.registry import Registry
from fraexp.data import toml
from fraexp.data.rotary_axes import is_rotary, rotary_text, rotary_unit
from fraexp.data.sweep import components_by_port
from fraexp.errors import FraexpError, did_you_mean
from fraexp.execution.executors import worker_count
from fraexp.study.paths import unit_at
from fraexp.study.sections import COMPONENTS, GRID, SECTIONS, SETTINGS, override
from fraexp.views.components import parameter_document
from fraexp.views.entries import ParameterEntry
from fraexp.views.fields import toml_value

PlainSection = Mapping[str, object]
EXECUTOR_OPTION, RERUN_OPTION = "--executor", "--rerun"
"""Paths of fields that are options of the command instead of parameters."""
RERUN_CHOICES = ("stale", "unusable", "all")
CASES_DIFFER = "differs between cases"
FIRST_SECTIONS = ("excitation", "estimator", "friction", "loop")
SECTION_ORDER = (*FIRST_SECTIONS, *(key for key in SECTIONS if key not in (*FIRST_SECTIONS, "record")))
"""Sections, those that are changed most often first."""


def no_fault(text: str) -> str:
    """Return no fault, for a text that cannot be checked by itself."""
    return ""


@dataclass(frozen=True)
class FormField:
    """An editable value."""

    path: str
    """Path for ``--set``, or the name of an option."""
    text: str = ""
    """Value as written in the study; empty if it is not given."""
    unit: str = ""
    hint: str = ""
    """Meaning, bounds and default in one line."""
    instead: str = ""
    """Value that applies if the text is empty."""
    choices: tuple[str, ...] = ()
    fault: Callable[[str], str] = no_fault
    """Return the fault of a text; empty if it is valid, or cannot be checked by itself."""
    named: tuple[str, ...] = ()
    """Names of the field in error messages."""

    @property
    def chooses(self) -> bool:
        """Whether it determines other fields."""
        return self.path.endswith((".name", ".preset"))


@dataclass(frozen=True)
class FieldGroup:
    """The fields of a section."""

    title: str
    fields: tuple[FormField, ...]


def build_form(
    cases: Sequence[PlainSection], axes: Mapping[str, list[object]], random: object, registry: Registry
) -> list[FieldGroup]:
    """Return all fields of a study: the axes of its grid, then the sections of its cases."""
    simulated = "record" not in cases[0]  # the settings of a record are those of its file
    kinds = [key for key in SECTION_ORDER if key in cases[0] or (key == "numerics" and simulated)]
    rotary = is_rotary(cases[0])
    every = {
        kind: list(_section_fields(kind, [case.get(kind, {}) for case in cases], registry, rotary)) for kind in kinds
    }
    leaves = {field.path: field for fields in every.values() for field in fields}
    groups = [FieldGroup("grid", tuple(_axis_field(path, axes[path], cases[0], leaves, registry) for path in axes))]
    groups += [FieldGroup("monte_carlo", _random_fields(random))] if isinstance(random, Mapping) else []
    groups += [FieldGroup("run", OPTION_FIELDS)]
    for kind, fields in every.items():
        free = [field for field in fields if not _is_axis(field.path, axes)]
        groups.append(FieldGroup(kind, tuple(free)))
    return [group for group in groups if group.fields]


def override_texts(changes: Mapping[str, str]) -> list[str]:
    """Return the ``--set`` values of changed fields."""
    return [f"{path}={text}" for path, text in changes.items() if path not in (EXECUTOR_OPTION, RERUN_OPTION)]


def find_concerned(error: str, fields: Sequence[FormField]) -> FormField | None:
    """Return the field that an error names; None if it names none."""
    for field in fields:
        if any(re.search(rf"(?<![\w.]){re.escape(name)}(?![\w.])", error) for name in (field.path, *field.named)):
            return field
    return None


def _is_axis(path: str, axes: Mapping[str, object]) -> bool:
    return any(path == axis or path.startswith(f"{axis}.") for axis in axes)


def _section_fields(kind: str, specs: Sequence[object], registry: Registry, rotary: bool) -> Iterator[FormField]:
    """Yield the fields of a section, from the values of each case."""
    ports = list(components_by_port(specs[0])) if kind in KINDS_BY_PORT else []
    if kind not in COMPONENTS:
        yield from _parameter_fields(kind, SETTINGS[kind], specs, registry, kind, rotary)
    elif ports and all(list(components_by_port(spec)) == ports for spec in specs):
        for port in ports:
            parts = [components_by_port(spec)[port] for spec in specs]
            yield from _component_fields(f"{kind}.{port}", kind, parts, registry, rotary)
    else:
        yield from _component_fields(kind, kind, specs, registry, rotary)


def _component_fields(
    path: str, kind: str, specs: Sequence[object], registry: Registry, rotary: bool
) -> Iterator[FormField]:
    """Yield a component's name, then its parameters."""
    names = {str(spec.get("name", "")) if isinstance(spec, Mapping) else "" for spec in specs}
    name = names.pop() if len(names) == 1 else ""
    choices = tuple(registry.names(kind))
    hint = f"name of the {kind}: {', '.join(choices)}"
    instead = "required" if not names else CASES_DIFFER
    yield FormField(
        f"{path}.name", name, "", hint, instead, choices, lambda text: _component_fault(kind, text, registry)
    )
    provider = registry.providers.get((kind, name))
    if provider is not None:
        yield from _parameter_fields(path, provider.component, specs, registry, name, rotary)


def _component_fault(kind: str, text: str, registry: Registry) -> str:
    names = registry.names(kind)
    return "" if text in names else f"no {kind} is called '{text}'{did_you_mean(text, names)}"


def _parameter_fields(
    path: str, owner: type[Parameters], specs: Sequence[object], registry: Registry, title: str, rotary: bool
) -> Iterator[FormField]:
    presets = getattr(owner, "presets", {})
    spec = specs[0] if isinstance(specs[0], Mapping) else {}
    if presets:
        hint = f"named set of values: {', '.join(presets)}"
        text = str(spec.get("preset", ""))
        yield FormField(
            f"{path}.preset", text, "", hint, "none", tuple(presets), lambda text: _preset_fault(text, presets)
        )
    base = presets.get(spec.get("preset"), {}) if isinstance(spec.get("preset"), str) else {}
    for name, info in owner.model_fields.items():
        values = [of.get(name) if isinstance(of, Mapping) else None for of in specs]
        place, inner, group = f"{path}.{name}", nested_kind(info), _parameter_group(info)
        if inner is not None and all(isinstance(value, Mapping) and "name" in value for value in values):
            yield from _component_fields(place, inner.kind, values, registry, rotary)
        elif group is not None and all(isinstance(value, Mapping) for value in values):
            yield from _parameter_fields(place, group, values, registry, f"{title}.{name}", rotary)
        else:
            yield _parameter_field(place, owner, info, values, spec, base.get(name), title, registry, rotary)


def _parameter_field(
    path: str,
    owner: type[Parameters],
    info: FieldInfo,
    values: Sequence[object],
    spec: PlainSection,
    preset: object,
    title: str,
    registry: Registry,
    rotary: bool,
) -> FormField:
    name = path.rpartition(".")[2]
    document = parameter_document(name, info)
    origin, same = inherited_from(info), all(value == values[0] for value in values)
    instead = "required" if document["required"] else field_text(document["default"])
    instead = f"from {origin}" if origin else field_text(preset) if preset is not None else instead
    entry = ParameterEntry(path, info, "")
    given = {key: value for key, value in spec.items() if key not in ("name", "version", "preset")}

    def fault(text: str) -> str:
        value, inner = parse_text(text), nested_kind(info)
        if inner is not None and isinstance(value, Mapping):  # it is checked as a whole with the study
            return _component_fault(inner.kind, str(value["name"]), registry) if "name" in value else ""
        return owner.fault({**given, name: value}, name, title, rotary=rotary)

    return FormField(
        path,
        field_text(values[0]) if same else "",
        rotary_unit(document["unit"]) if rotary else document["unit"],
        rotary_text(entry.hint) if rotary else entry.hint,
        (instead or "not given") if same else CASES_DIFFER,
        entry.choices,
        fault,
        (f"{title}.{name}", f"{title} lacks '{name}'", f"{title}: {name}"),
    )


def _preset_fault(text: str, presets: Mapping[str, object]) -> str:
    return "" if text in presets else f"unknown preset '{text}'{did_you_mean(text, presets)}"


def _parameter_group(info: FieldInfo) -> type[Parameters] | None:
    """Return the type of a parameter group that is not a component, such as the curve of a friction model."""
    for of in (info.annotation, *get_args(info.annotation)):
        if inspect.isclass(of) and issubclass(of, Parameters) and not issubclass(of, Component):
            return of
    return None


def _axis_field(
    path: str, values: list[object], sections: PlainSection, leaves: Mapping[str, FormField], registry: Registry
) -> FormField:  # fmt: skip
    leaf = leaves.get(path, FormField(path))

    def fault(text: str) -> str:
        try:
            _, found = override(f"{GRID}{path}={text}")
        except FraexpError as error:
            return str(error).partition(": ")[2]
        return next((wrong for value in found if (wrong := leaf.fault(field_text(value)))), "")

    unit = leaf.unit or unit_at(sections, path, registry)
    hint = f"list of values; the grid combines those of all axes. {leaf.hint}".strip()
    return replace(
        leaf, path=f"{GRID}{path}", text=toml_value(values), unit=unit, hint=hint, choices=(), instead="", fault=fault
    )


def _random_fields(section: PlainSection) -> tuple[FormField, ...]:
    count, seed = field_text(section.get("count")), field_text(section.get("seed", 0))
    return (
        FormField(
            "monte_carlo.count",
            count,
            hint="number of random machines",
            fault=lambda text: _whole_number_fault(text, 1),
        ),
        FormField(
            "monte_carlo.seed",
            seed,
            hint="seed of the random numbers",
            fault=lambda text: _whole_number_fault(text, 0),
        ),
    )


def _whole_number_fault(text: str, least: int) -> str:
    return "" if text.isdecimal() and int(text) >= least else f"expected a whole number of at least {least}"


def _executor_fault(text: str) -> str:
    try:
        worker_count(text)
    except FraexpError as error:
        return str(error)
    return ""


def _rerun_fault(text: str) -> str:
    return (
        ""
        if text in RERUN_CHOICES
        else f"expected one of {', '.join(RERUN_CHOICES)}{did_you_mean(text, RERUN_CHOICES)}"
    )


OPTION_FIELDS = (
    FormField(
        EXECUTOR_OPTION,
        hint="serial, or processes:N for N processes",
        instead="all cores, or one process where that is faster",
        choices=("serial", "processes"),
        fault=_executor_fault,
    ),
    FormField(
        RERUN_OPTION,
        hint="stored sweeps to compute again: stale (a plugin has changed), unusable (no usable result), or all",
        instead="stored sweeps are reused", choices=RERUN_CHOICES, fault=_rerun_fault,
    ),
)  # fmt: skip


def parse_text(text: str) -> Any:
    """Return the value of a text as ``--set`` reads it."""
    try:
        return toml.value(text.strip())
    except ValueError:
        return text.strip()


def field_text(value: object) -> str:
    """Return a value as text; None and empty lists give an empty text."""
    if value is None or value in ([], ()):
        return ""
    if isinstance(value, float):
        return f"{value:.10g}"
    return value if isinstance(value, str) else toml_value(value)
