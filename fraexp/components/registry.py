"""Finding components: installed packages and files dropped in the workspace, collected through one pluggy hook."""

import importlib
import inspect
import os
import re
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from functools import cache, cached_property, partial
from importlib.metadata import entry_points
from inspect import cleandoc
from pathlib import Path
from threading import RLock
from types import ModuleType
from typing import Any, TypeVar, cast, get_origin

import pluggy
import pydantic

import fraexp
from fraexp.components.kinds import KINDS, Component, named_kind, nested_kind
from fraexp.components.local_file import DROP_IN, load_file, loaded_source_hash
from fraexp.components.parameters import Parameters, example_call, inherited_from, is_inherited
from fraexp.components.position_dependence import positioned_class
from fraexp.data.identity import FileStamp, file_hash, file_stamps
from fraexp.data.rotary_axes import is_rotary
from fraexp.data.sweep import components_by_port
from fraexp.errors import FraexpError, ParameterError, PluginError, did_you_mean

DEFINITION = re.compile(r"^class \w+\([^)]*\bname=[\"']([^\"']+)[\"']", re.MULTILINE)
"""A class statement that names a component."""
COMPONENT_KINDS = frozenset(kind.kind for kind in KINDS)
"""Sections such as ``loop`` are none of them: nothing is imported to look for one."""
Key = tuple[str, str]
"""Kind and name of a component."""


@dataclass(frozen=True)
class Provider:
    """A component class and where it comes from."""

    component: type[Component]
    file: Path
    distribution: str
    """Name and version of the installed package, or ``workspace`` for a dropped-in file."""
    loaded: str = ""
    """Content hash of a dropped-in source as it was loaded; empty for a module of a package."""

    @cached_property
    def source_hash(self) -> str:
        """Content hash of the source that defines the component."""
        return self.loaded or file_hash(self.file)

    @property
    def paragraphs(self) -> list[str]:
        """The paragraphs of the component's description, each as one line."""
        text = cleandoc(self.component.__doc__ or "")
        return [" ".join(part.split()) for part in text.split("\n\n") if part.strip()]


def component_modules(package: str, folders: Iterable[str]) -> dict[str, list[str]]:
    """Return the modules of a package, without importing them, each with the names of components that its text defines.

    Modules and folders with a leading underscore are helpers and left out. A name that this overlooks costs time, but
    no component: if a name is not found, all modules are imported.
    """
    files = [(Path(folder), file) for folder in folders for file in sorted(Path(folder).rglob("*.py"))]
    modules = {}
    for folder, file in files:
        parts = file.relative_to(folder).with_suffix("").parts
        inner = parts[:-1] if parts[-1] == "__init__" else parts
        if inner and not any(part.startswith("_") for part in inner):
            modules[".".join((package, *inner))] = _defined_names(file, file.stat().st_mtime_ns)
    return modules


@cache
def _defined_names(file: Path, changed: int) -> list[str]:
    """Return the names that a file's text defined when it was last changed [ns]."""
    return DEFINITION.findall(file.read_text(encoding="utf-8"))


class Providers(Mapping[Key, Provider]):
    """Providers by kind and name: those that were added, and those of modules that are loaded when they are needed."""

    def __init__(self, known: Mapping[Key, Provider] | None = None) -> None:
        self._known = dict(known or {})
        self._postponed: dict[Callable[[], None], frozenset[str]] = {}
        self._lock = RLock()  # the terminal UI asks from several threads

    def postpone(self, load: Callable[[], None], names: Iterable[str]) -> None:
        """Call `load`, which adds providers, when one of these names is asked for, or all that there are."""
        self._postponed[load] = frozenset(names)

    def add(self, provider: Provider) -> Provider:
        """Add a provider; return the one that has its kind and name: the first one."""
        key = (provider.component.kind, provider.component.name)
        self.load(provider.component.name)  # a package's component comes before a dropped-in one
        return self._known.setdefault(key, provider)

    def replace(self, provider: Provider) -> None:
        """Add a provider in place of the one that has its kind and name, such as a class that was defined anew."""
        self.load(provider.component.name)
        self._known[provider.component.kind, provider.component.name] = provider

    def load(self, name: str | None = None) -> None:
        """Load the modules that define a name, or all that are left."""
        with self._lock:
            for load in [load for load, names in self._postponed.items() if name is None or name in names]:
                if self._postponed.pop(load, None) is not None:
                    load()

    def __getitem__(self, key: Key) -> Provider:
        self.load(key[1])
        if key not in self._known and key[0] in COMPONENT_KINDS:
            self.load()
        return self._known[key]

    def __iter__(self) -> Iterator[Key]:
        self.load()
        return iter(self._known)

    def __len__(self) -> int:
        self.load()
        return len(self._known)


hookspec = pluggy.HookspecMarker("fraexp")
hookimpl = pluggy.HookimplMarker("fraexp")

AnyComponent = TypeVar("AnyComponent", bound=Component)
LOCAL = "workspace"
"""Distribution of what local plugins provide."""
SESSION = "session"
"""Distribution of classes that were defined interactively: no other process knows them."""

MIN_PORTS = 2
"""Ports from which a machine's friction is no single model, or its controller no single one."""


@hookspec
def fraexp_components() -> Iterable[type[Component]]:
    """Return the component classes that a plugin provides."""
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

    def may_provide(self, name: str) -> bool:
        """Say whether the plugin may be the one that should provide a name; a package always may."""
        if self.file is None:
            return True
        text = self.file.read_text(encoding="utf-8", errors="replace") if self.file.is_file() else ""
        return name == self.file.stem or f'"{name}"' in text or f"'{name}'" in text


@dataclass
class Registry:
    """All components found, by kind and name, and the plugins that failed."""

    providers: Providers = field(default_factory=Providers)
    clashes: dict[tuple[str, str], str] = field(default_factory=dict)
    failed: list[LoadFailure] = field(default_factory=list)
    """Plugins that failed when they were loaded; there may be others that have not been loaded yet."""
    local_files: Mapping[str, FileStamp] = field(default_factory=dict)
    """The dropped-in files as they were before they were loaded."""

    @property
    def failures(self) -> list[LoadFailure]:
        """All plugins that fail: those not loaded yet are loaded for it."""
        self.providers.load()
        return self.failed

    def add(self, component: type[Component], distribution: str) -> None:
        """Register a component class; a second one of the same kind and name makes the name unusable."""
        file = Path(inspect.getfile(component)).resolve()
        provider = Provider(component, file, distribution, loaded_source_hash(component))
        other = self.providers.add(provider)
        if other.component is not component:
            name = f"'{component.name}' ({component.kind})"
            places = f"{_definition_place(other.component)} and {_definition_place(component)}"
            reason = f"{name} is provided by both {places}; rename one"
            self.clashes[component.kind, component.name] = reason
            self.failed.append(LoadFailure(_relative_path(provider.file), reason, provider.file))

    def add_from_session(self, component: type[Component]) -> None:
        """Register a class that was defined interactively, unless a plugin provides it; a later definition counts."""
        known = self.providers.get((component.kind, component.name))
        if known is not None and known.distribution != SESSION and known.component is not component:
            raise PluginError(
                f"'{component.name}' ({component.kind}) is provided by {known.distribution}; rename yours"
            )
        if known is None or known.component is not component:
            self.providers.replace(Provider(component, Path(), SESSION))

    def names(self, kind: str) -> list[str]:
        """Return the names of all components of a kind, sorted."""
        return sorted(name for of, name in self.providers if of == kind)

    def provider(self, kind: str, name: str) -> Provider:
        """Return the provider of a component; PluginError if there is none, or two."""
        provider = self.providers.get((kind, name))
        if (kind, name) in self.clashes:
            raise PluginError(self.clashes[kind, name])
        if provider is None:
            remedy = _session_remedy(kind, name) or self.missing_name_remedy(name, self.names(kind))
            raise PluginError(f"no {kind} is called '{name}'{remedy}")
        return provider

    def missing_name_remedy(self, name: str, options: Iterable[str]) -> str:
        """Return a remedy for a missing name: the broken plugin that may provide it, or the nearest name."""
        concerned = [failure for failure in self.failures if failure.may_provide(name)]
        broken = "".join(f"; {failure.place} may provide it, but is broken: {failure.reason}" for failure in concerned)
        if any(failure.file for failure in concerned):
            return broken
        others = len(self.failures) > len(concerned)
        more = "; others are broken, see 'fraexp plugins'" if others else ""
        return f"{did_you_mean(name, options)}{broken}{more}"

    def used_providers(self, kind: str, spec: Mapping[str, Any]) -> Iterator[Provider]:
        """Yield the known providers of a component in plain data, and of the components in it."""
        for part in components_by_port(spec).values():
            yield from self.used_providers(kind, part)
        name = spec.get("name")
        provider = self.providers.get((kind, name)) if isinstance(name, str) else None
        if provider is None:
            return
        yield provider
        for key, info in provider.component.model_fields.items():
            nested, named, value = nested_kind(info), named_kind(info), spec.get(key)
            if named is not None:
                known = [self.providers.get((named.kind, name)) for name in value or ()]
                yield from (each for each in known if each is not None)
            if nested is not None:
                for part in value if isinstance(value, list) else [value]:
                    yield from self.used_providers(nested.kind, part) if isinstance(part, Mapping) else ()

    def create(
        self, kind: str, spec: Any, environment: Mapping[str, Any] | None = None, place: str = "", path: str = ""
    ) -> Component:
        """Build a component from plain data with its name, optional version and parameters.

        Parameters that are not given and declare a place to inherit from are taken from `environment`, the
        plain experiment. If something does not fit, `place` is put in front of the sentence, and `path`, or the kind,
        in front of the parameter's path.
        """
        try:
            return self._create(kind, spec, environment or {})
        except FraexpError as error:
            raise (error.at(f"{place}: ", path or kind) if place else error) from None

    def _create(self, kind: str, spec: Any, environment: Mapping[str, Any]) -> Component:
        if not isinstance(spec, Mapping) or not isinstance(spec.get("name"), str):
            raise ParameterError(f"the {kind} lacks a name; known: {', '.join(self.names(kind))}")
        name = spec["name"]
        cls = self.provider(kind, name).component
        version = spec.get("version", cls.version)
        if version != cls.version:
            raise PluginError(f"{name}: version {version!r} requested, version {cls.version} installed")
        values = {key: value for key, value in spec.items() if key not in ("name", "version", "preset")}
        if "preset" in spec:
            values = {**_preset(cls, spec["preset"]), **values}
        cls = positioned_class(cls, values)
        filled = self.fill_inherited(cls, values, environment)
        return cls.parse(filled, name, rotary=is_rotary(environment))

    def fill_inherited(
        self, cls: type[Parameters], given: Mapping[str, Any], environment: Mapping[str, Any]
    ) -> dict[str, Any]:
        """Return the values that are given with those that are inherited, components among them built."""
        if not isinstance(given, Mapping):
            raise ParameterError(f"{given!r:.60} is no table of parameters")
        values = dict(given)
        for key, info in cls.model_fields.items():
            origin = inherited_from(info)
            if key not in values and origin is not None and is_inherited(info, values):
                found = _look_up(environment, origin)
                if found is not None:
                    values[key] = found
            nested, named = nested_kind(info), named_kind(info)
            if named is not None and isinstance(values.get(key), list | tuple):
                values[key] = tuple(
                    self.provider(named.kind, each).component if isinstance(each, str) else each for each in values[key]
                )
            elif nested is not None and get_origin(info.annotation) is dict:
                values[key] = {
                    of: self._create(nested.kind, part, environment)
                    for of, part in components_by_port(values.get(key)).items()
                }
            elif nested is not None and key not in given and _is_for_contacts(cls, nested, values.get(key)):
                del values[key]  # another parameter takes a model for each contact
            elif nested is not None and isinstance(values.get(key), Mapping):
                self._check_one_model(cls, nested, values[key])
                values[key] = self._create(nested.kind, values[key], environment)
            elif nested is not None and isinstance(values.get(key), list | tuple):
                values[key] = tuple(self._create(nested.kind, part, environment) for part in values[key])
        return values

    def _check_one_model(self, cls: type[Parameters], nested: type[Component], spec: Mapping[str, Any]) -> None:
        """Raise ParameterError for components of several ports, such as a machine's, where one is taken."""
        ports, kind = list(components_by_port(spec)), getattr(cls, "kind", "")
        if len(ports) < MIN_PORTS:
            return
        known = [name for name in self.names(kind) if (kind, name) not in self.clashes]
        able = [name for name in known if _takes_contacts(self.provider(kind, name).component, nested)]
        what, port = ("friction model", "contact") if nested.kind == "friction" else (nested.kind, "controlled thrust")
        raise ParameterError(
            f"{getattr(cls, 'name', cls.__name__)} takes one {what}, and there is one for each of {len(ports)} {port}s "
            f"({', '.join(ports)}); use {' or '.join(able) or f'a machine with one {port}'}"
        )


def _takes_contacts(cls: type[Parameters], nested: type[Component]) -> bool:
    """Say whether a component takes a model of this kind for each contact."""
    infos = [info for info in cls.model_fields.values() if get_origin(info.annotation) is dict]
    return any(nested_kind(info) is nested for info in infos)


def _is_for_contacts(cls: type[Parameters], nested: type[Component], value: Any) -> bool:
    """Say whether a value is components of several ports, which a component takes by another parameter."""
    return len(components_by_port(value)) >= MIN_PORTS and _takes_contacts(cls, nested)


def _session_remedy(kind: str, name: str) -> str:
    """Return what to do about the name of a class that was defined interactively; empty if there is none."""
    classes = [of for of in KINDS if of.kind == kind]
    for cls in classes:  # the list grows while it is read
        classes += cls.__subclasses__()
    found = [of for of in classes if of.name == name and not of.__module__.startswith(DROP_IN)]
    return f"; the class {found[-1].__name__} of this session is: give {example_call(found[-1])}" if found else ""


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
    registry = Registry(local_files=file_stamps(folder) if folder else {})
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
    is_own_error = isinstance(error, FraexpError)  # it says what is wrong, and where it was noticed does not matter
    foreign = [line for line in lines if not (is_own_error or line[0].startswith(MACHINERY))]
    place = next(reversed(own or foreign), None)
    text = str(error).splitlines()[0] if str(error) else ""
    if isinstance(error, SyntaxError):
        text, place = error.msg, (error.filename or str(file), error.lineno)
    if isinstance(error, ImportError) and (error.name or "").partition(".")[0] == "fraexp":
        text = f"{text.partition(' (')[0]}; it was written for another version of fraexp"
    name = "" if is_own_error else f"{type(error).__name__}: "
    return f"{name}{text}" + (f" ({Path(place[0]).name}, line {place[1]})" if place and place[1] else "")


MACHINERY = (
    "<frozen",
    *(f"{Path(file or '').parent}{os.sep}" for file in (fraexp.__file__, pluggy.__file__, pydantic.__file__)),
)
"""How the names of files begin in which a plugin's mistake is found but not made."""


def _relative_path(file: Path) -> str:
    return str(file.relative_to(Path.cwd())) if file.is_relative_to(Path.cwd()) else str(file)


def _definition_place(cls: type) -> str:
    return f"{_relative_path(Path(inspect.getfile(cls)).resolve())}, line {inspect.getsourcelines(cls)[1]}"


def _register(manager: pluggy.PluginManager, origins: dict[Any, _Origin], module: ModuleType, origin: _Origin) -> None:
    plugin = module if any(hasattr(module, hook) for hook in HOOKS) else _Classes(module)
    manager.register(plugin)
    origins[plugin] = origin


HOOKS = (fraexp_components.__name__, fraexp_component_modules.__name__)


def _collect(manager: pluggy.PluginManager, registry: Registry, plugin: Any, owner: str) -> None:
    others = [other for other in manager.get_plugins() if other is not plugin]
    classes, modules = (manager.subset_hook_caller(hook, remove_plugins=others)() for hook in HOOKS)
    for module, names in (pair for answer in modules for pair in answer.items()):
        registry.providers.postpone(partial(_load_module, registry, module, owner), names)
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
    """The hook of a module that has none: it provides every component class that it defines."""

    def __init__(self, module: ModuleType) -> None:
        self.module = module

    @hookimpl
    def fraexp_components(self) -> list[type[Component]]:
        """Return the named component classes that the module defines; it may not have forgotten all names."""
        named = components_in(self.module)
        for cls in [] if named else vars(self.module).values():
            if inspect.isclass(cls) and issubclass(cls, Component) and cls.__module__ == self.module.__name__:
                raise PluginError(
                    f"{_definition_place(cls)}: {cls.__name__} has no name; expected name=... after its base"
                )
        return named


def components_in(module: ModuleType) -> list[type[Component]]:
    """Return the named component classes that a module defines (not those it imports)."""
    classes = [cls for cls in vars(module).values() if inspect.isclass(cls) and cls.__module__ == module.__name__]
    return sorted((cls for cls in classes if issubclass(cls, Component) and cls.name), key=lambda cls: cls.__name__)
