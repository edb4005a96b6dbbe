"""The help of a screen: its purpose and its current keys."""

from typing import ClassVar

from rich.table import Table
from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.screen import ModalScreen

from fraexp.tui.page import Page
from fraexp.tui.widgets.text_section import TextSection

TOOLKIT_KEYS = ("ctrl+q", "ctrl+p")
"""Keys that Textual adds to every screen, with a meaning that other keys have too."""
MAX_LISTED_KEYS = 4
"""Maximum number of keys with one meaning that are listed one by one."""


class HelpPage(ModalScreen[None]):
    """Help for the screen below it."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape,question_mark,f1,q,enter", "dismiss", "close")]

    def __init__(self, page: Page) -> None:
        super().__init__()
        self._page = page

    def compose(self) -> ComposeResult:
        """Show the text, then the keys."""
        commands = Text("\n: or ctrl+p finds commands by name.")
        yield TextSection(Text(_reflow(self._page.HELP) + "\n"), self._keys(), commands)

    def _keys(self) -> Table:
        table = Table(box=None, padding=(0, 2, 0, 0), show_header=False)
        table.add_column(style="bold", no_wrap=True)
        table.add_column()
        seen: dict[tuple[str, str], list[str]] = {}
        for active in self._page.active_bindings.values():
            binding = active.binding
            what = binding.tooltip
            if what and binding.key not in TOOLKIT_KEYS:
                kind = binding.action.partition("(")[0]  # the keys of all curves have the same meaning
                seen.setdefault((kind, what), []).append(self.app.get_key_display(binding))
        for (_, what), keys in seen.items():
            table.add_row(_keys_text(list(dict.fromkeys(keys))), Text(what))
        return table


def _reflow(text: str) -> str:
    """Return a help text whose lines end with sentences or items, as the dialog breaks them at its own width."""
    lines: list[str] = []
    for line in text.strip().splitlines():
        before = lines[-1] if lines else ""
        if before and line and not before.startswith(" ") and not line.startswith(" ") and before[-1] not in ".:":
            lines[-1] = f"{before} {line}"
        else:
            lines.append(line)
    return "\n".join(lines)


def _keys_text(keys: list[str]) -> Text:
    """Return keys with the same meaning; of many, the first and the last."""
    return Text(" ".join(keys) if len(keys) <= MAX_LISTED_KEYS else f"{keys[0]} to {keys[-1]}")
