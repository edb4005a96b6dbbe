"""The launch form of a study: a field for each parameter, with its path, meaning and allowed values."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from pydantic.fields import FieldInfo

from fraexp.components.kinds import KINDS_BY_PORT, nested_kind, parameter_group
from fraexp.components.parameters import Parameters, inherited_from
from fraexp.components.registry import Registry
from fraexp.data import toml
from fraexp.data.rotary_axes import is_rotary
from fraexp.data.sweep import components_by_port
from fraexp.study.paths import unit_at
from fraexp.study.sections import COMPONENTS, GRID, SECTIONS, SETTINGS
from fraexp.views.components import parameter_document
from fraexp.views.entries import ParameterEntry, entry_text

PlainSection = Mapping[str, object]
EXECUTOR_OPTION, RERUN_OPTION = "--executor", "--rerun"
"""Paths of fields that are options of the command instead of parameters."""
RERUN_CHOICES = ("stale", "unusable", "all")
CASES_DIFFER = "differs between cases"
FIRST_SECTIONS = ("excitation", "estimator", "friction", "loop")
SECTION_ORDER = (*FIRST_SECTIONS, *(key for key in SECTIONS if key not in (*FIRST_SECTIONS, "record")))
"""Sections, those that are changed most often first."""


def keep_text(text: str, share: float) -> str:
    """Return a text that has no next one."""
    return text


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
    label: str = ""
    """Shown in place of the path."""
    step: Callable[[str, float], str] = keep_text
    """Return a text increased by a fraction of itself, or the next choice."""

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
        free = [field for field in fields if not any(f"{field.path}.".startswith(f"{axis}.") for axis in axes)]
        groups.append(FieldGroup(kind, tuple(free)))
    return [group for group in groups if group.fields]


def override_texts(changes: Mapping[str, str]) -> list[str]:
    """Return the ``--set`` values of changed fields."""
    return [f"{path}={text}" for path, text in changes.items() if path not in (EXECUTOR_OPTION, RERUN_OPTION)]


def find_concerned(path: str, fields: Sequence[FormField]) -> FormField | None:
    """Return the field of a parameter's path, or the one in which it lies; None if there is none.

    Of a table in a component the path may lack the table's name.
    """
    section, _, name = path.partition(".")
    found = [field for field in fields if f"{path}.".startswith(f"{field.path}.")]
    found += [of for of in fields if name and of.path.startswith(f"{section}.") and of.path.endswith(f".{name}")]
    return max(found, key=lambda field: len(field.path)) if found else None


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
    yield FormField(f"{path}.name", name, "", hint, instead, choices)
    provider = registry.providers.get((kind, name))
    if provider is not None:
        yield from _parameter_fields(path, provider.component, specs, registry, name, rotary)


def _parameter_fields(
    path: str, owner: type[Parameters], specs: Sequence[object], registry: Registry, title: str, rotary: bool
) -> Iterator[FormField]:
    presets = getattr(owner, "presets", {})
    spec = specs[0] if isinstance(specs[0], Mapping) else {}
    if presets:
        hint = f"named set of values: {', '.join(presets)}"
        text = str(spec.get("preset", ""))
        yield FormField(f"{path}.preset", text, "", hint, "none", tuple(presets))
    base = presets.get(spec.get("preset"), {}) if isinstance(spec.get("preset"), str) else {}
    for name, info in owner.model_fields.items():
        values = [of.get(name) if isinstance(of, Mapping) else None for of in specs]
        place, inner, group = f"{path}.{name}", nested_kind(info), parameter_group(info)
        if inner is not None and all(isinstance(value, Mapping) and "name" in value for value in values):
            yield from _component_fields(place, inner.kind, values, registry, rotary)
        elif group is not None and all(isinstance(value, Mapping) for value in values):
            yield from _parameter_fields(place, group, values, registry, f"{title}.{name}", rotary)
        else:
            yield _parameter_field(place, info, values, base.get(name), title, rotary)


def _parameter_field(
    path: str, info: FieldInfo, values: Sequence[object], preset: object, title: str, rotary: bool
) -> FormField:
    name = path.rpartition(".")[2]
    document = parameter_document(name, info, rotary=rotary)
    origin, same = inherited_from(info), all(value == values[0] for value in values)
    instead = "required" if document["required"] else entry_text(document["default"])
    instead = f"from {origin}" if origin else entry_text(preset) if preset is not None else instead
    entry = ParameterEntry(path, info, "", rotary)
    return FormField(
        path,
        entry_text(values[0]) if same else "",
        document["unit"],
        entry.hint,
        (instead or "not given") if same else CASES_DIFFER,
        entry.choices,
    )


def _axis_field(
    path: str, values: list[object], sections: PlainSection, leaves: Mapping[str, FormField], registry: Registry
) -> FormField:  # fmt: skip
    leaf = leaves.get(path, FormField(path))

    unit = leaf.unit or unit_at(sections, path, registry)
    hint = f"list of values; the grid combines those of all axes. {leaf.hint}".strip()
    return replace(leaf, path=f"{GRID}{path}", text=toml.dumps(values), unit=unit, hint=hint, choices=(), instead="")


def _random_fields(section: PlainSection) -> tuple[FormField, ...]:
    count, seed = entry_text(section.get("count")), entry_text(section.get("seed", 0))
    return (
        FormField("monte_carlo.count", count, hint="number of random machines"),
        FormField("monte_carlo.seed", seed, hint="seed of the random numbers"),
    )


OPTION_FIELDS = (
    FormField(
        EXECUTOR_OPTION,
        hint="serial, or processes:N for N processes",
        instead="all cores, or one process where that is faster",
        choices=("serial", "processes"),
    ),
    FormField(
        RERUN_OPTION,
        hint="stored sweeps to compute again: stale (a plugin has changed), unusable (no usable result), or all",
        instead="stored sweeps are reused", choices=RERUN_CHOICES,
    ),
)  # fmt: skip
