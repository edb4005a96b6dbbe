"""The sections of a study, laid over one another: those of the file, of a case, of the grid, of the command line."""

from collections.abc import Mapping, Sequence
from typing import Any

from fraexp.components.kinds import Controller, Estimator, Excitation, FrictionModel, Plant
from fraexp.components.measurement_settings import MeasurementSettings
from fraexp.components.parameters import Parameters
from fraexp.data import toml
from fraexp.errors import StudyError, did_you_mean
from fraexp.simulation.motion_limits import MotionLimits
from fraexp.study.paths import SETTINGS as OF_A_LOOP

COMPONENTS = {kind.kind: kind for kind in (Plant, FrictionModel, Controller, Excitation, Estimator)}
SETTINGS: dict[str, type[Parameters]] = {**OF_A_LOOP, "limits": MotionLimits, "measurement": MeasurementSettings}
SECTIONS = (*COMPONENTS, *SETTINGS, "record")
MACHINE = ("plant", "friction", "controller", "loop")
SIGNAL_SECTIONS = ("excitation", "record", "case", "grid", "monte_carlo")
"""Sections of which an autonomous measurement has none, and each other study some."""
WORDS = ("title", "question", "machine", "figure")
GRID = "grid."
"""How the path of an axis begins where the command line gives its values."""


def is_for_autonomous(sections: Mapping[str, Any]) -> bool:
    """Say whether a study is one for an autonomous measurement alone: limits and machine, but no signals."""
    return {"limits", "measurement"} <= sections.keys() and not sections.keys() & set(SIGNAL_SECTIONS)


def merge(base: Mapping[str, Any], change: Mapping[str, Any], place: str) -> dict[str, Any]:
    """Return `base` with the sections of `change` laid over it; one with another name replaces the whole section."""
    result = dict(base)
    for key, value in change.items():
        if key not in SECTIONS:
            raise StudyError(f"{place}: there is no section '{key}'{did_you_mean(key, SECTIONS)}")
        if not isinstance(value, Mapping):
            is_name = isinstance(value, str) and key in COMPONENTS
            table = f"{{ name = '{value}' }}" if is_name else f"[{key}]"
            table += f"; [grid] runs several: {key} = [...]" if isinstance(value, list) else ""
            raise StudyError(f"{place}: {key} is {toml.as_text(value)}; expected a table such as {table}")
        result[key] = overlay(result.get(key, {}), value)
    return result


def overlay(old: Any, new: Any) -> Any:
    """Return a value with another one laid over it: tables key by key, unless they are of another component."""
    if not isinstance(old, Mapping) or not isinstance(new, Mapping):
        return new
    if "name" in new and new["name"] != old.get("name", new["name"]):
        return dict(new)
    return {**old, **{key: overlay(old.get(key), value) for key, value in new.items()}}


def override(text: str) -> tuple[str, Any]:
    """Return path and value of what the command line sets, such as ``excitation.amplitude=20``."""
    path, equals, value = (part.strip() for part in text.partition("="))
    _check_depth(path, "--set")
    if path == "grid" or path.partition(".")[0] in ("case", *WORDS):
        raise StudyError(f"--set {text}: only a section's parameters can be set; write another study for the rest")
    if not equals or not path:
        raise StudyError(f"--set {text}: expected PATH=VALUE, such as excitation.amplitude=20")
    found = toml.value(value)
    if path.startswith(GRID):
        axes({path.removeprefix(GRID): found}, f"--set {text}")
    return path, found


def _check_depth(path: str, place: str) -> None:
    if path.count(".") >= toml.MAX_DEPTH:
        raise StudyError(f"{place}: a path has {path.count('.') + 1} parts; expected {toml.MAX_DEPTH} at most")


def nested_table(path: str, value: Any) -> dict[str, Any]:
    """Return the sections in which a value stands at a path."""
    head, _, rest = path.partition(".")
    return {head: nested_table(rest, value) if rest else value}


def axes(grid: Any, place: str) -> dict[str, list[Any]]:
    """Return the axes of a grid by path; StudyError says which one cannot be one."""
    if not isinstance(grid, Mapping):
        raise StudyError(f"{place}: grid is {toml.as_text(grid)}; expected a table [grid]")
    for path, values in grid.items():
        if isinstance(values, Mapping) and path in SECTIONS:
            inner = next(iter(values), "amplitude")
            raise StudyError(f"{place}: '{path}' is a table; quote the path of an axis: \"{path}.{inner}\" = [...]")
        if not isinstance(values, list) or not values:
            raise StudyError(f"{place}: '{path}' is {toml.as_text(values)}; expected a list such as [12, 75]")
        _check_depth(path, place)
        section = path.partition(".")[0]
        if section not in SECTIONS:
            raise StudyError(f"{place}: '{path}' leads nowhere{did_you_mean(section, SECTIONS)}")
    return dict(grid)


def apply_changes(grid: Mapping[str, list[Any]], changes: Sequence[tuple[str, Any]]) -> dict[str, list[Any]]:
    """Return the axes after changes in their order: a change sets an axis, or makes a parameter none."""
    result = dict(grid)
    for path, value in changes:
        axis = path.removeprefix(GRID)
        if axis != path:
            result[axis] = value
        else:
            result = {of: values for of, values in result.items() if of != path and not of.startswith(f"{path}.")}
    return result
