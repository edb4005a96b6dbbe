"""The end of a log, as it grows."""

from pathlib import Path

from textual.widgets import Log

from fraexp.figures.elements.labels import printable

LINES = 200
"""Lines that are kept."""
END = 65_536
"""Bytes from the end at which reading begins."""


class LogTail(Log):
    """The last lines of a file that another process writes; what could command the terminal is written out."""

    DEFAULT_CSS = """
    LogTail { height: 1fr; border-top: solid $panel-lighten-2; padding: 0 1; scrollbar-size-horizontal: 0; }
    """

    def __init__(self) -> None:
        super().__init__(max_lines=LINES)
        self._file: Path | None = None
        self._read = 0
        self._rest = b""
        self.last = ""
        """The last line that says something."""

    def show(self, title: str) -> None:
        """Say what log it is, or why there is none."""
        self.border_title = printable(title).replace("[", r"\[")

    def follow(self, file: Path) -> None:
        """Show what the file says, and what has been added since it was last looked at."""
        if file != self._file:
            self._file, self._read, self._rest = file, 0, b""
            self.clear()
        try:
            with file.open("rb") as stream:
                size = stream.seek(0, 2)
                self._read = max(self._read, size - END) if self._read <= size else 0
                stream.seek(self._read)
                text = stream.read()
        except OSError as error:
            self.show(f"{file}: cannot be read: {error.strerror}")
            return
        self._read += len(text)
        *lines, self._rest = (self._rest + text).split(b"\n")
        shown = [printable(line.decode("utf-8", errors="replace").rstrip()) for line in lines]
        if shown:
            self.last = next((line for line in reversed(shown) if line.strip()), self.last)
            self.write_lines(shown)
