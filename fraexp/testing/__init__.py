"""Conformance checks for plugin authors: ``test_mine = fraexp.testing.conformance(Mine)``."""

from fraexp.testing.catalogue import checks_for
from fraexp.testing.check import Check
from fraexp.testing.conformance import conformance
from fraexp.testing.examples import strategy
from fraexp.testing.report import Finding, Report, Verdict, findings, run_checks

__all__ = ["Check", "Finding", "Report", "Verdict", "checks_for", "conformance", "findings", "run_checks", "strategy"]
