"""From what a study writes to sweeps: whatever points of a grid have in common is resolved once.

A grid of a million points has few different sections, and each of them is built, checked and written as JSON once.
"""

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from fraexp import records
from fraexp.components.kinds import Excitation, nested_kind
from fraexp.components.parameters import inherited_from
from fraexp.components.registry import Registry, create
from fraexp.data import fit_references
from fraexp.data.sweep import Keys, Plain, Sweep
from fraexp.errors import FraexpError, StudyError
from fraexp.simulation import motion_limits
from fraexp.simulation.machine import Numerics, build_machine
from fraexp.simulation.motion_limits import MotionLimits
from fraexp.study.sections import COMPONENTS, MACHINE, SETTINGS, merge, nested, overlay

OPTIONAL = ("compensation",)
"""Sections of SETTINGS that decide the signals of a loop where they are given; without them its key is what it was."""
EXCITATION, ESTIMATOR = Excitation.kind, "estimator"
"""Components that may inherit from the other sections."""


class _Watched(Mapping[str, Any]):
    """Sections that remember which of them are looked at."""

    def __init__(self, sections: Plain) -> None:
        self._sections = sections
        self.seen: dict[str, Any] = {}

    def __getitem__(self, key: str) -> Any:
        self.seen[key] = self._sections.get(key)
        return self._sections[key]

    def __iter__(self) -> Iterator[str]:
        self.seen |= self._sections
        return iter(self._sections)

    def __len__(self) -> int:
        return len(self._sections)

    def __bool__(self) -> bool:
        return True


Make = Callable[[Any, Plain, str], Any]
Made = tuple[Any, tuple[Any, ...]]


class _Once:
    """A function of a section, of the sections around it that it looks at, and of a place for what does not fit.

    Its results are remembered by identity, for equal sections of a study are the same object. What it has looked at
    is added to `looked`.
    """

    def __init__(self, make: Make, looked: set[str]) -> None:
        self._make, self._looked = make, looked
        self._found: dict[int, tuple[Any, dict[tuple[str, ...], dict[tuple[int, ...], Made]]]] = {}

    def __call__(self, section: Any, around: Plain, place: str) -> Any:
        found = self._found.get(id(section))
        if found is None:
            found = self._found[id(section)] = (section, {})  # which is kept, so that its identity stays its own
        for names, made in found[1].items():
            one = made.get(tuple([id(around.get(name)) for name in names]) if names else ())
            if one is not None:
                if names:
                    self._looked.update(names)
                return one[0]
        watched = _Watched(around)
        result = self._make(section, watched, place)
        seen = tuple(watched.seen.values())
        self._looked.update(watched.seen)
        found[1].setdefault(tuple(watched.seen), {})[tuple([id(of) for of in seen])] = (result, seen)
        return result


class Resolver:
    """Makes sweeps of what a study writes."""

    def __init__(self, file: Path, registry: Registry) -> None:
        self._file, self._registry = file, registry
        self._looked: set[str] = set()
        """Sections at which others have looked since a point was resolved as a whole."""
        once = {key: self._maker(key) for key in (*COMPONENTS, *SETTINGS, "record")}
        self._sections = {key: _Once(make, self._looked) for key, make in once.items()}
        self._drives = _Once(
            lambda spec, around, place: self._excitation(spec).quantity == "displacement", self._looked
        )
        self._sampled = _Once(self._check_sampled, self._looked)
        self._looped = _Once(lambda loop, around, place: {"sample_time": loop["sample_time"]}, self._looked)
        self._within = _Once(self._check_limits, self._looked)
        self._fit: dict[tuple[int, int], bool] = {}
        """What `_sampled` has said of an excitation and a loop."""
        self._numerics = Numerics().plain()
        self._shared: dict[str, Any] = {}
        self._keys = Keys()

    def points(
        self, place: str, sections: Plain, labels: Plain, grid: Mapping[str, Sequence[Any]]
    ) -> Iterator[tuple[Sweep, Plain | None]]:
        """Yield the sweep of each point of a grid, with what was written if that refers to a fit.

        In the sweep the machine's own components stand in for fits.
        """
        refers = fit_references.within(sections, grid)
        sweep: Sweep | None = None
        resolved: dict[str, Any] = {}
        for values, written, changed in _written(sections, grid, f"{place}, [grid]"):
            at_point = dict(zip(grid, values, strict=True))
            at_point = {**labels, **at_point} if labels else at_point
            beside = None
            if sweep is not None and len(changed) == 1 and not refers:
                beside = self._beside(changed[0], written, resolved, sweep, place)
            if sweep is not None and beside is not None:
                sweep = Sweep.with_key(*beside, at_point, sweep.files)
            else:
                stood = self._stood_in(written, place) if refers else written
                sweep, resolved = self._sweep(place, stood, at_point)
            yield sweep, dict(written) if refers else None

    def _beside(
        self, section: str, sections: Plain, resolved: dict[str, Any], beside: Sweep, place: str
    ) -> tuple[str, Plain, Plain] | None:
        """Return key, experiment and estimator of a point that differs from another one in one section.

        None if that has to be resolved as a whole, for other sections have looked at this one.
        """
        if section in self._looked or section not in COMPONENTS:
            return None
        found = self._sections[section](sections[section], resolved, place)
        if section == ESTIMATOR:
            return self._keys.of(beside.experiment, found), beside.experiment, found
        resolved[section] = found
        if section == EXCITATION:
            both = id(found), id(resolved.get("loop"))  # which stay their own, for `_sections` keeps them
            drives = self._fit.get(both)
            if drives is None:
                drives = self._fit[both] = self._sampled(found, resolved, place)
            if drives != (beside.experiment["source"] == "drive"):
                return None
            if "limits" in resolved:
                self._within(found, resolved, place)
        if section not in beside.experiment:  # of a driven friction model, or of a record
            return beside.key, beside.experiment, beside.estimator
        experiment = {**beside.experiment, section: found}
        return self._keys.beside(section, found), experiment, beside.estimator

    def _stood_in(self, written: Plain, place: str) -> dict[str, Any]:
        sections = fit_references.stood_in(written, place)
        return {
            key: value if value is written[key] else self._shared.setdefault(repr(value), value)
            for key, value in sections.items()
        }

    def _sweep(self, place: str, sections: Plain, labels: Plain) -> tuple[Sweep, dict[str, Any]]:
        self._looked.clear()
        resolved, files = self._resolve(place, sections)
        if ESTIMATOR not in sections:
            raise StudyError(
                f"{place}: lacks the section [estimator]; known: {', '.join(self._registry.names(ESTIMATOR))}"
            )
        estimator = self._sections[ESTIMATOR](sections[ESTIMATOR], resolved, place)
        experiment = self._experiment(place, resolved)
        return Sweep.with_key(self._keys.of(experiment, estimator), experiment, estimator, labels, files), resolved

    def _resolve(self, place: str, sections: Plain) -> tuple[dict[str, Any], Mapping[str, str]]:
        """Return every section but the estimator as full plain data, and the files that it names."""
        resolved: dict[str, Any] = {}
        files: Mapping[str, str] = NO_FILES
        for key, value in sections.items():
            if key not in (EXCITATION, ESTIMATOR):
                resolved[key] = self._sections[key](value, sections, place)
        if "record" in sections:
            resolved["record"], files = resolved["record"]
        resolved.setdefault("numerics", self._numerics)
        if EXCITATION in sections:
            resolved[EXCITATION] = self._sections[EXCITATION](sections[EXCITATION], resolved, place)
        return resolved, files

    def _maker(self, key: str) -> Make:
        def make(section: Any, around: Plain, place: str) -> Any:
            where = f"{place}, [{key}]"
            if key == "record":
                return self._record(section, where)
            if key in SETTINGS:
                return _settings(self._registry, key, section, around, where)
            if key in (EXCITATION, ESTIMATOR):
                given = _laid_over(key, section, around, self._registry)
                return self._registry.create(key, given, around, where).spec()
            return self._registry.create(key, section, place=where).spec()

        return make

    def _record(self, section: Any, where: str) -> tuple[Plain, Mapping[str, str]]:
        try:
            settings = records.RecordSettings.parse(section, "record")
            experiment, files = records.resolve(settings, self._file.parent, self._registry)
        except FraexpError as error:
            raise type(error)(f"{where}: {error}") from None
        return experiment["record"], files

    def _experiment(self, place: str, resolved: Plain) -> dict[str, Any]:
        """Return the sections that decide the signals, by their source."""
        if "record" in resolved:
            return {"source": "record", "record": resolved["record"]}
        if EXCITATION not in resolved:
            raise StudyError(
                f"{place}: lacks the section [excitation] (for a simulation) or [record] (for measured data)"
            )
        excitation = resolved[EXCITATION]
        drives = self._drives(excitation, resolved, place)
        try:
            parts = {key: resolved[key] for key in (OF_A_DRIVE if drives else OF_A_LOOP)}
        except KeyError as error:
            section = error.args[0]
            raise StudyError(f"{place}: lacks the section [{section}]; name a machine, or write the section") from None
        self._sampled(excitation, resolved, place)
        if drives:
            parts["loop"] = self._looped(resolved["loop"], resolved, place)
            return {"source": "drive", **parts}
        for key in OPTIONAL:
            if key in resolved:
                parts[key] = resolved[key]
        if "limits" in resolved:
            self._within(excitation, resolved, place)
        return {"source": "loop", **parts}

    def _excitation(self, spec: Plain) -> Excitation:
        return create(self._registry, Excitation, spec)  # type: ignore[type-abstract]

    def _check_sampled(self, spec: Plain, around: Plain, place: str) -> bool:
        """Refuse an excitation that cannot be sampled as the loop is; return whether it drives a friction model."""
        excitation = self._excitation(spec)
        try:
            excitation.check(around["loop"]["sample_time"])
        except FraexpError as error:
            raise type(error)(f"{place}, [excitation]: {error}") from None
        return excitation.quantity == "displacement"

    def _check_limits(self, spec: Plain, around: Plain, place: str) -> bool:
        """Refuse what the machine does not allow; the limits themselves do not decide what the signals are."""
        parts = {key: around[key] for key in (*OF_A_LOOP, *OPTIONAL) if key in around}
        try:
            machine = build_machine(parts, self._registry)
            motion_limits.check(MotionLimits.parse(around["limits"], "limits"), machine, self._excitation(spec))
        except FraexpError as error:
            raise type(error)(f"{place}, [excitation]: {error}") from None
        return True


NO_FILES: Mapping[str, str] = {}
OF_A_DRIVE = ("friction", EXCITATION, "loop")
OF_A_LOOP = (*MACHINE, EXCITATION, "numerics")


def _written(
    sections: Plain, grid: Mapping[str, Sequence[Any]], place: str
) -> Iterator[tuple[tuple[Any, ...], dict[str, Any], list[str]]]:
    """Yield each point of a grid: its values, its sections, and which of them are others than at the point before.

    A section that is written the same at several points is the same object; the dictionary is used again.
    """
    if not grid:
        yield (), dict(sections), []
        return
    owners = [path.partition(".")[0] for path in grid]
    *outer, last = grid.values()
    groups = [
        (section, [at for at, owner in enumerate(owners[:-1]) if owner == section], dict[tuple[int, ...], list[Any]]())
        for section in dict.fromkeys(owners)
    ]
    written, inner = dict(sections), owners[-1]
    for before, point in zip(
        itertools.product(*outer), itertools.product(*(range(len(of)) for of in outer)), strict=True
    ):
        rows = {}
        for section, places, known in groups:  # in each row what is written with each value of the last axis
            at = tuple([point[place] for place in places])
            rows[section] = known.setdefault(at, [None] * (len(last) if section == inner else 1))
        for number, value in enumerate(last):
            changed = []
            for section, row in rows.items() if number == 0 else ((inner, rows[inner]),):
                found = row[number]
                if found is None:
                    pairs = zip(grid, (*before, value), strict=True)
                    found = row[number] = _laid(section, sections, pairs, place)
                if written.get(section) is not found:
                    changed.append(section)
                    written[section] = found
            yield (*before, value), written, changed


def _laid(section: str, sections: Plain, point: Iterable[tuple[str, Any]], place: str) -> Any:
    """Return a section as it is written at a point of the grid."""
    whole = {section: sections[section]} if section in sections else {}
    for path, value in point:
        if path.partition(".")[0] == section:
            whole = merge(whole, nested(path, value), place)
    return whole[section]


def _laid_over(kind: str, spec: Any, environment: Plain, registry: Registry) -> Any:
    """Return a component whose own ones that have no name are laid over what they would inherit."""
    supply = registry.supplies.get((kind, str(spec.get("name")))) if isinstance(spec, Mapping) else None
    if supply is None:
        return spec
    result = dict(spec)
    for key, info in supply.component.model_fields.items():
        nested, origin, value = nested_kind(info), inherited_from(info), spec.get(key)
        if nested is None or not isinstance(value, Mapping):
            continue
        # another component, or the reference to a fit, is no part of one
        if not value.keys() & {"name", "preset", "fit"} and origin is not None and origin in environment:
            value = overlay(environment[origin], value)
        result[key] = _laid_over(nested.kind, value, environment, registry)
    return result


def _settings(registry: Registry, key: str, value: Plain, sections: Plain, place: str) -> dict[str, Any]:
    try:
        return SETTINGS[key].parse(registry.filled(SETTINGS[key], value, sections), key).plain()
    except FraexpError as error:
        raise type(error)(f"{place}: {error}") from None
