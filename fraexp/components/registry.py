"""Finding components: installed packages and files dropped in the workspace, collected through one pluggy hook."""

import importlib
import importlib.util
import inspect
import os
import sys
import traceback
from collections.abc import Iterable, Iterator, Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from functools import partial
from importlib.machinery import SourceFileLoader
from importlib.metadata import entry_points
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, TypeVar, cast

import pluggy
import pydantic

import fraexp
from fraexp.components.kinds import KINDS, Component, nested_kind
from fraexp.components.parameters import Parameters, inherited_from
from fraexp.components.supplies import Supplies, Supply
from fraexp.errors import FraexpError, ParameterError, PluginError, did_you_mean
from fraexp.kernels.watchdog import LAW_TIME_LIMIT_S, OverdueError, place_of, time_limit

hookspec = pluggy.HookspecMarker("fraexp")
hookimpl = pluggy.HookimplMarker("fraexp")

AnyComponent = TypeVar("AnyComponent", bound=Component)
LOCAL = "workspace"
"""Distribution of what dropped-in files supply."""
DROP_IN = "fraexp_drop_in_"
"""Prefix of the module names of dropped-in files: stable, so that compiled laws are found again."""


@hookspec
def fraexp_components() -> Iterable[type[Component]]:
    """Return the component classes that a plugin supplies."""
    raise NotImplementedError  # a specification, never called


@hookspec
def fraexp_component_modules() -> Mapping[str, Iterable[str]]:
    """Return modules of a plugin with the names of their components: each is imported when one is asked for."""
    raise NotImplementedError


@dataclass(frozen=True)
class LoadFailure:
    """A plugin that could not be used, and why, in one line."""

    place: str
    reason: str
    file: Path | None = None
    """The dropped-in file; None for an installed package."""

    def concerns(self, name: str) -> bool:
        """Say whether the plugin may be the one that ought to supply a name; of a package that is not known."""
        if self.file is None:
            return True
        text = self.file.read_text(encoding="utf-8", errors="replace") if self.file.is_file() else ""
        return name == self.file.stem or f'"{name}"' in text or f"'{name}'" in text


@dataclass
class Registry:
    """All components found, by kind and name, and the plugins that failed."""

    supplies: Supplies = field(default_factory=Supplies)
    clashes: dict[tuple[str, str], str] = field(default_factory=dict)
    failed: list[LoadFailure] = field(default_factory=list)
    """Plugins that failed when they were loaded; there may be others that have not been loaded yet."""

    @property
    def failures(self) -> list[LoadFailure]:
        """All plugins that fail: those not loaded yet are loaded for it."""
        self.supplies.load()
        return self.failed

    def add(self, component: type[Component], distribution: str) -> None:
        """Take up a component class; a second one of the same kind and name makes the name unusable."""
        supply = Supply(component, Path(inspect.getfile(component)).resolve(), distribution)
        other = self.supplies.add(supply)
        if other.component is not component:
            name = f"'{component.name}' ({component.kind})"
            reason = f"{name} is supplied by both {_defined(other.component)} and {_defined(component)}; rename one"
            self.clashes[component.kind, component.name] = reason
            self.failed.append(LoadFailure(_from_here(supply.file), reason, supply.file))

    def names(self, kind: str) -> list[str]:
        """Return the names of all components of a kind, sorted."""
        return sorted(name for of, name in self.supplies if of == kind)

    def supply(self, kind: str, name: str) -> Supply:
        """Return the supply of a component; PluginError if there is none, or two."""
        supply = self.supplies.get((kind, name))
        if (kind, name) in self.clashes:
            raise PluginError(self.clashes[kind, name])
        if supply is None:
            raise PluginError(f"no {kind} is called '{name}'{self.instead(name, self.names(kind))}")
        return supply

    def instead(self, name: str, options: Iterable[str]) -> str:
        """Return what helps where a name is not there: the broken plugin that may supply it, or the nearest name."""
        concerned = [failure for failure in self.failures if failure.concerns(name)]
        broken = "".join(f"; {failure.place} may supply it, but is broken: {failure.reason}" for failure in concerned)
        if any(failure.file for failure in concerned):
            return broken
        others = len(self.failures) > len(concerned)
        more = "; others are broken, see 'fraexp plugins'" if others else ""
        return f"{did_you_mean(name, options)}{broken}{more}"

    def used(self, kind: str, spec: Mapping[str, Any]) -> Iterator[Supply]:
        """Yield the supplies of a component in plain data and of those that it holds, as far as they are known."""
        supply = self.supplies.get((kind, str(spec.get("name"))))
        if supply is None:
            return
        yield supply
        for key, info in supply.component.model_fields.items():
            nested, value = nested_kind(info), spec.get(key)
            if nested is not None:
                for part in value if isinstance(value, list) else [value]:
                    yield from self.used(nested.kind, part) if isinstance(part, Mapping) else ()

    def create(self, kind: str, spec: Any, environment: Mapping[str, Any] | None = None, place: str = "") -> Component:
        """Build a component from plain data with its name, optional version and parameters.

        Parameters that are not given and declare a place to inherit from are taken from `environment`, the
        plain experiment. `place` is put in front of the sentence if something does not fit.
        """
        try:
            return self._create(kind, spec, environment or {})
        except FraexpError as error:
            raise type(error)(f"{place}: {error}" if place else str(error)) from None

    def _create(self, kind: str, spec: Any, environment: Mapping[str, Any]) -> Component:
        if not isinstance(spec, Mapping) or not isinstance(spec.get("name"), str):
            raise ParameterError(f"the {kind} lacks a name; known: {', '.join(self.names(kind))}")
        name = spec["name"]
        cls = self.supply(kind, name).component
        version = spec.get("version", cls.version)
        if version != cls.version:
            raise PluginError(f"{name} is asked for in version {version!r}; the one found is version {cls.version}")
        values = {key: value for key, value in spec.items() if key not in ("name", "version", "preset")}
        if "preset" in spec:
            values = {**_preset(cls, spec["preset"]), **values}
        return cls.parse(self.filled(cls, values, environment), name)

    def filled(self, cls: type[Parameters], given: Mapping[str, Any], environment: Mapping[str, Any]) -> dict[str, Any]:
        """Return the values that are given with those that are inherited, components among them built."""
        if not isinstance(given, Mapping):
            raise ParameterError(f"{given!r:.60} is no table of parameters")
        values = dict(given)
        for key, info in cls.model_fields.items():
            origin = inherited_from(info)
            if key not in values and origin is not None:
                found = _look_up(environment, origin)
                if found is not None:
                    values[key] = found
            nested = nested_kind(info)
            if nested is not None and isinstance(values.get(key), Mapping):
                values[key] = self._create(nested.kind, values[key], environment)
            elif nested is not None and isinstance(values.get(key), list | tuple):
                values[key] = tuple(self._create(nested.kind, part, environment) for part in values[key])
        return values


def _preset(cls: type[Component], name: Any) -> Mapping[str, Any]:
    if not isinstance(name, str) or name not in cls.presets:
        raise ParameterError(f"{cls.name} has no preset '{name}'{did_you_mean(str(name), cls.presets)}")
    return cls.presets[name]


def create(registry: Registry, kind: type[AnyComponent], spec: Any, place: str = "") -> AnyComponent:
    """Build a component of a kind, typed."""
    return cast(AnyComponent, registry.create(kind.kind, spec, place=place))


def _look_up(data: Any, path: str) -> Any:
    for part in path.split("."):
        data = data.get(part) if isinstance(data, Mapping) else None
    return data


def discover(folder: Path | None = None) -> Registry:
    """Collect the components of all installed plugins and of the ``*.py`` files in `folder`.

    A plugin that fails is listed in `failures`, with its file, line and reason; all else goes on working.
    """
    registry = Registry()
    manager = pluggy.PluginManager("fraexp")
    manager.add_hookspecs(sys.modules[__name__])
    origins: dict[Any, _Origin] = {}
    for entry in entry_points(group="fraexp"):
        owner = f"{entry.dist.name} {entry.dist.version}" if entry.dist else entry.name
        origin = _Origin(f"{owner} ({entry.value})", owner)
        _attempt(registry, origin, lambda e=entry, o=origin: _register(manager, origins, e.load(), o))
    for file in sorted(folder.glob("*.py")) if folder and folder.is_dir() else []:
        origin = _Origin(str(file), LOCAL, file)
        _attempt(registry, origin, lambda f=file, o=origin: _register(manager, origins, load_file(f), o))
    for plugin, origin in list(origins.items()):  # in the order of finding: pluggy keeps a set
        _attempt(registry, origin, lambda p=plugin, o=origin: _collect(manager, registry, p, o.owner))
    return registry


@dataclass(frozen=True)
class _Origin:
    """Where a plugin comes from."""

    place: str
    owner: str
    file: Path | None = None


def _attempt(registry: Registry, origin: _Origin, action: Any) -> None:
    try:
        with redirect_stdout(sys.stderr):  # what a plugin prints is no data
            action()
    except (Exception, SystemExit) as error:  # a stranger's plugin may raise anything; the rest goes on
        registry.failed.append(LoadFailure(origin.place, reason_of(error, origin.file), origin.file))


def reason_of(error: BaseException, file: Path | None = None) -> str:
    """Return in one line what a plugin ran into, with the line of its `file`, or of what is nearest to it."""
    lines = [(line.filename, line.lineno) for line in traceback.extract_tb(error.__traceback__)]
    own = [line for line in lines if file and line[0] == str(file)]
    foreign = [line for line in lines if not line[0].startswith(MACHINERY)]
    place = next(reversed(own or foreign), None)
    text = str(error).splitlines()[0] if str(error) else ""
    if isinstance(error, SyntaxError):
        text, place = error.msg, (error.filename or str(file), error.lineno)
    if isinstance(error, ImportError) and (error.name or "").partition(".")[0] == "fraexp":
        text = f"{text.partition(' (')[0]}; it was written for another version of fraexp"
    name = "" if isinstance(error, FraexpError) else f"{type(error).__name__}: "
    return f"{name}{text}" + (f" ({Path(place[0]).name}, line {place[1]})" if place and place[1] else "")


MACHINERY = (
    "<frozen",
    *(f"{Path(file or '').parent}{os.sep}" for file in (fraexp.__file__, pluggy.__file__, pydantic.__file__)),
)
"""How the names of files begin in which a plugin's mistake is found but not made."""


def _from_here(file: Path) -> str:
    return str(file.relative_to(Path.cwd())) if file.is_relative_to(Path.cwd()) else str(file)


def _defined(cls: type) -> str:
    return f"{_from_here(Path(inspect.getfile(cls)).resolve())}, line {inspect.getsourcelines(cls)[1]}"


def _register(manager: pluggy.PluginManager, origins: dict[Any, _Origin], module: ModuleType, origin: _Origin) -> None:
    plugin = module if any(hasattr(module, hook) for hook in HOOKS) else _Classes(module)
    manager.register(plugin)
    origins[plugin] = origin


HOOKS = (fraexp_components.__name__, fraexp_component_modules.__name__)


def _collect(manager: pluggy.PluginManager, registry: Registry, plugin: Any, owner: str) -> None:
    others = [other for other in manager.get_plugins() if other is not plugin]
    classes, modules = (manager.subset_hook_caller(hook, remove_plugins=others)() for hook in HOOKS)
    for module, names in (pair for answer in modules for pair in answer.items()):
        registry.supplies.postpone(partial(_load_module, registry, module, owner), names)
    for component in (component for answer in classes for component in answer):
        if not (inspect.isclass(component) and issubclass(component, KINDS) and component.name):
            raise PluginError(f"fraexp_components() returned {component!r}; expected named component classes")
        registry.add(component, owner)


def _load_module(registry: Registry, module: str, owner: str) -> None:
    """Add the components of a module; one that fails takes no other with it."""

    def load() -> None:
        for component in components_in(importlib.import_module(module)):
            registry.add(component, owner)

    _attempt(registry, _Origin(f"{owner} ({module})", owner), load)


class _Classes:
    """The hook of a module that has none: it supplies every component class that it defines."""

    def __init__(self, module: ModuleType) -> None:
        self.module = module

    @hookimpl
    def fraexp_components(self) -> list[type[Component]]:
        """Return the named component classes that the module defines; it may not have forgotten all names."""
        named = components_in(self.module)
        for cls in [] if named else vars(self.module).values():
            if inspect.isclass(cls) and issubclass(cls, Component) and cls.__module__ == self.module.__name__:
                raise PluginError(f"{_defined(cls)}: {cls.__name__} has no name; expected name=... after its base")
        return named


def components_in(module: ModuleType) -> list[type[Component]]:
    """Return the named component classes that a module defines (not those it imports)."""
    members = [cls for _, cls in inspect.getmembers(module, inspect.isclass) if issubclass(cls, Component)]
    return [cls for cls in members if cls.name and cls.__module__ == module.__name__]


class _Fresh(SourceFileLoader):
    """Reads the source each time: its cached bytecode would hide an edit within the second that keeps the size."""

    def get_code(self, fullname: str) -> CodeType:
        """Return the code of the source as it is now."""
        return self.source_to_code(self.get_data(self.path), self.path)


def load_file(file: Path) -> ModuleType:
    """Import a dropped-in file as a module of its own, as it is now."""
    name = DROP_IN + file.stem
    spec = importlib.util.spec_from_file_location(name, file, loader=_Fresh(name, str(file)))
    if spec is None or spec.loader is None:
        raise PluginError(f"{file} is no Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # numba and inspect find the law's source through it
    try:
        with time_limit(LAW_TIME_LIMIT_S):
            spec.loader.exec_module(module)
    except OverdueError as error:
        del sys.modules[name]
        place = place_of(error, str(file), 1)
        why = f"it has not been loaded after {LAW_TIME_LIMIT_S:g} s ({place}); expected definitions at once"
        raise PluginError(why) from None
    except BaseException:
        del sys.modules[name]
        raise
    return module
