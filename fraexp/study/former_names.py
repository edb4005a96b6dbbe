"""Names of today for what a study calls by a former name: sections, components, parameters, and paths to them.

A component declares the former names of its parameters itself (`Parameters.renamed`, `Component.former_names`). Here
they are replaced in what people write, before anything is merged, labelled or hashed.
"""

import shlex
import warnings
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic.fields import FieldInfo

from fraexp.components.kinds import nested_kind
from fraexp.components.parameters import Parameters, inherited_from
from fraexp.components.registry import Registry
from fraexp.data.sweep import Plain
from fraexp.errors import FormerNameWarning, FraexpError, StudyError
from fraexp.records import RecordSettings
from fraexp.simulation.motion_limits import MotionLimits
from fraexp.study.paths import component_of, parameters_in
from fraexp.study.random_draws import Draw
from fraexp.study.sections import COMPONENTS, SECTIONS, SETTINGS, nested_table, overlay

SECTION_NAMES = {"random": "monte_carlo", "printed": "published"}
"""Former names of sections, all of which stand in a study's file alone."""
CASES, GRID, DRAWS, PUBLISHED = "case", "grid", "monte_carlo", "published"


class CurrentNames:
    """What studies write, under the names of today; `renamed` collects the former ones by their paths."""

    def __init__(self, registry: Registry, place: str) -> None:
        self._registry, self._place = registry, place
        self.renamed: dict[str, str] = {}

    def study(self, data: Plain, machine: Plain) -> dict[str, Any]:
        """Return the data of a study's file; `machine` has the sections that it starts from."""
        data, renamed = current_tables(data, self._place), data.keys() & SECTION_NAMES.keys()
        self.renamed |= {f"[{old}]": f"[{SECTION_NAMES[old]}]" for old in sorted(renamed)}
        result = {**data, **self.sections(data, machine)}
        below = _overlay_sections(machine, result)
        if cases := _tables(data.get(CASES)):
            result[CASES] = [{**case, **self.sections(case, below)} for case in cases]
        variants = _variants(result, machine)
        if isinstance(data.get(GRID), Mapping):
            result[GRID] = dict(self._axis(path, values, variants) for path, values in data[GRID].items())
        if isinstance(data.get(DRAWS), Mapping):
            result[DRAWS] = self._draws(data[DRAWS], variants)
        if PUBLISHED in data:
            result[PUBLISHED] = [self._published(table, variants) for table in _tables(data[PUBLISHED])] or data[
                PUBLISHED
            ]
        return result

    def change(self, path: str, value: Any, data: Plain, machine: Plain) -> tuple[str, Any]:
        """Return path and value of what the command line sets in a study whose names are those of today."""
        head, _, rest = path.partition(".")
        if head == GRID:
            axis, values = self._axis(rest, value, _variants(data, machine))
            return f"{GRID}.{axis}", values
        if head in SECTION_NAMES:
            self.renamed[path] = path = f"{SECTION_NAMES[head]}.{rest}"
        if path == f"{DRAWS}.draw":
            return path, self._draws({"draw": value}, _variants(data, machine))["draw"]
        return self.path(path, value, _variants(data, machine))

    def sections(self, layer: Plain, below: Plain) -> dict[str, Any]:
        """Return the sections of a layer; those `below` it say which component an unnamed table belongs to."""
        return {
            key: self._table(self._owner_of_section(key, value, below.get(key)), value, below, below.get(key), key)
            if isinstance(value, Mapping)
            else value
            for key, value in layer.items()
            if key in SECTIONS
        }

    def path(self, path: str, value: Any, variants: Iterable[Plain]) -> tuple[str, Any]:
        """Return a path into the sections, and the value that it gets; `variants` are the sections of each case."""
        if path.partition(".")[0] not in SECTIONS:
            return path, value
        found = (path, value)
        for below in variants:
            found = _path_and_value(self.sections(nested_table(path, value), below), path.count(".") + 1)
            if found != (path, value):
                break
        return found

    def _axis(self, path: str, values: Any, variants: Sequence[Plain]) -> tuple[str, Any]:
        if not isinstance(values, list) or not values:
            return self.path(path, None, variants)[0], values
        pairs = [self.path(path, value, variants) for value in values]
        return pairs[0][0], [value for _, value in pairs]

    def _draws(self, section: Plain, variants: Sequence[Plain]) -> dict[str, Any]:
        tables = [self._table(Draw, table, {}, None, f"{DRAWS}.draw") for table in _tables(section.get("draw"))]
        for table in tables:
            paths = table.get("paths")
            if isinstance(paths, str):
                table["paths"] = self.path(paths, None, variants)[0]
            elif isinstance(paths, list):
                table["paths"] = [self.path(of, None, variants)[0] if isinstance(of, str) else of for of in paths]
        return {**section, "draw": tables} if tables else dict(section)

    def _published(self, table: Plain, variants: Sequence[Plain]) -> dict[str, Any]:
        where = table.get("where")
        if not isinstance(where, Mapping):
            return dict(table)
        return {**table, "where": dict(self.path(path, value, variants) for path, value in where.items())}

    def _table(
        self, owner: type[Parameters] | None, table: Plain, sections: Plain, known: Any, place: str
    ) -> dict[str, Any]:
        if owner is None:
            return dict(table)
        try:
            current = owner.with_current_names(table)
        except FraexpError as error:
            raise type(error)(f"{self._place}, [{place}]: {error}") from None
        for old, new in zip(table, current, strict=True):
            if old != new:
                self.renamed[f"{place}.{old}"] = f"{place}.{new}"
        before = known if isinstance(known, Mapping) else {}
        return {
            key: self._name(owner, value, place)
            if key == "name"
            else self._inner(owner.model_fields.get(key), value, sections, before.get(key), f"{place}.{key}")
            for key, value in current.items()
        }

    def _inner(self, info: FieldInfo | None, value: Any, sections: Plain, known: Any, place: str) -> Any:
        if isinstance(value, list):
            return [self._inner(info, item, sections, None, place) for item in value]
        if info is None or not isinstance(value, Mapping):
            return value
        if isinstance(known, list):  # a path such as parts.0.amplitude
            at = {str(number): item for number, item in enumerate(known)}
            return {
                key: self._inner(info, item, sections, at.get(key), f"{place}.{key}") for key, item in value.items()
            }
        return self._table(self._owner(info, value, sections, known), value, sections, known, place)

    def _name(self, owner: type[Parameters], value: Any, place: str) -> Any:
        """Return the name of today of the component that a table names."""
        current = getattr(owner, "name", value)
        if value in getattr(owner, "former_names", ()):
            self.renamed[f"{place}.name = '{value}'"] = f"'{current}'"
            return current
        return value

    def _owner_of_section(self, key: str, value: Any, known: Any) -> type[Parameters] | None:
        if key in SETTINGS:
            return SETTINGS[key]
        if key == "record":
            return RecordSettings
        return component_of(key, _first_named(value, known), self._registry) if key in COMPONENTS else None

    def _owner(self, info: FieldInfo, value: Plain, sections: Plain, known: Any) -> type[Parameters] | None:
        kind = nested_kind(info)
        if kind is None:
            return next(iter(parameters_in(info)), None)
        return component_of(
            kind.kind, _first_named(value, known, sections.get(inherited_from(info) or "")), self._registry
        )

    def warn(self, file: Path | str) -> None:
        """Tell in one line, as a warning, which former names a file or an option uses."""
        if self.renamed:
            told = ", ".join(f"{old} is now {new}{_other_meaning(old)}" for old, new in self.renamed.items())
            remedy = (
                f"; fraexp migrate --studies {shlex.quote(str(file))} rewrites it" if isinstance(file, Path) else ""
            )
            warnings.warn(f"{file}: {told}{remedy}", FormerNameWarning, stacklevel=4)


def _other_meaning(old: str) -> str:
    """Return that a former name means something else in another section today; empty if it does not."""
    section, _, name = old.rpartition(".")
    is_limit = section == "loop" and name in MotionLimits.model_fields
    return f" (what the machine allows is limits.{name})" if is_limit else ""


def current_tables(data: Plain, place: object) -> dict[str, Any]:
    """Return the data of a study's file with current section names; what the sections contain is unchanged."""
    for old in data.keys() & SECTION_NAMES.keys():
        if SECTION_NAMES[old] in data:
            raise StudyError(f"{place}: [{old}] is now called [{SECTION_NAMES[old]}], and both are given; remove one")
    return {SECTION_NAMES.get(key, key): value for key, value in data.items()}


def _variants(data: Plain, machine: Plain) -> list[dict[str, Any]]:
    """Return the sections of each case of a study, or those of a study without cases."""
    below = _overlay_sections(machine, data)
    return [_overlay_sections(below, case) for case in _tables(data.get(CASES))] or [below]


def _tables(value: Any) -> list[Plain]:
    return value if isinstance(value, list) and all(isinstance(table, Mapping) for table in value) else []


def _first_named(*candidates: Any) -> Any:
    """Return the first table that names a component."""
    return next((table for table in candidates if isinstance(table, Mapping) and "name" in table), None)


def _overlay_sections(below: Plain, layer: Plain) -> dict[str, Any]:
    return {**below, **{key: overlay(below.get(key, {}), layer[key]) for key in SECTIONS if key in layer}}


def _path_and_value(sections: Plain, depth: int) -> tuple[str, Any]:
    """Return the path of `depth` keys through tables with one key each, and the value at its end."""
    parts, value = [], sections
    for _ in range(depth):
        ((part, value),) = value.items()
        parts.append(part)
    return ".".join(parts), value
