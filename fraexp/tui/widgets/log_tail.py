"""The end of a growing log file."""

from pathlib import Path

from textual.widgets import Log

from fraexp.data.terminal_text import printable

MAX_LINES = 200
"""Maximum number of lines kept."""
TAIL_BYTES = 65_536
"""Bytes before the end at which reading begins."""


class LogTail(Log):
    """The last lines of a file that another process writes, free of terminal control sequences."""

    DEFAULT_CSS = """
    LogTail { height: 1fr; border-top: solid $border-blurred; border-title-color: $text-muted; padding: 0 1; }
    LogTail { background: $background; scrollbar-size-horizontal: 0; }
    """

    def __init__(self) -> None:
        super().__init__(max_lines=MAX_LINES)
        self._file: Path | None = None
        self._read = 0
        self._rest = b""
        self._title = ""
        self.last = ""
        """The last line that is not blank."""

    def show(self, title: str) -> None:
        """Show the title: the path of the log, or why there is none."""
        escaped = printable(title).replace("[", r"\[")
        if escaped != self._title:
            self.border_title = self._title = escaped

    def follow(self, file: Path) -> None:
        """Show the end of the file, and lines added since the last call."""
        if file != self._file:
            self._file, self._read, self._rest = file, 0, b""
            self.clear()
        try:
            with file.open("rb") as stream:
                size = stream.seek(0, 2)
                self._read = max(self._read, size - TAIL_BYTES) if self._read <= size else 0
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
