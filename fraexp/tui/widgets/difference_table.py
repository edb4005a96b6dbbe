"""A table of what differs between the curves of a comparison."""

from rich.text import Text
from textual.widgets import DataTable

from fraexp.data.terminal_text import printable
from fraexp.tui.plotting.compared_sweeps import ComparedSweeps
from fraexp.tui.plotting.curve_styles import curve_digit
from fraexp.tui.widgets.readout import shorten_name

MIN_NAME_WIDTH = 16
"""Minimum width of a name; it gets a third of the table."""


class DifferenceTable(DataTable[Text]):
    """A row for each parameter, metric and fit that differs, and a column for each curve: medians of many sweeps."""

    def fill(self, compared: ComparedSweeps, width: int, beside: bool) -> None:
        """Show other curves in a width; `beside` the plots, whose readout shows the names of the curves."""
        self.clear(columns=True)
        longest = max(MIN_NAME_WIDTH, width // 3)
        self.add_column("difference")
        for place, curve in enumerate(compared.curves):
            digit = curve_digit(place)
            count = len(curve.members)
            number = f"{digit}, median of {count:,}" if count > 1 else digit
            self.add_column(Text(number if beside else f"{digit} {printable(curve.label)}"))
        for name, *values in compared.rows:
            cells = (Text(printable(text)) for text in values)
            self.add_row(Text(shorten_name(printable(name), longest).rstrip()), *cells)
        for owner, count in compared.folded.items():
            self.add_row(Text(shorten_name(f"{owner}.… ({count})", longest).rstrip()), Text("not in all"))
        if not compared.rows:
            self.add_row(Text("none" if len(compared.curves) > 1 else "only one curve; mark other sweeps"))
