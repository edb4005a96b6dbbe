"""From what a study writes to sweeps: every section is checked and completed once for all points that share it.

A section may inherit values from others: an estimator its friction model from the machine, for example. What it is
resolved to therefore follows from its own text and from the sections that it inherits from, and is kept by the
hashes of both.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fraexp.components.kinds import KINDS_BY_PORT, Excitation, Plant, nested_kind
from fraexp.components.parameters import Parameters, inherited_from
from fraexp.components.registry import Registry, create
from fraexp.data import fit_references, toml
from fraexp.data.rotary_axes import is_rotary
from fraexp.data.sweep import Plain, Section, Sweep, as_section, components_by_port, experiment_key
from fraexp.errors import FraexpError, StudyError
from fraexp.simulation import motion_limits
from fraexp.simulation.machine import Numerics, build_machine
from fraexp.simulation.motion_limits import MotionLimits
from fraexp.study.paths import component_of
from fraexp.study.sections import MACHINE, SETTINGS, is_for_autonomous, merge, nested_table, overlay

EXCITATION, ESTIMATOR = INHERITING = (Excitation.kind, "estimator")
"""Components that inherit from resolved sections; all other sections inherit from the sections as written."""
OF_A_DRIVE = ("friction", EXCITATION, "loop")
OF_A_LOOP = (*MACHINE, EXCITATION, "numerics")


@dataclass(frozen=True)
class _Row:
    """Points of a grid that differ in one section only: those along its last axis."""

    sections: Mapping[str, Any]
    """What is written at the first of them."""
    inner: str
    """Section that the last axis varies; empty for a study without a grid."""
    variants: Sequence[Any]
    """That section at each point."""
    values: Sequence[tuple[Any, ...]]
    """Value of each axis, at each point."""


def _grid_rows(sections: Plain, grid: Mapping[str, Sequence[Any]], place: str) -> Iterator[_Row]:
    """Yield the rows of a grid in the order of its points; the last axis varies fastest.

    A section that is written the same at several points is the same object.
    """
    written = {name: as_section(value) for name, value in sections.items()}
    if not grid:
        yield _Row(written, "", ("",), ((),))
        return
    variants = {name: _Variants(name, written, grid, place) for name in dict.fromkeys(map(_owner, grid))}
    *outer, last = grid.values()
    inner = _owner(list(grid)[-1])
    for point in itertools.product(*(range(len(axis)) for axis in outer)):
        before = tuple([axis[index] for axis, index in zip(outer, point, strict=True)])
        along = [variants[inner].variant_at((*point, index)) for index in range(len(last))]
        first = {name: of.variant_at((*point, 0)) for name, of in variants.items()}
        yield _Row({**written, **first}, inner, along, [(*before, value) for value in last])


def _owner(path: str) -> str:
    """Return the section that a path leads into."""
    return path.partition(".")[0]


class _Variants:
    """A section as it is written at the points of a grid, by the indices of the axes that vary it."""

    def __init__(self, name: str, sections: Plain, grid: Mapping[str, Sequence[Any]], place: str) -> None:
        self._name, self._place = name, place
        self._base = {name: sections[name]} if name in sections else {}
        self._axes = [(at, path, values) for at, (path, values) in enumerate(grid.items()) if _owner(path) == name]
        self._made: dict[tuple[int, ...], Any] = {}

    def variant_at(self, point: tuple[int, ...]) -> Any:
        """Return the section at a point, given by the index of the value on each axis."""
        mine = tuple([point[at] for at, _, _ in self._axes])
        if mine not in self._made:
            self._made[mine] = self._lay_over(mine)
        return self._made[mine]

    def _lay_over(self, indices: tuple[int, ...]) -> Any:
        whole: dict[str, Any] = self._base
        for (_, path, values), index in zip(self._axes, indices, strict=True):
            whole = merge(whole, nested_table(path, values[index]), self._place)
        return as_section(whole[self._name])


@dataclass
class _Point:
    """The sections of a point of the grid: as they are written, and resolved."""

    written: dict[str, Any]
    resolved: dict[str, Any]
    inherits: dict[str, tuple[str, ...]]
    """Which other sections each one inherits from."""
    files: Mapping[str, str]

    @property
    def order(self) -> list[str]:
        """Names of the sections, in the order in which they are resolved."""
        return [name for name in self.written if name not in INHERITING] + [
            name for name in INHERITING if name in self.written
        ]

    def affected_by(self, changed: str) -> list[str]:
        """Return the names of the sections to be resolved again when one is written anew."""
        affected: list[str] = []
        for name in self.order:
            if changed in ("loop", name) or not {changed, *affected}.isdisjoint(self.inherits[name]):
                affected.append(name)
        return affected


def _blame_grid(
    points: Iterator[tuple[_Point, tuple[Any, ...], Plain | None]], grid: Mapping[str, Sequence[Any]], row: _Row
) -> Iterator[tuple[_Point, tuple[Any, ...], Plain | None]]:
    """Yield the points of a row; an error about a parameter that the grid varies says so, with its value."""
    done = 0
    try:
        for point in points:
            yield point
            done += 1
    except FraexpError as error:
        values = dict(zip(grid, row.values[min(done, len(row.values) - 1)], strict=True))
        parts = [
            f"{path} = {toml.as_text(value)}"
            for path, value in values.items()
            if error.path and (f"{path}.".startswith(f"{error.path}.") or error.path.startswith(f"{path}."))
        ]
        error.args += (f"; [grid] sets {', '.join(parts)}",) if parts else ()
        raise


class Resolver:
    """Makes sweeps of what a study writes."""

    def __init__(self, file: Path, registry: Registry) -> None:
        self._file, self._registry = file, registry
        self._known: dict[tuple[Any, ...], Any] = {}
        """Sections that are resolved, and checks that are passed, by the hashes of all that they follow from."""
        self._inherited: dict[tuple[str, str], tuple[str, ...]] = {}
        """Sections from which one inherits, by its own name and that of its component."""
        self._numerics = Section(Numerics().plain())

    def points(
        self, place: str, sections: Plain, labels: Plain, grid: Mapping[str, Sequence[Any]]
    ) -> Iterator[tuple[Sweep, Plain | None]]:
        """Yield the sweep of each point of a grid, with what was written if that refers to a fit.

        In the sweep the machine's own components stand in for fits.
        """
        refers = fit_references.mentions_fit(sections, grid)
        for row in _grid_rows(sections, grid, f"{place}, [grid]"):
            for point, values, written in _blame_grid(self._row(row, refers, place), grid, row):
                at_point = dict(zip(grid, values, strict=True))
                experiment = self._experiment(point.resolved, place)
                if "accuracy" in point.resolved:  # of the key, as the outcome that is stored follows from it
                    experiment["accuracy"] = point.resolved["accuracy"]
                estimator, all_labels = point.resolved[ESTIMATOR], {**labels, **at_point} if labels else at_point
                yield Sweep(experiment, estimator, all_labels, point.files), written

    def machine(self, sections: Plain, place: str) -> dict[str, dict[str, Any]]:
        """Return what sections state of a machine, resolved; what refers to a fit is left out."""
        written = {
            name: as_section(sections[name])
            for name in (*MACHINE, "numerics")
            if name in sections and not fit_references.mentions_fit({name: sections[name]}, {})
        }
        point = _Point(written, {}, {}, NO_FILES)
        for name in point.order:
            self._complete(point, name, place)
        return {name: dict(section) for name, section in point.resolved.items()}

    def _row(self, row: _Row, refers: bool, place: str) -> Iterator[tuple[_Point, tuple[Any, ...], Plain | None]]:
        """Yield the points of a row with the values of the axes, and what was written if that refers to a fit."""
        if refers:
            for values, variant in zip(row.values, row.variants, strict=True):
                written = {**row.sections, row.inner: variant} if row.inner else row.sections
                yield self._resolve(fit_references.substitute_fits(written, place), place), values, written
            return
        point = self._resolve(row.sections, place)
        yield point, row.values[0], None
        affected = point.affected_by(row.inner)
        for values, variant in zip(row.values[1:], row.variants[1:], strict=True):
            point.written[row.inner] = variant
            for name in affected:
                self._complete(point, name, place)
            yield point, values, None

    def _resolve(self, sections: Plain, place: str) -> _Point:
        """Return all sections of a point, resolved."""
        written = {name: as_section(value) for name, value in sections.items()}
        if is_for_autonomous(written):
            raise StudyError(
                f"{place}: lacks the section [excitation], as a study for an autonomous measurement does: "
                f"fraexp measure --autonomous {self._file}"
            )
        if ESTIMATOR not in written:
            known = ", ".join(self._registry.names(ESTIMATOR))
            raise StudyError(f"{place}: lacks the section [estimator]; known: {known}")
        point = _Point(written, {}, {}, NO_FILES)
        point.resolved["numerics"] = self._numerics
        for name in point.order:
            self._complete(point, name, place)
        return point

    def _complete(self, point: _Point, name: str, place: str) -> None:
        """Resolve a section of a point with the sections around it."""
        around = point.resolved if name in INHERITING else point.written
        section = point.written[name]
        inherits = point.inherits[name] = self._inherited_sections(name, section, around)
        try:
            inherited = [around[of].digest for of in inherits if of in around]
            key = (name, section.digest, is_rotary(around), *inherited)
        except (AttributeError, TypeError, ValueError):  # no table, or with a value that no parameter takes
            found = self._make(name, section, around, place)
        else:
            found = self._known.get(key) or self._make(name, section, around, place)
            self._known[key] = found
        if name == "record":
            found, point.files = found
        point.resolved[name] = found

    def _inherited_sections(self, name: str, section: Any, around: Plain) -> tuple[str, ...]:
        """Return the sections from which one inherits, sorted."""
        if not isinstance(section, Section):
            return ()
        key = (name, str(section.get("name")))
        if key not in self._inherited or section.has_tables:
            owner = SETTINGS.get(name) or component_of(name, section, self._registry)
            origins = self._origins(owner, section, around) if owner else ()
            self._inherited[key] = tuple(sorted(set(origins)))
        return self._inherited[key]

    def _origins(self, owner: type[Parameters], spec: Plain, around: Plain) -> Iterator[str]:
        """Yield the sections from which a component, and those that it holds, inherit."""
        for key, info in owner.model_fields.items():
            origin, nested, value = inherited_from(info) or "", nested_kind(info), spec.get(key)
            if origin:
                yield origin.partition(".")[0]
            if nested is not None:
                for part in value if isinstance(value, list) else [value]:
                    named = part if isinstance(part, Mapping) and "name" in part else around.get(origin)
                    inner = component_of(nested.kind, named, self._registry)
                    if inner is not None:
                        yield from self._origins(inner, part if isinstance(part, Mapping) else {}, around)

    def _make(self, name: str, section: Any, around: Plain, place: str) -> Any:
        """Return a section as full plain data; a record together with its files."""
        where = f"{place}, [{name}]"
        self._check_misplaced(name, section, where)
        if name == "record":
            return self._make_record(section, where)
        if name in SETTINGS:
            return Section(_settings(self._registry, name, section, around, where))
        if name in (EXCITATION, ESTIMATOR):
            given = _complete_tables(name, section, around, self._registry)
            return Section(self._registry.create(name, given, around, where).spec())
        parts = components_by_port(section) if name in KINDS_BY_PORT else {}
        if parts:
            made = {
                of: self._registry.create(name, part, around, f"{where[:-1]}.{of}]", f"{name}.{of}")
                for of, part in parts.items()
            }
            return Section({of: part.spec() for of, part in made.items()})
        return Section(self._registry.create(name, section, around, where).spec())

    def _check_misplaced(self, name: str, section: Any, where: str) -> None:
        """Raise StudyError if a component's section has a parameter of the loop, such as its sample time."""
        owner = None if name in SETTINGS else component_of(name, section, self._registry)
        if owner is None:
            return
        known = owner.model_fields.keys() | {"name", "version", "preset"}
        for key in section.keys() - known:
            other = next((of for of, settings in SETTINGS.items() if key in settings.model_fields), None)
            if other and not any(key in name for name in owner.model_fields):  # such as 'settling_tolerance'
                raise StudyError(f"{section['name']} has no parameter '{key}'; it belongs into [{other}]").at(
                    f"{where}: ", f"{name}.{key}"
                )

    def _make_record(self, section: Any, where: str) -> tuple[Plain, Mapping[str, str]]:
        from fraexp import records  # most studies have none

        try:
            settings = records.RecordSettings.parse(section, "record")
            experiment, files = records.resolve(settings, self._file.parent, self._registry)
        except FraexpError as error:
            raise error.at(f"{where}: ", "record") from None
        return Section(experiment["record"]), files

    def _experiment(self, resolved: Plain, place: str) -> dict[str, Any]:
        """Return the sections that decide the signals, by their source."""
        if "record" in resolved:
            return {"source": "record", "record": resolved["record"]}
        if EXCITATION not in resolved:
            raise StudyError(
                f"{place}: lacks the section [excitation] (for a simulation) or [record] (for measured data)"
            )
        drives = self._drives_law(resolved, place)
        source, names = ("drive", OF_A_DRIVE) if drives else ("loop", OF_A_LOOP)
        try:
            experiment = {"source": source, **{name: resolved[name] for name in names}}
        except KeyError as error:
            name = error.args[0]
            raise StudyError(f"{place}: lacks the section [{name}]; name a machine, or write the section") from None
        if drives:
            return {**experiment, "loop": self._of_a_driven_law(resolved["loop"])}
        if "compensation" in resolved:
            experiment["compensation"] = resolved["compensation"]
        self._check_ports(experiment, place)
        if "limits" in resolved:
            self._check_limits(experiment, resolved["limits"], place)
        return experiment

    def _drives_law(self, resolved: Plain, place: str) -> bool:
        """Say whether an excitation drives a friction law; StudyError if it cannot be sampled as the loop is."""
        spec, loop = resolved[EXCITATION], resolved.get("loop")
        key = ("sampled", spec.digest, loop and loop.digest)
        if key not in self._known:
            excitation = create(self._registry, Excitation, spec)
            drives = excitation.quantity == "displacement"
            try:
                if loop is not None:
                    excitation.check(loop["sample_time"])
            except FraexpError as error:
                raise error.at(f"{place}, [excitation]: ", EXCITATION) from None
            self._known[key] = drives
        return bool(self._known[key])

    def _of_a_driven_law(self, loop: Section) -> Section:
        """Return all that a driven law takes from the loop: its sample time, and whether the axis turns."""
        key = ("driven law", loop.digest)
        if key not in self._known:
            self._known[key] = Section({name: loop[name] for name in ("sample_time", "rotary") if name in loop})
        return self._known[key]

    def _check_ports(self, sections: Plain, place: str) -> None:
        """Refuse friction models, controllers, a thrust or a position that do not fit the plant's ports."""
        plant, friction, controller, loop = (sections[name] for name in MACHINE)
        named = loop.get("thrust"), loop.get("position"), *components_by_port(controller)
        has_own_ports = getattr(component_of(Plant.kind, plant, self._registry), "ports", None) is not Plant.ports
        if not (has_own_ports or components_by_port(friction) or any(named)):
            return  # one contact, one friction model
        key = ("ports", plant.digest, friction.digest, *named)
        if key in self._known:
            return
        try:
            machine = build_machine(sections, self._registry)
            machine.ports.check()
            machine.frictions, machine.controllers  # noqa: B018  # they raise errors where they do not fit the ports
        except FraexpError as error:
            raise error.at(f"{place}: ") from None
        self._known[key] = True

    def _check_limits(self, sections: Plain, limits: Section, place: str) -> None:
        """Refuse what the machine does not allow; the limits themselves do not decide what the signals are."""
        key = ("limits", limits.digest, experiment_key(sections))
        if key in self._known:
            return
        try:
            machine = build_machine(sections, self._registry)
            excitation = create(self._registry, Excitation, sections[EXCITATION])
            motion_limits.check_limits(MotionLimits.parse(limits, "limits"), machine, excitation)
        except FraexpError as error:
            raise error.at(f"{place}, [excitation]: ", EXCITATION) from None
        self._known[key] = True


NO_FILES: Mapping[str, str] = {}


def resolve_estimator(spec: Plain, experiment: Plain, registry: Registry, place: str) -> Plain:
    """Return an estimator with all its parameters, those included that it inherits from a resolved experiment."""
    around = {name: section for name, section in experiment.items() if name != "source"}
    return registry.create(ESTIMATOR, _complete_tables(ESTIMATOR, spec, around, registry), around, place).spec()


def _complete_tables(kind: str, spec: Any, environment: Plain, registry: Registry) -> Any:
    """Return a component in which tables without a name are completed from what they would inherit."""
    owner = component_of(kind, spec, registry)
    if owner is None:
        return spec
    result = dict(spec)
    for key, info in owner.model_fields.items():
        nested, origin, value = nested_kind(info), inherited_from(info), spec.get(key)
        if nested is None or not isinstance(value, Mapping):
            continue
        # another component, or the reference to a fit, is no part of one
        if not value.keys() & {"name", "preset", "fit"} and origin is not None and origin in environment:
            value = overlay(environment[origin], value)
        result[key] = _complete_tables(nested.kind, value, environment, registry)
    return result


def _settings(registry: Registry, key: str, value: Plain, sections: Plain, place: str) -> dict[str, Any]:
    try:
        filled = registry.fill_inherited(SETTINGS[key], value, sections)
        return SETTINGS[key].parse(filled, key, rotary=is_rotary(sections)).plain()
    except FraexpError as error:
        raise error.at(f"{place}: ", key) from None
