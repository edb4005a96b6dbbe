"""What ``fraexp check`` prints: a line for each check, with what it has found; of a quick one, the failures first."""

from dataclasses import dataclass, field
from typing import Any

from fraexp.cli.output import say
from fraexp.figures.elements.labels import printable
from fraexp.views.words import plural

HEADS = {"passed": "pass", "skipped": "skip", "expected": "expected", "not_run": "not run"}
"""Words of a report's first column; all else is FAIL."""
WORD, NAME = 8, 15
"""Widths of a report's first two columns."""
INDENT = " " * (WORD + NAME + 5)
Found = dict[str, Any]


@dataclass(frozen=True)
class CheckStarted:
    """A component that is being checked, with what has been found so far."""

    component: dict[str, Any]
    checks: dict[str, str]
    """Names and meanings of the checks."""
    left_out: list[str]
    """Names of checks that a quick one leaves out."""
    findings: list[Found] = field(default_factory=list)

    @property
    def title(self) -> str:
        """Kind and name."""
        return f"{self.component['kind']} {self.component['name']}"

    @property
    def wrong(self) -> list[Found]:
        """What must be mended."""
        return [found for found in self.findings if is_wrong(found)]


def is_wrong(found: Found) -> bool:
    """Return whether something must be mended."""
    return found["verdict"] in ("failed", "unexpected")


class Output:
    """A line for each check, as soon as it is known."""

    def begin(self, started: CheckStarted) -> None:
        """Print how many checks follow."""
        print(printable(f"{started.title}: {plural(len(started.checks), 'check')}"), flush=True)

    def finding(self, started: CheckStarted, found: Found) -> None:
        """Print what was found; a reason that an earlier one has told already is told by its name."""
        head = HEADS.get(found["verdict"], "FAIL")
        print(printable(f"  {head:<{WORD}}  {found['name']:<{NAME}} {found['meaning']}"), flush=True)
        what = "passes, though declared to fail; " if found["verdict"] == "unexpected" else ""
        same = [earlier for earlier in started.wrong if earlier["reason"] == found["reason"] and earlier is not found]
        if is_wrong(found) and same:
            print(printable(f"{INDENT}{what}for the same reason as {same[0]['name']}"), flush=True)
            return
        if found["reason"] and found["verdict"] != "not_run":
            print(printable(f"{INDENT}{what}{found['reason']}"), flush=True)
        if found["example"] and is_wrong(found):
            print(printable(f"{INDENT}with {found['example']}"), flush=True)

    def end(self, started: CheckStarted) -> None:
        """Tell in one line what must be mended."""
        print()
        say(self._summary(started))

    def _summary(self, started: CheckStarted) -> str:
        last = next((found for found in started.wrong if found["ends"]), None)
        if last:
            return f"{started.title}: {last['reason']}"
        wrong = [found["name"] for found in started.wrong]
        if wrong:
            return f"{started.title}: {plural(len(wrong), 'check')} failed: {', '.join(wrong)}"
        return self._sound(started)

    def _sound(self, started: CheckStarted) -> str:
        return f"{started.title} is sound"


class QuickOutput(Output):
    """Failures as soon as they are known, then the names of the other checks, and of those that were left out."""

    def begin(self, started: CheckStarted) -> None:
        """Print how many checks follow."""
        of = f" of {len(started.checks) + len(started.left_out)}" if started.left_out else ""
        print(printable(f"{started.title}: {len(started.checks)}{of} checks, quickly"), flush=True)

    def finding(self, started: CheckStarted, found: Found) -> None:
        """Print a failure."""
        if is_wrong(found):
            super().finding(started, found)

    def end(self, started: CheckStarted) -> None:
        """Print which checks have passed, and which have not been made."""
        for verdict, head in HEADS.items():
            self._names(head, [found["name"] for found in started.findings if found["verdict"] == verdict])
        self._names("left out", started.left_out)
        super().end(started)

    def _names(self, head: str, names: list[str]) -> None:
        if names:
            print(printable(f"  {head:<{WORD}}  {', '.join(names)}"), flush=True)

    def _sound(self, started: CheckStarted) -> str:
        more = f"fraexp check {started.component['name']} looks at more examples"
        rest = f", and at {', '.join(started.left_out)}" if started.left_out else ""
        return f"{started.title}: nothing found in a quick look; {more}{rest}"


class Silence(Output):
    """Prints nothing, where one document follows at the end."""

    def begin(self, started: CheckStarted) -> None:
        """Print nothing."""

    def finding(self, started: CheckStarted, found: Found) -> None:
        """Print nothing."""

    def end(self, started: CheckStarted) -> None:
        """Print nothing."""
