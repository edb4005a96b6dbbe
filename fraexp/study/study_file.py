"""A study file in TOML: its cases and its grid multiply into sweeps."""

import gc
import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import fraexp
from fraexp.components.kinds import Controller
from fraexp.components.registry import Registry
from fraexp.data import fit_references, toml
from fraexp.data.figure_kinds import check_kind
from fraexp.data.rotary_axes import is_rotary
from fraexp.data.sweep import Sweep, components_by_port
from fraexp.errors import FraexpError, StudyError, did_you_mean
from fraexp.simulation.machine import ControlLoop
from fraexp.study import published_values
from fraexp.study.published_values import PublishedNumber
from fraexp.study.random_draws import Draws, sample_sweeps
from fraexp.study.resolution import Resolver
from fraexp.study.sections import (
    GRID,
    MACHINE,
    SECTIONS,
    WORDS,
    apply_changes,
    axes,
    merge,
    nested_table,
    overlay,
    override,
)

KEYS = (*WORDS, *SECTIONS, "case", "grid", "monte_carlo", "published")
DRAWS = "monte_carlo."
"""Prefix of Monte Carlo settings on the command line."""
MAX_SWEEPS = 1_000_000
MAX_NAME_LENGTH = 200
"""Letters of a name that file systems take."""


@dataclass(frozen=True)
class ResolvedStudy:
    """A study, resolved into sweeps."""

    name: str
    """Name under which figures and runs appear, such as ``paper/fig12``."""
    file: Path
    title: str
    question: str
    sweeps: tuple[Sweep, ...]
    figure: str = ""
    """Kind of its figure; empty for the one that fits the results."""
    published: tuple[PublishedNumber, ...] = ()
    """Numbers of a publication to which its own are compared."""
    repeated: int = 0
    """Points of the grid that come to the sweep of another point, as those of a value that is given twice."""


@dataclass(frozen=True)
class _Case:
    """A case of a study, or all of a study that has none: what is laid over its sections, then the whole of them."""

    place: str
    """Where it stands, for what is said of it."""
    labels: Mapping[str, str]
    sections: Mapping[str, Any]


def packaged_studies() -> Path:
    """Return the folder of the example studies: in the installed package, or in the checkout."""
    package = Path(fraexp.__file__).parent
    return package / "studies" if (package / "studies").is_dir() else package.parent / "studies"


def find_studies(name: str, folder: Path) -> list[tuple[str, Path]]:
    """Return name and file of a study (or of all in a directory), looked up as a path, in `folder`, in the package."""
    if not name.strip():
        raise StudyError("a study's name is empty; expected a study file, a name, or a folder (. for this one)")
    try:
        (folder / name).exists()
    except (OSError, ValueError) as error:  # such as a name that is too long
        raise StudyError(f"there is no study '{name:.60}': {getattr(error, 'strerror', error)}") from None
    roots = (folder / "studies", packaged_studies())
    for base in (folder, *roots):
        for path in (base / name, base / f"{name}.toml"):
            if path.is_file():
                _require_one(name, path, roots[0] / f"{name}.toml")
                return [(study_name(path, roots), path)]
            files = sorted(file for file in path.glob("*.toml") if file.is_file()) if path.is_dir() else []
            if files:
                return [(study_name(file, roots), file) for file in files]
    names = {
        study_name(path, roots)
        for root in roots
        for path in root.rglob("*.toml")
        if path.parent.name != "machines" and path.is_file()
    }
    raise StudyError(f"there is no study '{name}'{did_you_mean(name.removesuffix('.toml'), names)}")


def find_study(name: str, folder: Path) -> tuple[str, Path]:
    """Return name and file of one study; StudyError for a folder of several."""
    found = find_studies(name, folder)
    if len(found) != 1:
        raise StudyError(f"'{name}' is a folder of {len(found)} studies; expected one of them")
    return found[0]


def _require_one(name: str, found: Path, own: Path) -> None:
    """Raise StudyError if a name may mean a file of the workspace as well as one of its studies."""
    if found.name != Path(name).name and own.is_file() and not own.samefile(found):
        raise StudyError(f"the study '{name}' may be {found} or {own}; give the path of the file, or rename one")


def study_name(path: Path, roots: Sequence[Path]) -> str:
    """Return the name of a study's file: where it is below one of the folders of studies."""
    for root in roots:
        inside, outside = Path(os.path.realpath(path)), os.path.realpath(root)  # which survive a loop of links
        if inside.is_relative_to(outside):
            return inside.relative_to(outside).with_suffix("").as_posix()
    return path.stem


def load(name: str, file: Path, folder: Path, registry: Registry, overrides: Sequence[str] = ()) -> ResolvedStudy:
    """Read a study and resolve every point of its grid; StudyError (or ParameterError) says what does not fit.

    `overrides` are texts such as ``excitation.amplitude=20`` that replace what the file says, its grid included.
    """
    return resolve(name, file, read(file), folder, registry, overrides)


def resolve(
    name: str, file: Path, data: Mapping[str, Any], folder: Path, registry: Registry, overrides: Sequence[str] = ()
) -> ResolvedStudy:
    """Return the study that the data of a file describe, without reading the file itself."""
    describe_study(name, file, data)  # first what is wrong with the file as a whole
    if not any(key in SECTIONS or key in ("case", "machine") for key in data):
        empty = "the study is empty" if not data else "the study has no sections"
        example = packaged_studies() / "quick.toml"
        raise StudyError(f"{file}: {empty}; expected [excitation] and [estimator] at least, as in {example}")
    written = _written(file, data, folder, overrides)
    grid = _grid(file, written)
    draws = _draws(written, grid, file)
    study = describe_study(name, file, written.data)
    whole = _merged_cases(file, written)
    _check_count(file, len(whole), grid, draws)
    first: dict[str, Sweep] = {}
    hidden: Sweep | None = None
    points = 0
    with _without_collection():
        for sweep in _all_sweeps(file, whole, grid, draws, registry):
            points += 1
            other = first.setdefault(sweep.key, sweep)
            if other is not sweep and other.labels.get("case") != sweep.labels.get("case"):
                hidden = hidden or sweep
    if hidden and not overrides:  # which may well make cases alike
        names = (first[hidden.key].labels["case"], hidden.labels["case"])
        raise StudyError(f"{file}: the cases '{names[0]}' and '{names[1]}' come to the same sweep; let them differ")
    kept = tuple(first.values())  # points may say the same in two ways
    if study.published and not overrides:  # which may well leave out what is printed
        published_values.check(study.published, kept, str(file))
    return replace(study, sweeps=kept, repeated=points - len(kept))


def outline(
    file: Path, folder: Path, overrides: Sequence[str] = ()
) -> tuple[list[dict[str, Any]], dict[str, list[Any]]]:
    """Return the sections of each case as they are written, machine included, and the axes of the grid.

    Nothing is resolved: what does not fit into a section shows when the study is loaded.
    """
    data = read(file)
    _check_keys(data, file)
    written = _written(file, data, folder, overrides)
    return [dict(case.sections) for case in _merged_cases(file, written)], _grid(file, written)


def describe_study(name: str, file: Path, data: Mapping[str, Any] | None = None) -> ResolvedStudy:
    """Return the words and printed numbers of a study's file, or of its data, without its sweeps."""
    data = read(file) if data is None else data
    _check_keys(data, file)
    try:
        numbers = PublishedNumber.parse_all(data.get("published", []))
    except FraexpError as error:
        raise error.at(f"{file}, ") from None
    return ResolvedStudy(
        name, file, data.get("title", name), data.get("question", ""), (), data.get("figure", ""), numbers
    )


@dataclass(frozen=True)
class _Written:
    """What a study, its machine and the command line say."""

    data: Mapping[str, Any]
    machine: Mapping[str, Any]
    """Sections of the machine that the study names."""
    changes: Sequence[tuple[str, Any]]
    """Paths and values that the command line sets."""


def _written(file: Path, data: Mapping[str, Any], folder: Path, overrides: Sequence[str]) -> _Written:
    return _Written(data, machine_of(data, file, folder), [override(text) for text in overrides])


def _check_keys(data: Mapping[str, Any], file: Path) -> None:
    unknown = sorted(set(data) - set(KEYS))
    if unknown:
        raise StudyError(f"{file}: there is no section or key '{unknown[0]}'{did_you_mean(unknown[0], KEYS)}")
    for word in WORDS:
        if not isinstance(data.get(word, ""), str):
            raise StudyError(f"{file}: {word} is {toml.as_text(data[word])}; expected a text")
    check_kind(data.get("figure", ""), f"{file}: figure")


def read(file: Path) -> dict[str, Any]:
    """Return what a file says; StudyError if it is no TOML."""
    try:
        size = file.stat().st_size
        if size > 4 * toml.MAX_CHARACTERS:  # bytes of a character
            raise StudyError(
                f"{file}: it takes {size:,} bytes; expected a study, {toml.MAX_CHARACTERS:,} characters at most"
            )
        return toml.loads(file.read_text(encoding="utf-8-sig"))
    except UnicodeDecodeError:
        raise StudyError(f"{file}: is no text in UTF-8") from None
    except ValueError as error:
        raise StudyError(f"{file}: is no valid TOML: {error}") from None
    except OSError as error:
        raise StudyError(f"{file}: cannot be read: {error.strerror}") from None


def machine_of(data: Mapping[str, Any], study: Path, folder: Path) -> dict[str, Any]:
    """Return the sections of the machine that a study names; none if it names none."""
    if "machine" not in data:
        return {}
    name = data["machine"]
    if not isinstance(name, str) or len(name) > MAX_NAME_LENGTH or "\0" in name:
        raise StudyError(f"{study}: machine is {_shorten(name)}; expected the name of a file in studies/machines")
    places = (study.parent / "machines", folder / "studies" / "machines", packaged_studies() / "machines")
    for place in places:
        file = place / f"{name}.toml"
        if file.is_file():
            data = read(file)
            unknown = sorted(set(data) - {"title", "source", *MACHINE})
            if unknown:
                raise StudyError(f"{file}: a machine has no section '{unknown[0]}'{did_you_mean(unknown[0], MACHINE)}")
            return {key: value for key, value in data.items() if key in MACHINE}
    names = {file.stem for place in places for file in place.glob("*.toml")}
    raise StudyError(f"{study}: there is no machine '{name}'{did_you_mean(name, names)}")


def _cases(tables: Any, file: Path) -> list[_Case]:
    if not isinstance(tables, list) or not tables or not all(isinstance(table, Mapping) for table in tables):
        raise StudyError(f"{file}: case is {_shorten(tables)}; expected tables, each under [[case]]")
    cases: dict[str, _Case] = {}
    for number, table in enumerate(tables, start=1):
        label = _label(table, f"{file}, [[case]] number {number}")
        if label in cases:
            raise StudyError(
                f"{file}, [[case]] number {number}: there is a case '{label}' already; expected a new label"
            )
        sections = {key: value for key, value in table.items() if key != "label"}
        cases[label] = _Case(f"{file}, case '{label}'", {"case": label}, sections)
    return list(cases.values())


def _label(table: Mapping[str, Any], place: str) -> str:
    if "label" not in table:
        raise StudyError(f"{place}: lacks 'label', the name by which tables and figures tell it from the others")
    label = table["label"]
    if not isinstance(label, str) or not label.strip():
        raise StudyError(f"{place}: label is {toml.as_text(label)}; expected a text")
    return label


def _shorten(value: Any) -> str:
    text = toml.as_text(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _merged_cases(file: Path, written: _Written) -> list[_Case]:
    """Return the cases with all of their sections: of the machine, the study, the case and the command line."""
    base = {key: value for key, value in written.data.items() if key in SECTIONS}
    base = merge(written.machine, base, str(file))
    cases = _cases(written.data["case"], file) if "case" in written.data else [_Case(str(file), {}, {})]
    of_sections = [change for change in written.changes if not change[0].startswith((DRAWS, GRID))]
    return [replace(case, sections=_case_sections(base, case, of_sections)) for case in cases]


def _grid(file: Path, written: _Written) -> dict[str, list[Any]]:
    return apply_changes(axes(written.data.get("grid", {}), f"{file}, [grid]"), written.changes)


def _case_sections(base: Mapping[str, Any], case: _Case, changes: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    """Return the study's sections with the case laid over them, and over both what the command line sets."""
    sections = merge(base, case.sections, case.place)
    for path, value in changes:
        sections = merge(sections, nested_table(path, value), "--set")
    return sections


def _draws(written: _Written, grid: Mapping[str, Any], file: Path) -> Draws | None:
    """Return what is drawn at random, with what the command line sets of it; None if the study draws nothing."""
    changes = [change for change in written.changes if change[0].startswith(DRAWS)]
    if "monte_carlo" not in written.data:
        if changes:
            raise StudyError(f"--set {changes[0][0]}: {file} has no section [monte_carlo]")
        return None
    section = written.data["monte_carlo"]
    for path, value in changes:
        section = overlay(section, nested_table(path, value)["monte_carlo"])
    try:
        draws = Draws.parse(section)
        clash = next((path for path in draws.paths if path in grid), None)
        if clash:
            raise StudyError(
                f"[monte_carlo]: '{clash}' is in [grid] too; keep one of both, or use cases for the grid's"
            )
    except FraexpError as error:
        raise error.at(f"{file}, ") from None
    return draws


def _check_count(file: Path, cases: int, grid: Mapping[str, Sequence[Any]], draws: Draws | None) -> None:
    count = cases * math.prod(len(values) for values in grid.values()) * (draws.count if draws else 1)
    if count > MAX_SWEEPS:
        place, what = ("[monte_carlo]", "sweeps") if draws else ("[grid]", "points")
        raise StudyError(f"{file}, {place}: it has {count:,} {what}; expected {MAX_SWEEPS:,} at most")


@contextmanager
def _without_collection() -> Iterator[None]:
    """Let Python look for no garbage meanwhile: a million sweeps would be looked through again and again."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def _all_sweeps(
    file: Path, cases: Sequence[_Case], grid: Mapping[str, list[Any]], draws: Draws | None, registry: Registry
) -> Iterable[Sweep]:
    """Return the sweeps of all cases, points and draws, in their order."""
    resolver = Resolver(file, registry)
    every = (
        (case, *found) for case in cases for found in resolver.points(case.place, case.sections, case.labels, grid)
    )
    refers = any(fit_references.mentions_fit(case.sections, grid) for case in cases)
    if not refers and not draws:
        return (sweep for _, sweep, _ in every)
    all_drawn = (
        (case.place, sweep, written)
        for case, one, written in every
        for sweep in (sample_sweeps(case.place, one, draws, registry) if draws else [one])
    )
    return fit_references.insert_fits(list(all_drawn)) if refers else (sweep for _, sweep, _ in all_drawn)


NEEDED = (Controller.kind, "loop")


def stated_controller(name: str, folder: Path, registry: Registry) -> dict[str, Any]:
    """Return the resolved sections ``controller`` and ``loop`` of a study or machine, looked up as a study is.

    StudyError if it is none, or lacks one of them.
    """
    _, file = find_study(name, folder)
    data = read(file)
    machine = machine_of(data, file, folder)
    sections = {key: overlay(machine.get(key, {}), data.get(key, {})) for key in NEEDED}
    missing = next((key for key in NEEDED if not sections[key]), None)
    if missing:
        raise StudyError(f"{file}: lacks the section [{missing}]; expected [controller] and [loop], or a machine")
    if thrusts := components_by_port(sections[Controller.kind]):
        raise StudyError(f"{file}: has a controller for each of several thrusts ({', '.join(thrusts)}); expected one")
    loop = ControlLoop.parse(sections["loop"], "loop", rotary=is_rotary(sections))
    controller = registry.create(Controller.kind, sections[Controller.kind], sections, str(file))
    return {Controller.kind: controller.spec(), "loop": loop.plain()}
