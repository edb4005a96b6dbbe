"""Conformance checks for plugin authors: ``test_mine = fraexp.testing.conformance(Mine)``."""

from fraexp.testing.check_catalogue import checks_for
from fraexp.testing.check_report import CheckOutcome, Verdict, conformance, findings
from fraexp.testing.conformance_check import Check
from fraexp.testing.examples import strategy

__all__ = ["Check", "CheckOutcome", "Verdict", "checks_for", "conformance", "findings", "strategy"]
