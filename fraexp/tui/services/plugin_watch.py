"""A watch on the plugins folder: files that are added, changed or removed while the terminal UI is open."""

from pathlib import Path
from typing import TYPE_CHECKING

from textual.message import Message

from fraexp.data.identity import file_stamps

if TYPE_CHECKING:
    from fraexp.workspace.workspace_service import WorkspaceService


class PluginsChanged(Message):
    """Plugins have been reloaded."""


class PluginWatch:
    """The files of a plugins folder as they were at the last poll."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._seen = file_stamps(folder)

    def changes(self) -> dict[str, str]:
        """Return the files that have been added, changed or removed since the last call."""
        before, self._seen = self._seen, file_stamps(self._folder)
        found = {name: "added" if name not in before else "changed" for name in self._seen}
        found = {name: what for name, what in found.items() if before.get(name) != self._seen[name]}
        return found | {name: "removed" for name in before if name not in self._seen}


def reload_plugins(workspace: "WorkspaceService", changes: dict[str, str]) -> tuple[list[str], bool]:
    """Reload the plugins; return a line for each changed file, and whether one of them fails to load now."""
    workspace.reload()
    broken = {failure.file.name: failure.reason for failure in workspace.registry.failures if failure.file}
    reasons = {name: f"; it failed to load: {broken[name]}" if name in broken else "" for name in changes}
    return [f"plugins/{name} {what}{reasons[name]}" for name, what in changes.items()], any(reasons.values())
