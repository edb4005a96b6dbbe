"""The process that checks components: one line of JSON for each finding, and a last one where a law never returns.

It is a process of its own because a compiled law that never returns, or that writes where it must not, ends with it.
"""

import faulthandler
import inspect
import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from traceback import walk_tb
from types import FrameType
from typing import Any, NamedTuple, TextIO

from fraexp.components.kinds import Component, FrictionModel
from fraexp.components.local_file import load_file
from fraexp.components.registry import Registry, components_in, discover, reason_of
from fraexp.errors import FraexpError, PluginError
from fraexp.kernels.call_watch import hang_listener, running_call_text
from fraexp.testing.check_catalogue import checks_for, quick_checks_for
from fraexp.testing.check_report import CheckOutcome, Verdict, findings
from fraexp.testing.conformance_check import Check
from fraexp.testing.walk import Drive, describe_component

POLL_INTERVAL_S = 0.5
"""Time between two looks at the main thread."""
STILL_LIMIT_S = 10.0
"""Processor time that the main thread may spend at one place in C or compiled code."""
COMPILE_LIMIT_S = 22.0
"""Processor time that the compiler may take for one call."""
WAIT_LIMIT_S = 20.0
"""Time that the main thread may wait at one place, as in a sleep."""
MAX_WAITING_LOAD = 0.02
"""Share of a processor below which it counts as waiting: on a busy machine work is slow, but gets more than that."""
FROZEN_LIMIT_S = 20.0
"""Time without any look, where C code lets no other thread run: the interpreter itself then ends the process."""
COMPILER = f"{os.sep}numba{os.sep}"
WAITING_FILES = ("subprocess.py", "selectors.py", "threading.py")
"""Files whose functions wait for another process, or for a thread."""


class _Clocks(NamedTuple):
    """Readings of both clocks [s]."""

    processor: float
    wall: float


class _Sentinel:
    """Watches the main thread, which creates it, until the process ends."""

    def __init__(self, report: Callable[[FrameType, bool, float], None], dump: TextIO) -> None:
        self._report, self._dump = report, dump
        self._main, self._parent = threading.get_ident(), os.getppid()
        self._seen: tuple[FrameType, int] | None = None
        self._since = _Clocks(0.0, 0.0)

    def start(self) -> None:
        """Watch from now on, also if no other thread gets to run before the first look."""
        self._arm_interpreter_watchdog()
        threading.Thread(target=self._watch, daemon=True).start()

    def _watch(self) -> None:
        over = threading.Event()
        while not over.wait(POLL_INTERVAL_S):
            self._arm_interpreter_watchdog()
            if os.getppid() != self._parent:  # the command has ended, and nobody reads the report
                os._exit(1)
            self._look(sys._current_frames()[self._main])

    def _arm_interpreter_watchdog(self) -> None:
        faulthandler.dump_traceback_later(FROZEN_LIMIT_S, exit=True, file=self._dump)

    def _look(self, frame: FrameType) -> None:
        compiler = outermost_frame(frame, COMPILER)
        # Compiling takes its time at many places: what counts is that the same call into the compiler goes on.
        at = (compiler, 0) if compiler else (frame, frame.f_lasti)
        now = _Clocks(time.process_time(), time.monotonic())
        if frame.f_code.co_filename.endswith(WAITING_FILES) or at != self._seen:
            self._seen, self._since = at, now
            return
        spent, passed = now.processor - self._since.processor, now.wall - self._since.wall
        is_waiting = passed > WAIT_LIMIT_S and spent < MAX_WAITING_LOAD * passed
        if is_waiting or spent > (COMPILE_LIMIT_S if compiler else STILL_LIMIT_S):
            self._report(frame, compiler is not None, passed)
            os._exit(1)


def outermost_frame(frame: FrameType | None, part: str) -> FrameType | None:
    """Return the outermost of a frame and its callers in a file whose path has this part, or None."""
    found = None
    while frame is not None:
        found = frame if part in frame.f_code.co_filename else found
        frame = frame.f_back
    return found


def innermost_line(frame: FrameType | None, file: str) -> int | None:
    """Return the innermost line of a file that is being run, or None."""
    while frame is not None:
        if frame.f_code.co_filename == file:
            return frame.f_lineno
        frame = frame.f_back
    return None


def named_components(name: str, kind: str | None, workspace: Path) -> Iterator[type[Component]]:
    """Yield the component of a name, or all that a plugin's file defines; PluginError if there is none."""
    if name.endswith(".py"):
        return _components_in_file(Path(name), kind)
    return _components_by_name(name, kind, discover(workspace / "plugins"))


def _components_in_file(file: Path, kind: str | None) -> Iterator[type[Component]]:
    if not file.is_file():
        raise PluginError(f"{file}: there is no such file")
    try:
        module = load_file(file)
    except (Exception, SystemExit) as error:  # a stranger's file may raise anything
        raise PluginError(f"{file} cannot be loaded: {reason_of(error, file)}") from error
    chosen = [component for component in components_in(module) if kind in (None, component.kind)]
    if not chosen:
        what = f"{kind} component" if kind else "component"
        raise PluginError(f"{file}: defines no {what}; expected a class such as class Mine(FrictionModel, name=...)")
    yield from chosen


def _components_by_name(name: str, kind: str | None, registry: Registry) -> Iterator[type[Component]]:
    kinds = sorted({of for of, known in registry.providers if known == name and kind in (None, of)})
    if len(kinds) > 1:
        raise PluginError(f"'{name}' is the name of a {' and of a '.join(kinds)}; choose one with --kind")
    if not kinds:
        names = {known for of, known in registry.providers if kind in (None, of)}
        raise PluginError(f"no {kind or 'component'} is called '{name}'{registry.missing_name_remedy(name, names)}")
    yield registry.provider(kinds[0], name).component


class _CheckProcess:
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
        _Sentinel(self._report_stuck, self._lines).start()
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
        for finding in findings(component, on_example=self._note_example, is_quick=self._quick):
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
        finding = CheckOutcome(self._check, Verdict.FAILED, reason, self._example_text(), reason)
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


def _finding_document(finding: CheckOutcome) -> dict[str, str]:
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
    _CheckProcess(order).run()


if __name__ == "__main__":
    main()
