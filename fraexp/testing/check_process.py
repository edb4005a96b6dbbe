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
from types import FrameType
from typing import Any

from fraexp.components.kinds import Component, FrictionModel
from fraexp.errors import FraexpError
from fraexp.testing.check_catalogue import checks_for, quick_checks_for
from fraexp.testing.check_report import Finding, Verdict, findings, quick_findings
from fraexp.testing.component_lookup import named_components
from fraexp.testing.conformance_check import Check
from fraexp.testing.sentinel import Sentinel, line_within
from fraexp.testing.walk import Drive, described


class CheckProcess:
    """Checks what is asked for, and tells of it; what a plugin prints goes to stderr."""

    def __init__(self, order: Mapping[str, Any]) -> None:
        self._order, self._quick = order, bool(order["quick"])
        self._lines = os.fdopen(os.dup(1), "w", encoding="utf-8", errors="backslashreplace")
        os.dup2(2, 1)
        self._component: type[Component] = Component
        self._check: Check | None = None
        self._example: Any = None

    def run(self) -> None:
        """Check all components."""
        Sentinel(self._give_up, self._lines).start()
        try:
            order = self._order
            for component in list(named_components(order["name"], order["kind"], Path(order["workspace"]))):
                self._run(component)
            self._tell(end=True)
        except FraexpError as error:
            self._tell(error=str(error))

    def _run(self, component: type[Component]) -> None:
        self._component = component
        checks = checks_for(component)
        quick = quick_checks_for(component) if self._quick else checks
        left_out = {check.name for check in checks} - {check.name for check in quick}
        self._tell(
            component={"kind": component.kind, "name": component.name, "version": component.version},
            place=_place(component),
            checks={check.name: check.meaning for check in quick},
            left_out=[check.name for check in checks if check.name in left_out],
        )
        found = quick_findings(component, self._begin) if self._quick else findings(component, begins=self._begin)
        for finding in found:
            self._tell(finding=_document(finding))

    def _begin(self, check: Check, example: Any) -> None:
        self._check, self._example = check, example

    def _give_up(self, frame: FrameType, compiling: bool, seconds: float) -> None:
        """Tell that the main thread does not come back, and with what it is busy."""
        if self._check is None:
            self._tell(error=f"the plugins have not been loaded after {seconds:.0f} s; expected seconds")
            return
        did = "has not been compiled" if compiling else "has not returned"
        reason = f"{self._named(frame)} {did} after {seconds:.0f} s; {REMEDY[compiling]}"
        finding = Finding(self._check, Verdict.FAILED, reason, self._described(), reason)
        self._tell(finding=_document(finding))
        self._tell(end=True)

    def _named(self, frame: FrameType) -> str:
        """Return what is being checked, with its file and line."""
        owner = getattr(self._example, "model", self._example)
        if not isinstance(owner, FrictionModel):
            return f"{self._component.kind} {self._component.name}"
        code = owner.law.__code__
        line = line_within(frame, code.co_filename) or code.co_firstlineno
        return f"the law of {owner.name} ({Path(code.co_filename).name}, line {line})"

    def _described(self) -> str:
        """Return the example without trying the law: a path is told only where its length is known already."""
        owner = getattr(self._example, "model", self._example)
        if isinstance(self._example, Drive) and "length" in vars(self._example):
            return str(self._example)
        return described(owner) if isinstance(owner, Component) else ""

    def _tell(self, **told: Any) -> None:
        self._lines.write(json.dumps(told) + "\n")
        self._lines.flush()


REMEDY = {
    True: "expected some seconds: make it shorter, or its loops simpler",
    False: "expected a force at once: mend what ends its loops",
}
"""What to do about a law on which the compiler is busy, and about one that does not return."""


def _document(finding: Finding) -> dict[str, Any]:
    return {
        "name": finding.check.name, "meaning": finding.check.meaning, "verdict": finding.verdict.name.lower(),
        "reason": finding.reason, "example": finding.example, "ends": finding.ends,
    }  # fmt: skip


def _place(component: type[Component]) -> str:
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
