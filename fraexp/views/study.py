"""Studies in a list: what running each of them would compute, and its last run."""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass

from fraexp.data import toml
from fraexp.errors import FraexpError, StoreError
from fraexp.execution.events import UNKNOWN_TIME, Planned, TimeLeft
from fraexp.store import RunSummary
from fraexp.study.catalogue import FIRST_STUDY, StudyEntry
from fraexp.study.sections import SECTIONS, is_for_autonomous
from fraexp.views.fields import run_duration_text, run_state_text
from fraexp.views.run_progress import counts_text, time_text
from fraexp.views.words import plural, timestamp_text
from fraexp.workspace.workspace_service import WorkspaceService

STUDY_COLUMNS = ["study", "title", "state", "sweeps", "last run"]
MAX_SHOWN_VALUES = 12
"""Maximum number of values of an axis, and of cases, that are shown."""


@dataclass(frozen=True)
class StudySurvey:
    """What running a study would compute."""

    name: str
    total: int = 0
    reused: int = 0
    missing: int = 0
    stale: int = 0
    time: TimeLeft = UNKNOWN_TIME
    """Expected time of the missing sweeps."""
    error: str = ""
    """Why the study cannot be run; empty if it can."""
    command: str = ""
    """The command that executes a study which is measured instead of run; empty for one that is run."""

    @property
    def state(self) -> str:
        """``new``, ``partial``, ``complete``, ``stale``, ``broken``, or ``measure`` where it is measured only."""
        if self.error:
            return "broken"
        if self.command:
            return "measure"
        if self.stale:
            return "stale"
        return "complete" if not self.missing else "partial" if self.reused else "new"


def survey_study(workspace: WorkspaceService, entry: StudyEntry) -> StudySurvey:
    """Return what running a study would compute, or why it cannot be run.

    StoreError if the database cannot be read, which is not a fault of the study.
    """
    if entry.error:
        return StudySurvey(entry.name, error=entry.error)
    if is_for_autonomous(entry.data):
        return StudySurvey(entry.name, command=f"fraexp measure --autonomous {entry.name}")
    try:
        planned = workspace.plan(str(entry.file.absolute()))[1][0]
    except StoreError:
        raise
    except FraexpError as error:
        return StudySurvey(entry.name, error=str(error))
    except Exception as error:  # a plugin may raise anything; the other studies are still listed
        return StudySurvey(entry.name, error=f"{type(error).__name__}: {' '.join(str(error).split())}")
    return survey_plan(entry.name, planned)


def survey_plan(name: str, planned: Planned) -> StudySurvey:
    """Return the survey of a study from its plan."""
    return StudySurvey(name, planned.total, planned.reused, planned.missing, planned.stale, planned.time)


def survey_studies(
    workspace: WorkspaceService, entries: Iterable[StudyEntry], first: Collection[str] = (FIRST_STUDY,)
) -> Iterator[StudySurvey]:
    """Yield the survey of each study: those named in `first`, then the others by size."""
    for entry in sorted(entries, key=lambda one: (one.name not in first, one.size)):
        yield survey_study(workspace, entry)


def study_state(entry: StudyEntry, found: StudySurvey | None, last: RunSummary | None) -> str:
    """Return the state of a study in one word; empty while unknown.

    One whose sweeps are all stored is unusable, not complete, if its last run has ended without a usable result.
    """
    if entry.error:
        return "broken"
    if last and last.state == "running":
        return "running"
    if found and found.state == "complete" and last and last.is_unusable:
        return "unusable"
    return found.state if found else ""


def run_text(run: RunSummary | None) -> str:
    """Return number, state and time of a run."""
    return f"run {run.number} {run_state_text(run)}, {timestamp_text(run.started)[:16]}" if run else ""


def study_row(entry: StudyEntry, found: StudySurvey | None, last: RunSummary | None) -> list[str]:
    """Return the cells of a study under `STUDY_COLUMNS`."""
    is_measured = found is not None and bool(found.command)
    total = found.total if found and not found.error else entry.size
    return [
        entry.name,
        entry.title,
        study_state(entry, found, last),
        "" if entry.error or is_measured else str(total),
        run_text(last),
    ]


def study_document(entry: StudyEntry, found: StudySurvey | None, last: RunSummary | None) -> dict[str, object]:
    """Return a study as plain data."""
    return {
        "study": entry.name,
        "title": entry.title,
        "question": entry.question,
        "file": str(entry.file),
        "state": study_state(entry, found, last),
        **{
            key: value for key, value in asdict(found or StudySurvey(entry.name)).items() if key not in ("name", "time")
        },
        **(found.time if found else UNKNOWN_TIME)._asdict(),
        "last_run": last.number if last else None,
    }


def plan_summary(found: StudySurvey) -> str:
    """Return in one line what running a study would compute."""
    time = f", {time_text(found.time)}" if found.missing else ""
    stale = f" ({found.stale} stale)" if found.stale else ""
    return f"{plural(found.total, 'sweep')}: {found.reused} reused{stale}, {found.missing} to compute{time}"


def study_fields(entry: StudyEntry, found: StudySurvey | None, last: RunSummary | None) -> list[tuple[str, str]]:
    """Return names and values that describe a study; empty values are not shown."""
    data = entry.data
    error = entry.error or (found.error if found else "")
    return [
        ("error", error),
        ("question", entry.question),
        ("machine", str(data.get("machine", ""))),
        *[(f"grid {path}", axis_text(values)) for path, values in _table(data.get("grid")).items()],
        *([("cases", _cases_text(data["case"]))] if isinstance(data.get("case"), list) else []),
        *[("monte_carlo", f"{of.get('count')} samples") for of in [data.get("monte_carlo")] if isinstance(of, Mapping)],
        *[(key, section_text(data[key])) for key in SECTIONS if key in data],
        ("plan", (found.command or plan_summary(found)) if found and not error else ""),
        ("last run", _last_run_text(last)),
        ("file", str(entry.file)),
    ]


def axis_text(values: object) -> str:
    """Return the values of a grid axis in short."""
    if not isinstance(values, list):
        return str(values)
    more = f", … ({len(values)} values)" if len(values) > MAX_SHOWN_VALUES else ""
    return ", ".join(section_text(value) for value in values[:MAX_SHOWN_VALUES]) + more


def section_text(value: object) -> str:
    """Return a section in short: the name of the component, then its settings."""
    if not isinstance(value, Mapping):
        return toml.dumps(value) if not isinstance(value, str) else value
    rest = ", ".join(f"{key} = {toml.dumps(item)}" for key, item in value.items() if key != "name")
    name = str(value.get("name", ""))
    return f"{name} ({rest})" if name and rest else name or rest


def _table(value: object) -> Mapping[str, object]:
    return value if isinstance(value, Mapping) else {}


def _cases_text(cases: Sequence[object]) -> str:
    labels = [str(_table(case).get("label", "?")) for case in cases]
    more = f"; … ({len(labels)} cases)" if len(labels) > MAX_SHOWN_VALUES else ""
    return "; ".join(labels[:MAX_SHOWN_VALUES]) + more


def _last_run_text(run: RunSummary | None) -> str:
    if run is None:
        return ""
    time = f", took {run_duration_text(run)}" if run.ended else ""
    return f"{run_text(run)}: {counts_text(run)}{time}"
