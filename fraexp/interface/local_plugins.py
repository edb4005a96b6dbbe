"""The plugins of a session's workspace: as their files are now, with a line for each that is broken."""

from fraexp.cli.output import say
from fraexp.components.registry import LoadFailure
from fraexp.data.identity import FileStamp
from fraexp.workspace.workspace_service import WorkspaceService

_reported: set[tuple[LoadFailure, FileStamp | None]] = set()
"""Broken plugins that have been reported, each as its file was: calls in a loop report it once."""


def refresh_plugins(service: WorkspaceService) -> None:
    """Load the plugins of a workspace, unless their files are those that it has loaded; report each that is broken."""
    if not service.has_current_plugins():
        reload_plugins(service)


def reload_plugins(service: WorkspaceService, is_asked: bool = False) -> None:
    """Load the plugins of a workspace anew; if this `is_asked` for, what has been reported is reported again."""
    service.reload()
    registry = service.registry
    for failure in registry.failed:
        if failure.file is None:
            continue
        seen = (failure, registry.local_files.get(failure.file.name))
        if is_asked or seen not in _reported:
            say(f"fraexp: the plugin {failure.place} is broken: {failure.reason}")
        _reported.add(seen)
