"""The schema's history. A new revision is a file in `versions` and its name at the end of HISTORY."""

from pathlib import Path

FOLDER = Path(__file__).parent

HISTORY = ("0001", "0002", "0003", "0004", "0005", "0006", "0007")
"""Revisions from the first to the current one: known without importing Alembic."""
