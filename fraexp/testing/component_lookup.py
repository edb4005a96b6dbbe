"""The components that a user names: by their own name, or by their plugin's file."""

from collections.abc import Iterator
from pathlib import Path

from fraexp.components.kinds import Component
from fraexp.components.local_file import failed_classes, load_file
from fraexp.components.registry import Registry, components_in, discover, reason_of
from fraexp.errors import PluginError


def named_components(name: str, kind: str | None, workspace: Path) -> Iterator[type[Component]]:
    """Yield the component of a name, or all that a plugin's file defines; PluginError if there is none."""
    if name.endswith(".py"):
        return _components_in_file(Path(name), kind)
    return _components_by_name(name, kind, discover(workspace / "plugins"))


def _components_in_file(file: Path, kind: str | None) -> Iterator[type[Component]]:
    if not file.is_file():
        raise PluginError(f"{file}: there is no such file")
    try:
        module = load_file(file)
    except (Exception, SystemExit) as error:  # a stranger's file may raise anything
        raise PluginError(f"{file} cannot be loaded: {reason_of(error, file)}") from error
    chosen = [component for component in components_in(module) if kind in (None, component.kind)]
    if not chosen:
        what = f"{kind} component" if kind else "component"
        raise PluginError(f"{file}: defines no {what}; expected a class such as class Mine(FrictionModel, name=...)")
    yield from chosen
    for failure in failed_classes(module):
        raise PluginError(f"{file}: a class cannot be defined: {reason_of(failure, file)}")


def _components_by_name(name: str, kind: str | None, registry: Registry) -> Iterator[type[Component]]:
    kinds = sorted({of for of, known in registry.providers if known == name and kind in (None, of)})
    if len(kinds) > 1:
        raise PluginError(f"'{name}' is the name of a {' and of a '.join(kinds)}; choose one with --kind")
    if not kinds:
        names = {known for of, known in registry.providers if kind in (None, of)}
        raise PluginError(f"no {kind or 'component'} is called '{name}'{registry.missing_name_remedy(name, names)}")
    yield registry.provider(kinds[0], name).component
