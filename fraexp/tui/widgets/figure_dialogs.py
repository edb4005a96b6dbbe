"""The export of a figure: the questions before it, and what came of it."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fraexp.data.terminal_text import printable
from fraexp.figures.elements.view import View
from fraexp.tui.dialogs import ConfirmDialog, InputDialog
from fraexp.tui.page import Page
from fraexp.tui.plotting.figure_export import draw_figure, file_fault
from fraexp.views.words import plural


@dataclass(frozen=True)
class FigureExport:
    """A figure of sweeps that is to be exported."""

    count: int
    """Number of its sweeps."""
    named: Sequence[str]
    """Arguments of a command line that name them."""
    kind: str
    view: View
    by: Sequence[str] | None
    """Labels that make groups; None: all."""

    def ask(self, page: Page, proposed: str) -> None:
        """Ask for a file, and draw the figure into it."""
        if not self.count:
            page.app.notify("all curves are hidden; press 0 to show them", severity="warning")
            return
        what = plural(self.count, "sweep")
        question = f"Export {what} as a {self.kind} figure to this file (.png, .svg or .pdf):"

        def export_to(answer: str | None) -> None:
            file = Path(answer.strip()).expanduser() if answer else None
            if file and file.exists():
                asked = ConfirmDialog(f"{file} already exists. Overwrite it?")
                page.app.push_screen(asked, lambda yes: self._start(page, file) if yes else None)
            elif file:
                self._start(page, file)

        page.app.push_screen(InputDialog(question, proposed, file_fault), export_to)

    def _start(self, page: Page, file: Path) -> None:
        page.app.notify(f"drawing {printable(str(file))} …", timeout=3, markup=False)
        page.run_worker(self._draw(page, file), group="export")

    async def _draw(self, page: Page, file: Path) -> None:
        workspace = page.app.backend.workspace
        ended, text = await draw_figure(workspace, self.named, self.kind, file, self.view, self.by)
        page.app.notify(printable(text), title="exported" if ended else "not exported",
                        severity="information" if ended else "error", markup=False)  # fmt: skip
