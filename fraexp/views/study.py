"""Studies as a list shows them: what running each of them would do, and how its last run went."""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from fraexp.errors import FraexpError, StoreError
from fraexp.execution.events import Planned
from fraexp.store import RunSummary
from fraexp.study.catalogue import FIRST, StudyEntry
from fraexp.study.sections import SECTIONS
from fraexp.views.fields import toml_value, took
from fraexp.views.pace import expected_time
from fraexp.views.words import moment, plural
from fraexp.workspace.workspace import Workspace

STUDY_COLUMNS = ["study", "title", "state", "sweeps", "last run"]
MANY = 12
"""Values of an axis, and cases, of which the first ones are shown."""


@dataclass(frozen=True)
class Surveyed:
    """What running a study would do."""

    name: str
    total: int = 0
    reused: int = 0
    missing: int = 0
    stale: int = 0
    seconds: float | None = None
    """Expected time, compiling included [s]; None if nothing is missing."""
    compiling: float = 0.0
    """Part of it in which friction laws are compiled [s]."""
    error: str = ""
    """Why the study cannot be run; empty if it can."""

    @property
    def state(self) -> str:
        """``new``, ``partial``, ``complete``, ``stale`` or ``broken``."""
        if self.error:
            return "broken"
        if self.stale:
            return "stale"
        return "complete" if not self.missing else "partial" if self.reused else "new"


def surveyed(workspace: Workspace, entry: StudyEntry) -> Surveyed:
    """Return what running a study would do; a study that cannot be run is an answer too.

    StoreError if the database cannot be read, which is no fault of a study.
    """
    if entry.error:
        return Surveyed(entry.name, error=entry.error)
    try:
        planned = workspace.plan(str(entry.file.absolute()))[1][0]
    except StoreError:
        raise
    except FraexpError as error:
        return Surveyed(entry.name, error=str(error))
    except Exception as error:  # a stranger's plugin may raise anything; the other studies are listed
        return Surveyed(entry.name, error=f"{type(error).__name__}: {' '.join(str(error).split())}")
    return surveyed_plan(entry.name, planned)


def surveyed_plan(name: str, planned: Planned) -> Surveyed:
    """Return what a plan says of a study."""
    numbers = (planned.total, planned.reused, planned.missing, planned.stale, planned.seconds, planned.compiling)
    return Surveyed(name, *numbers)


def survey(
    workspace: Workspace, entries: Iterable[StudyEntry], first: Collection[str] = (FIRST,)
) -> Iterator[Surveyed]:
    """Yield what running each of the studies would do: those that come `first`, then the small ones."""
    for entry in sorted(entries, key=lambda one: (one.name not in first, one.size)):
        yield surveyed(workspace, entry)


def newest(runs: Iterable[RunSummary]) -> dict[str, RunSummary]:
    """Return the newest run of each study."""
    found: dict[str, RunSummary] = {}
    for run in runs:
        if run.study not in found or run.number > found[run.study].number:
            found[run.study] = run
    return found


def study_state(entry: StudyEntry, found: Surveyed | None, last: RunSummary | None) -> str:
    """Return a study's state in a word; empty while it is not known."""
    if entry.error:
        return "broken"
    if last and last.state == "running":
        return "running"
    return found.state if found else ""


def run_words(run: RunSummary | None) -> str:
    """Return number, state and time of a run."""
    return f"run {run.number} {run.state}, {moment(run.started)[:16]}" if run else ""


def study_row(entry: StudyEntry, found: Surveyed | None, last: RunSummary | None) -> list[str]:
    """Return the cells of a study under `STUDY_COLUMNS`."""
    total = found.total if found and not found.error else entry.size
    return [
        entry.name,
        entry.title,
        study_state(entry, found, last),
        "" if entry.error else str(total),
        run_words(last),
    ]


def study_document(entry: StudyEntry, found: Surveyed | None, last: RunSummary | None) -> dict[str, Any]:
    """Return a study as plain data."""
    return {
        "study": entry.name,
        "title": entry.title,
        "question": entry.question,
        "file": str(entry.file),
        "state": study_state(entry, found, last),
        **{key: value for key, value in asdict(found or Surveyed(entry.name)).items() if key != "name"},
        "last_run": last.number if last else None,
    }


def would_do(found: Surveyed) -> str:
    """Return in one line what running a study would do."""
    time = expected_time(found.seconds, found.compiling)
    stale = f" ({found.stale} stale)" if found.stale else ""
    return f"{plural(found.total, 'sweep')}: {found.reused} reused{stale}, {found.missing} to compute{time}"


def study_fields(entry: StudyEntry, found: Surveyed | None, last: RunSummary | None) -> list[tuple[str, str]]:
    """Return what a study is about, as names and values; what its file does not say is left out."""
    data = entry.data
    error = entry.error or (found.error if found else "")
    return [
        ("error", error),
        ("asks", entry.question),
        ("machine", str(data.get("machine", ""))),
        *[(f"grid {path}", axis_text(values)) for path, values in _table(data.get("grid")).items()],
        *([("cases", _cases(data["case"]))] if isinstance(data.get("case"), list) else []),
        *([("random", f"{data['random'].get('count')} draws")] if isinstance(data.get("random"), Mapping) else []),
        *[(key, section_text(data[key])) for key in SECTIONS if key in data],
        ("running it", would_do(found) if found and not error else ""),
        ("last run", _last(last)),
        ("file", str(entry.file)),
    ]


def axis_text(values: Any) -> str:
    """Return the values of a grid's axis in short."""
    if not isinstance(values, list):
        return str(values)
    more = f", … ({len(values)} values)" if len(values) > MANY else ""
    return ", ".join(section_text(value) for value in values[:MANY]) + more


def section_text(value: Any) -> str:
    """Return a section in short: the component's name, then what is set of it."""
    if not isinstance(value, Mapping):
        return toml_value(value) if not isinstance(value, str) else value
    rest = ", ".join(f"{key} = {toml_value(item)}" for key, item in value.items() if key != "name")
    name = str(value.get("name", ""))
    return f"{name} ({rest})" if name and rest else name or rest


def _table(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _cases(cases: Sequence[Any]) -> str:
    labels = [str(_table(case).get("label", "?")) for case in cases]
    more = f"; … ({len(labels)} cases)" if len(labels) > MANY else ""
    return "; ".join(labels[:MANY]) + more


def _last(run: RunSummary | None) -> str:
    if run is None:
        return ""
    failed = f", {run.failed} failed" if run.failed else ""
    time = f", took {took(run)}" if run.ended else ""
    return f"{run_words(run)}: {run.computed} computed, {run.reused} reused{failed}{time}"
