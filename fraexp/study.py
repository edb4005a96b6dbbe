"""A study file: what shall be known, as TOML; its grid multiplies into sweeps."""

import itertools
import os
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fraexp import records
from fraexp.components import Controller, Estimator, Excitation, FrictionModel, Plant
from fraexp.errors import FraexpError, StudyError, did_you_mean
from fraexp.parameters import Parameters
from fraexp.plugins import Registry, create
from fraexp.simulation import Loop, Numerics
from fraexp.sweep import Plain, Sweep

COMPONENTS = {kind.kind: kind for kind in (Plant, FrictionModel, Controller, Excitation, Estimator)}
SETTINGS: dict[str, type[Parameters]] = {"loop": Loop, "numerics": Numerics}
MACHINE = ("plant", "friction", "controller", "loop")
WORDS = ("title", "question", "machine")
KEYS = (*WORDS, *COMPONENTS, *SETTINGS, "record", "grid")
MOST_SWEEPS = 1_000_000


@dataclass(frozen=True)
class Study:
    """A study, resolved into sweeps."""

    name: str
    """Name under which figures and runs appear, such as ``paper/fig12``."""
    file: Path
    title: str
    question: str
    sweeps: tuple[Sweep, ...]


def packaged_studies() -> Path:
    """Return the folder of the example studies: in the installed package, or in the checkout."""
    package = Path(__file__).parent
    return package / "studies" if (package / "studies").is_dir() else package.parent / "studies"


def find_studies(name: str, folder: Path) -> list[tuple[str, Path]]:
    """Return name and file of a study (or of all in a directory), looked up as a path, in `folder`, in the package."""
    roots = (folder / "studies", packaged_studies())
    for base in (folder, *roots):
        for path in (base / name, base / f"{name}.toml"):
            if path.is_file():
                return [(_study_name(path, roots), path)]
            files = sorted(path.glob("*.toml")) if path.is_dir() else []
            if files:
                return [(_study_name(file, roots), file) for file in files]
    names = {
        _study_name(path, roots) for root in roots for path in root.rglob("*.toml") if path.parent.name != "machines"
    }
    raise StudyError(f"there is no study '{name}'{did_you_mean(name.removesuffix('.toml'), names)}")


def _study_name(path: Path, roots: Sequence[Path]) -> str:
    for root in roots:
        inside, outside = Path(os.path.realpath(path)), os.path.realpath(root)  # which survive a loop of links
        if inside.is_relative_to(outside):
            return inside.relative_to(outside).with_suffix("").as_posix()
    return path.stem


def load(name: str, file: Path, folder: Path, registry: Registry, overrides: Sequence[str] = ()) -> Study:
    """Read a study and resolve every point of its grid; StudyError (or ParameterError) says what does not fit.

    `overrides` are texts such as ``excitation.amplitude=20`` that replace what the file says, its grid included.
    """
    return resolve(name, file, _read(file), folder, registry, overrides)


def resolve(
    name: str, file: Path, data: Mapping[str, Any], folder: Path, registry: Registry, overrides: Sequence[str] = ()
) -> Study:
    """Return the study that the data of a file describe, without reading the file itself."""
    unknown = sorted(set(data) - set(KEYS))
    if unknown:
        raise StudyError(f"{file}: there is no section or key '{unknown[0]}'{did_you_mean(unknown[0], KEYS)}")
    for word in WORDS:
        if not isinstance(data.get(word, ""), str):
            raise StudyError(f"{file}: {word} is {data[word]!r}; expected a text")
    sections = {key: value for key, value in data.items() if key not in ("title", "question", "machine", "grid")}
    if "machine" in data:
        sections = _merge(_machine(data["machine"], file, folder), sections, str(file))
    grid = _grid(data.get("grid", {}), file)
    for text in overrides:
        path, value = _override(text)
        sections = _merge(sections, _nested(path, value), "--set")
        grid = {axis: values for axis, values in grid.items() if axis != path and not axis.startswith(f"{path}.")}
    sweeps = tuple(_sweep(file, sections, point, registry) for point in _points(grid))
    different = {sweep.key: sweep for sweep in reversed(sweeps)}  # points may say the same in two ways
    sweeps = tuple(sweep for sweep in sweeps if different[sweep.key] is sweep)
    return Study(name, file, data.get("title", name), data.get("question", ""), sweeps)


def _read(file: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(file.read_text(encoding="utf-8-sig"))
    except tomllib.TOMLDecodeError as error:
        raise StudyError(f"{file}: is no valid TOML: {error}") from None
    except UnicodeDecodeError:
        raise StudyError(f"{file}: is no text in UTF-8") from None
    except (RecursionError, ValueError) as error:
        raise StudyError(f"{file}: cannot be read as TOML: {error}") from None
    except OSError as error:
        raise StudyError(f"{file}: cannot be read: {error.strerror}") from None


def _machine(name: str, study: Path, folder: Path) -> dict[str, Any]:
    places = (study.parent / "machines", folder / "studies" / "machines", packaged_studies() / "machines")
    for place in places:
        file = place / f"{name}.toml"
        if file.is_file():
            data = _read(file)
            unknown = sorted(set(data) - {"title", "source", *MACHINE})
            if unknown:
                raise StudyError(f"{file}: a machine has no section '{unknown[0]}'{did_you_mean(unknown[0], MACHINE)}")
            return {key: value for key, value in data.items() if key in MACHINE}
    names = {file.stem for place in places for file in place.glob("*.toml")}
    raise StudyError(f"{study}: there is no machine '{name}'{did_you_mean(name, names)}")


def _merge(base: Mapping[str, Any], change: Mapping[str, Any], place: str) -> dict[str, Any]:
    """Return `base` with the sections of `change` laid over it; one with another name replaces the whole section."""
    result = dict(base)
    for key, value in change.items():
        if key not in KEYS:
            raise StudyError(f"{place}: there is no section '{key}'{did_you_mean(key, KEYS)}")
        if not isinstance(value, Mapping):
            raise StudyError(f"{place}: {key} is {value!r}; expected a table such as [{key}]")
        result[key] = _overlay(result.get(key, {}), value)
    return result


def _overlay(old: Any, new: Any) -> Any:
    if not isinstance(old, Mapping) or not isinstance(new, Mapping):
        return new
    if "name" in new and new["name"] != old.get("name", new["name"]):
        return dict(new)
    return {**old, **{key: _overlay(old.get(key), value) for key, value in new.items()}}


def _override(text: str) -> tuple[str, Any]:
    path, equals, value = text.partition("=")
    if path.strip().partition(".")[0] in ("grid", *WORDS):
        raise StudyError(f"--set {text}: only a section's parameters can be set; write another study for the rest")
    if not equals or not path.strip():
        raise StudyError(f"--set {text}: expected PATH=VALUE, such as excitation.amplitude=20")
    try:
        return path.strip(), tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return path.strip(), value.strip()


def _nested(path: str, value: Any) -> dict[str, Any]:
    head, _, rest = path.partition(".")
    return {head: _nested(rest, value) if rest else value}


def _grid(grid: Any, file: Path) -> dict[str, list[Any]]:
    if not isinstance(grid, Mapping):
        raise StudyError(f"{file}: grid is {grid!r}; expected a table [grid]")
    for path, values in grid.items():
        if not isinstance(values, list) or not values:
            raise StudyError(f"{file}, [grid]: '{path}' is {values!r}; expected a list such as [12, 75]")
        if path.partition(".")[0] not in KEYS:
            raise StudyError(f"{file}, [grid]: '{path}' leads nowhere{did_you_mean(path.partition('.')[0], KEYS)}")
    count = 1
    for values in grid.values():
        count *= len(values)
    if count > MOST_SWEEPS:
        raise StudyError(f"{file}, [grid]: it has {count:,} points; expected {MOST_SWEEPS:,} at most")
    return dict(grid)


def _points(grid: Mapping[str, list[Any]]) -> Iterator[dict[str, Any]]:
    for values in itertools.product(*grid.values()):
        yield dict(zip(grid, values, strict=True))


def _sweep(file: Path, base: Mapping[str, Any], point: Mapping[str, Any], registry: Registry) -> Sweep:
    sections = dict(base)
    for path, value in point.items():
        sections = _merge(sections, _nested(path, value), f"{file}, [grid]")
    resolved, files = _resolve(file, sections, registry)
    if "estimator" not in sections:
        raise StudyError(f"{file}: lacks the section [estimator]; known: {', '.join(registry.names('estimator'))}")
    estimator = registry.create("estimator", sections["estimator"], resolved, f"{file}, [estimator]").spec()
    return Sweep(_experiment(file, resolved, registry), estimator, dict(point), files)


def _resolve(file: Path, sections: Mapping[str, Any], registry: Registry) -> tuple[dict[str, Any], dict[str, str]]:
    """Return every section but the estimator as full plain data, and the files that it names."""
    resolved: dict[str, Any] = {}
    files: dict[str, str] = {}
    for key, value in sections.items():
        place = f"{file}, [{key}]"
        if key == "record":
            try:
                settings = records.RecordSettings.parse(value, "record")
                experiment, files = records.resolve(settings, file.parent, registry)
                resolved[key] = experiment["record"]
            except FraexpError as error:
                raise type(error)(f"{place}: {error}") from None
        elif key in SETTINGS:
            resolved[key] = _settings(SETTINGS[key], key, value, place)
        elif key != "estimator":
            resolved[key] = registry.create(key, value, place=place).spec()
    resolved.setdefault("numerics", Numerics().plain())
    return resolved, files


def _settings(cls: type[Parameters], key: str, value: Plain, place: str) -> dict[str, Any]:
    try:
        return cls.parse(value, key).plain()
    except FraexpError as error:
        raise type(error)(f"{place}: {error}") from None


def _experiment(file: Path, resolved: Mapping[str, Any], registry: Registry) -> dict[str, Any]:
    """Return the sections that decide the signals, by their source."""
    if "record" in resolved:
        return {"source": "record", "record": resolved["record"]}
    if "excitation" not in resolved:
        raise StudyError(f"{file}: lacks the section [excitation] (for a simulation) or [record] (for measured data)")
    excitation = create(registry, Excitation, resolved["excitation"])  # type: ignore[type-abstract]
    drives = excitation.quantity == "displacement"
    needed = ("friction", "excitation", "loop") if drives else (*MACHINE, "excitation", "numerics")
    for key in needed:
        if key not in resolved:
            raise StudyError(f"{file}: lacks the section [{key}]; name a machine, or write the section")
    parts = {key: resolved[key] for key in needed}
    sample_time = resolved["loop"]["sample_time"]
    try:
        excitation.check(sample_time)
    except FraexpError as error:
        raise type(error)(f"{file}, [excitation]: {error}") from None
    if drives:
        parts["loop"] = {"sample_time": sample_time}
    return {"source": "drive" if drives else "loop", **parts}
