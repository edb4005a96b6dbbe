"""The process that checks components: one line of JSON for each finding, and a last one where a law never returns.

It is a process of its own because a compiled law that never returns, or that writes where it must not, ends with it.
"""

import inspect
import json
import os
import signal
import sys
from collections.abc import Mapping
from pathlib import Path
from traceback import walk_tb
from types import FrameType
from typing import Any

from fraexp.components.kinds import Component, FrictionModel
from fraexp.errors import FraexpError
from fraexp.kernels.call_watch import hang_listener, running_call_text
from fraexp.testing.check_catalogue import checks_for, quick_checks_for
from fraexp.testing.check_report import Finding, Verdict, findings, quick_findings
from fraexp.testing.component_lookup import named_components
from fraexp.testing.conformance_check import Check
from fraexp.testing.sentinel import Sentinel, innermost_line
from fraexp.testing.walk import Drive, describe_component


class CheckProcess:
    """Checks the components that are ordered, and reports each finding; what a plugin prints goes to stderr."""

    def __init__(self, order: Mapping[str, Any]) -> None:
        self._order, self._quick = order, bool(order["quick"])
        self._lines = os.fdopen(os.dup(1), "w", encoding="utf-8", errors="backslashreplace")
        os.dup2(2, 1)
        self._component: type[Component] = Component
        self._check: Check | None = None
        self._example: object = None

    def run(self) -> None:
        """Check all components."""
        Sentinel(self._report_stuck, self._lines).start()
        try:
            order = self._order
            # The sentinel ends the process; what compiled code is called with is on record where somebody listens.
            with hang_listener(lambda text: None):
                for component in named_components(order["name"], order["kind"], Path(order["workspace"])):
                    self._check_component(component)
            self._report(end=True)
        except FraexpError as error:
            self._report(error=str(error))
        except (KeyboardInterrupt, SystemExit) as error:  # Ctrl-C does not reach this process: a plugin raised it
            subject = self._subject(list(walk_tb(error.__traceback__))[-1][0])
            self._report_end(f"{subject} raises {type(error).__name__}, which ends fraexp; expected another error")

    def _check_component(self, component: type[Component]) -> None:
        self._component = component
        checks = checks_for(component)
        quick = quick_checks_for(component) if self._quick else checks
        left_out = {check.name for check in checks} - {check.name for check in quick}
        self._report(
            component={"kind": component.kind, "name": component.name, "version": component.version},
            place=_source_place(component),
            checks={check.name: check.meaning for check in quick},
            left_out=[check.name for check in checks if check.name in left_out],
        )
        found = (
            quick_findings(component, self._note_example)
            if self._quick
            else findings(component, on_example=self._note_example)
        )
        for finding in found:
            self._report(finding=_finding_document(finding))

    def _note_example(self, check: Check, example: object) -> None:
        self._check, self._example = check, example

    def _report_stuck(self, frame: FrameType, is_compiling: bool, seconds: float) -> None:
        """Report that the main thread does not return, and what it is busy with."""
        if self._check is None:
            self._report_end(f"the plugins have not been loaded after {seconds:.0f} s; expected seconds")
            return
        did = "has not been compiled" if is_compiling else "has not returned"
        self._report_end(
            running_call_text() or f"{self._subject(frame)} {did} after {seconds:.0f} s; {REMEDY[is_compiling]}"
        )

    def _report_end(self, reason: str) -> None:
        """Report why no more is checked: a failure of the check in progress, if there is one."""
        if self._check is None:
            self._report(error=reason)
            return
        finding = Finding(self._check, Verdict.FAILED, reason, self._example_text(), reason)
        self._report(finding=_finding_document(finding))
        self._report(end=True)

    def _subject(self, frame: FrameType) -> str:
        """Return what is being checked, with its file and line."""
        owner = getattr(self._example, "model", self._example)
        if not isinstance(owner, FrictionModel):
            return f"{self._component.kind} {self._component.name}"
        code = owner.law.__code__
        line = innermost_line(frame, code.co_filename) or code.co_firstlineno
        return f"the law of {owner.name} ({Path(code.co_filename).name}, line {line})"

    def _example_text(self) -> str:
        """Return the example without trying the law: a path appears only if its length is known already."""
        owner = getattr(self._example, "model", self._example)
        if isinstance(self._example, Drive) and "length" in vars(self._example):
            return str(self._example)
        return describe_component(owner) if isinstance(owner, Component) else ""

    def _report(self, **entry: object) -> None:
        self._lines.write(json.dumps(entry) + "\n")
        self._lines.flush()


REMEDY = {
    True: "expected some seconds; shorten it, or simplify its loops",
    False: "expected a force within milliseconds; check the conditions that end its loops",
}
"""Remedy, by whether the compiler is busy with the law (True) or the law does not return (False)."""


def _finding_document(finding: Finding) -> dict[str, str]:
    """Return a finding as the command reads it."""
    return {
        "name": finding.check.name, "meaning": finding.check.meaning, "verdict": finding.verdict.name.lower(),
        "reason": finding.reason, "example": finding.example, "ends": finding.stop_reason,
    }  # fmt: skip


def _source_place(component: type[Component]) -> str:
    """Return file and line of a component: of a friction model, those of its law."""
    try:
        code = component.advance.__code__ if issubclass(component, FrictionModel) else None
        line = code.co_firstlineno if code else inspect.getsourcelines(component)[1]
        return f"{Path(inspect.getfile(component)).name}, line {line}"
    except (OSError, TypeError):
        return component.__module__


def main() -> None:
    """Do what the first argument orders, as JSON."""
    from hypothesis.configuration import set_hypothesis_home_dir

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the command, which then ends this process
    order = json.loads(sys.argv[1])
    set_hypothesis_home_dir(order["folder"])  # it would write into the folder that the user is in
    CheckProcess(order).run()


if __name__ == "__main__":
    main()
