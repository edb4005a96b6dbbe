"""The type of line styles."""

from typing import Any

LineStyle = dict[str, Any]
"""Keyword arguments of matplotlib for a line, such as color, linestyle, linewidth and zorder."""
