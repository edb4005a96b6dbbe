"""The published numbers of a run's study beside ours, as text and as documents."""

from collections.abc import Sequence
from typing import Any

from fraexp.cli.output import print_table, say
from fraexp.reports.published_comparisons import comparison_document, verdict
from fraexp.reports.report_tables import published_table
from fraexp.study.published_values import PublishedComparison


def published_documents(compared: Sequence[PublishedComparison]) -> list[dict[str, Any]]:
    """Return the published numbers beside ours as JSON documents."""
    return [comparison_document(one) for one in compared]


def print_published(compared: Sequence[PublishedComparison]) -> None:
    """Print the published numbers beside ours, and how many are met."""
    table = published_table(compared)
    if table:
        print()
        rows = [[*(cell.text for cell in row), row[0].detail] for row in table.rows]
        print_table([*table.titles, "note"], rows)
        say(verdict(compared))
