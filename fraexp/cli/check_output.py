"""The output of ``fraexp check``: a line for each check with its finding; a quick check prints failures only."""

from dataclasses import dataclass, field
from typing import Any

from fraexp.cli.output import print_line, say
from fraexp.views.words import plural

VERDICT_WORDS = {"passed": "pass", "skipped": "skip", "expected": "expected", "not_run": "not run"}
"""First column of the report, by verdict; any other verdict is FAIL."""
VERDICT_WIDTH, NAME_WIDTH = 8, 15
"""Widths of the first two columns of the report."""
INDENT = " " * (VERDICT_WIDTH + NAME_WIDTH + 5)
Finding = dict[str, Any]


@dataclass(frozen=True)
class CheckStarted:
    """A component that is being checked, with the findings so far."""

    component: dict[str, Any]
    place: str
    """File and line of the component."""
    checks: dict[str, str]
    """Names and meanings of the checks."""
    left_out: list[str]
    """Names of the checks that a quick check omits."""
    findings: list[Finding] = field(default_factory=list)

    @property
    def title(self) -> str:
        """Kind and name."""
        return f"{self.component['kind']} {self.component['name']}"

    @property
    def wrong(self) -> list[Finding]:
        """The findings that need a correction."""
        return [found for found in self.findings if is_wrong(found)]


def is_wrong(found: Finding) -> bool:
    """Return whether a finding needs a correction."""
    return found["verdict"] in ("failed", "unexpected")


class CheckOutput:
    """A line for each check, as soon as it is known."""

    def begin(self, started: CheckStarted) -> None:
        """Print how many checks follow."""
        print_line(f"{started.title}: {plural(len(started.checks), 'check')}")

    def finding(self, started: CheckStarted, found: Finding) -> None:
        """Print a finding; a reason that was printed before is replaced by the name of that check."""
        head = VERDICT_WORDS.get(found["verdict"], "FAIL")
        print_line(f"  {head:<{VERDICT_WIDTH}}  {found['name']:<{NAME_WIDTH}} {found['meaning']}", INDENT)
        what = "passes although it is declared to fail; " if found["verdict"] == "unexpected" else ""
        same = [earlier for earlier in started.wrong if earlier["reason"] == found["reason"] and earlier is not found]
        if is_wrong(found) and same:
            print_line(f"{INDENT}{what}for the same reason as {same[0]['name']}", INDENT)
            return
        if found["reason"] and found["verdict"] != "not_run":
            print_line(f"{INDENT}{what}{found['reason']}", INDENT)
        if found["example"] and is_wrong(found):
            print_line(f"{INDENT}with {found['example']}", INDENT)

    def end(self, started: CheckStarted) -> None:
        """Print a summary in one line."""
        print()
        say(self._summary(started))

    def _summary(self, started: CheckStarted) -> str:
        last = next((found for found in started.wrong if found["ends"]), None)
        if last:
            return f"{started.title}: {last['reason']}"
        if started.wrong:
            first, names = started.wrong[0], ", ".join(found["name"] for found in started.wrong)
            found = f"{plural(len(started.wrong), 'check')} failed: {names}"
            return f"{started.title} ({started.place}): {found}; {first['name']}: {first['reason']}"
        return self._sound_text(started)

    def _sound_text(self, started: CheckStarted) -> str:
        return f"{started.title} is sound"


class QuickOutput(CheckOutput):
    """Failures as soon as they are known, then the names of the other checks and of the omitted ones."""

    def begin(self, started: CheckStarted) -> None:
        """Print how many checks follow."""
        of = f" of {len(started.checks) + len(started.left_out)}" if started.left_out else ""
        print_line(f"{started.title}: {len(started.checks)}{of} checks (quick)")

    def finding(self, started: CheckStarted, found: Finding) -> None:
        """Print a failure."""
        if is_wrong(found):
            super().finding(started, found)

    def end(self, started: CheckStarted) -> None:
        """Print which checks have passed, and which were not made."""
        for verdict, head in VERDICT_WORDS.items():
            self._names(head, [found["name"] for found in started.findings if found["verdict"] == verdict])
        self._names("omitted", started.left_out)
        super().end(started)

    def _names(self, head: str, names: list[str]) -> None:
        if names:
            print_line(f"  {head:<{VERDICT_WIDTH}}  {', '.join(names)}", INDENT)

    def _sound_text(self, started: CheckStarted) -> str:
        more = f"fraexp check {started.component['name']} tests more examples"
        rest = f" and {', '.join(started.left_out)}" if started.left_out else ""
        return f"{started.title}: no fault found by the quick checks; {more}{rest}"


class SilentOutput(CheckOutput):
    """Prints nothing, where one document follows at the end."""

    def begin(self, started: CheckStarted) -> None:
        """Print nothing."""

    def finding(self, started: CheckStarted, found: Finding) -> None:
        """Print nothing."""

    def end(self, started: CheckStarted) -> None:
        """Print nothing."""
