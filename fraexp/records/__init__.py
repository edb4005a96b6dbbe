"""The measured source of signals: a record's settings, what they resolve to, and its signals."""

from fraexp.records.record_settings import RecordSettings
from fraexp.records.source import load, resolve

__all__ = ["RecordSettings", "load", "resolve"]
