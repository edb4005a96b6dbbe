"""A report of runs as one page that needs no other: verdicts, figures, tables, methods."""

import os
import shlex
from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from fraexp.data.atomic_file import atomic_file
from fraexp.data.sweep import Plain
from fraexp.data.texts import printable
from fraexp.errors import FraexpError, StudyError
from fraexp.reports.published_comparisons import compare_published, figure_name, read_study, run_title, verdict
from fraexp.store import RunSummary, Store, StoredSweep, mark_damaged
from fraexp.study.published_values import ORIGINS, PublishedComparison
from fraexp.study.study_file import ResolvedStudy, find_studies
from fraexp.views.report_tables import (
    Cell,
    Method,
    OriginTable,
    ReportTable,
    describe_methods,
    input_table,
    published_table,
    report_table,
    verdict_text,
)
from fraexp.views.text_tables import sweep_table
from fraexp.workspace.workspace_service import WorkspaceService

MAX_SWEEPS = 50
"""Sweeps of a run that are shown one by one."""
SUFFIXES = (".html", ".htm")
TEMPLATE = "report.html.jinja"
ORIGIN_MEANINGS = {
    "predicted": "Not used by the simulation: agreement shows that it is right about them.",
    "calibrated": "A parameter was chosen to match them: agreement shows that the choice was made.",
    "input": "Given to the simulation: agreement shows that the method finds them again.",
    "unstated": "Their studies do not say what the simulation knew of them.",
}
"""What an agreement shows, by origin of the published number."""
GENERATOR = "fraexp report"
"""Generator in the head of a report, by which an earlier report is recognised."""
HEAD_BYTES = 1000
"""Size of the beginning of a file in which the generator is searched."""


@dataclass(frozen=True)
class RunChapter:
    """The contents of a report's chapter about one run."""

    run: RunSummary
    study: ResolvedStudy
    """Its title, question and published numbers, without sweeps."""
    sweeps: Sequence[StoredSweep]
    compared: Sequence[PublishedComparison]
    figures: Sequence[Path]
    command: str
    """The command that executes the run again."""
    notes: Sequence[str]
    """What is missing, and why."""
    table: ReportTable | None
    """Its first sweeps."""
    inputs: ReportTable | None
    """What all its sweeps share of their experiment."""
    methods: Sequence[Method]
    """The estimators that it used."""

    @property
    def title(self) -> str:
        """What is shown."""
        return run_title(self.run.study, self.study.title, self.run.command)

    @property
    def verdict(self) -> str:
        """What the run has shown, in words."""
        return verdict_text(self.run, self.sweeps, self.compared)

    @property
    def published(self) -> ReportTable | None:
        """Its published numbers."""
        return published_table(self.compared)

    @property
    def pictures(self) -> list[str]:
        """PNG files of the figures in base64."""
        return [b64encode(path.read_bytes()).decode("ascii") for path in self.figures]

    @property
    def omitted(self) -> int:
        """Number of sweeps that are not shown."""
        return max(len(self.sweeps) - MAX_SWEEPS, 0)

    @property
    def times(self) -> dict[str, str]:
        """Start, duration [s], empty while it is unknown, and computing time of all sweeps [s]."""
        run = self.run
        took = f"{(run.ended - run.started).total_seconds():.2g}" if run.ended else ""
        computing = f"{sum(sweep.elapsed for sweep in self.sweeps):.2g}"
        return {"started": f"{run.started:%Y-%m-%d %H:%M}", "took": took, "computing": computing}


def report_runs(
    workspace: WorkspaceService, store: Store, runs: Sequence[int], path: Path, title: str
) -> list[PublishedComparison]:
    """Write an HTML report of runs, and return the published values of their studies compared with ours.

    The newest run of a study updates its figure in the workspace; older runs are drawn elsewhere.
    """
    newest = {run.study: run.number for run in reversed(store.runs())}.values()
    with TemporaryDirectory() as spare:
        chapters = [
            gather_chapter(
                workspace, store, number, workspace.folder / "figures" if number in newest else Path(spare, str(number))
            )
            for number in runs
        ]
        write_report(path, title, chapters)
    return [one for chapter in chapters for one in chapter.compared]


def gather_chapter(workspace: WorkspaceService, store: Store, number: int, figure_folder: Path) -> RunChapter:
    """Return the chapter about a stored run, whose figure is drawn into a folder."""
    folder, registry = workspace.folder, workspace.registry
    run, sweeps = store.run(number), store.sweeps(number)
    results = store.results(sweep.key for sweep in sweeps)
    sweeps = mark_damaged(sweeps, results)
    study, notes = read_study(run, folder)
    compared = compare_published(study.published, sweeps, results)
    try:
        file, heading = (
            figure_folder / figure_name(study.name, run.command),
            run_title(run.study, study.title, run.command),
        )
        figures = list(workspace.figures.draw(store, sweeps, file, heading, study.figure))
    except FraexpError as error:
        figures, notes = [], [*notes, f"no figure: {error}"]
    stated = {one.metric: one.unit for one in study.published}
    table = report_table(sweep_table(sweeps[:MAX_SWEEPS], results, registry, stated, None)) if sweeps else None
    inputs, methods = input_table(sweeps, registry), describe_methods(sweeps, registry)
    return RunChapter(run, study, sweeps, compared, figures, _command(run, folder), notes, table, inputs, methods)


def _command(run: RunSummary, folder: Path) -> str:
    """Return the command that executes this run again, without the other studies that were run with it."""
    words = shlex.split(run.command)
    if words[:2] != ["fraexp", "run"]:
        return run.command
    try:
        file = find_studies(run.study, folder)[0][1]
        name = run.study if os.path.realpath(file) == os.path.realpath(run.study_file) else run.study_file
    except StudyError:
        name = run.study_file
    return shlex.join([*words[:2], name, *(word for word in words if word.startswith("--set="))])


def check_target(path: Path, force: bool = False) -> None:
    """Raise FraexpError if a report cannot be written there, or would replace a file that is not a report."""
    if path.suffix.lower() not in SUFFIXES:
        raise FraexpError(
            f"{path}: a report cannot be written as '{path.suffix}'; write an .html file, and print it from a browser"
        )
    try:
        if force or not path.exists():
            return
        with path.open("rb") as file:
            is_report = f'name="generator" content="{GENERATOR}"'.encode() in file.read(HEAD_BYTES)
    except OSError as error:
        raise FraexpError(f"{path}: the report cannot be written: {error.strerror or error}") from None
    if not is_report:
        raise FraexpError(f"{path}: the file exists and is not a report; give --force to replace it")


def write_report(path: Path, title: str, chapters: Sequence[RunChapter]) -> None:
    """Write a report; the file appears complete or not at all."""
    text = render_report(title, chapters)
    with atomic_file(path) as draft:
        draft.write_text(text, encoding="utf-8")


def render_report(title: str, chapters: Sequence[RunChapter]) -> str:
    """Return the report as HTML, titled like its only chapter unless there is a title.

    The same runs give the same text.
    """
    import jinja2  # only a report needs it

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        finalize=lambda value: value if hasattr(value, "__html__") else _one_line(value),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    runs = [chapter.run for chapter in chapters]
    compared = [one for chapter in chapters for one in chapter.compared]
    links = [Cell(of.run.study, f"#run-{at}") for at, of in enumerate(chapters, start=1) for _ in of.compared]
    return environment.get_template(TEMPLATE).render(
        generator=GENERATOR,
        title=title or ", ".join(chapter.title for chapter in chapters),
        date=_date(runs),
        about=_about(runs),
        summary=_tables_by_origin(compared, links),
        methods=list(dict.fromkeys(method for chapter in chapters for method in chapter.methods)),
        verdict=verdict(compared),
        chapters=chapters,
        packages=_packages(runs),
    )


def _tables_by_origin(compared: Sequence[PublishedComparison], links: Sequence[Cell]) -> list[OriginTable]:
    """Return the table of the published numbers of each origin, the most telling first."""
    pairs = list(zip(compared, links, strict=True))
    found = []
    for origin in ORIGINS:
        chosen = [(one, link) for one, link in pairs if one.published.origin == origin]
        table = published_table([one for one, _ in chosen], [link for _, link in chosen], ("origin",))
        if table:
            found.append(OriginTable(origin, ORIGIN_MEANINGS.get(origin, ""), table))
    return found


def _one_line(value: object) -> str:
    """Return a value as text in one line without control characters: names come from other people's files."""
    return printable(" ".join(str(value).split()))


def _about(runs: Sequence[RunSummary]) -> str:
    """Return with which code the runs were executed."""
    codes = dict.fromkeys(_code(run.provenance) for run in runs)
    return f"Made with {'; '.join(codes)}."


def _date(runs: Sequence[RunSummary]) -> str:
    """Return when the last run ended."""
    last = max(((run.ended or run.started) for run in runs), default=None)
    return f"Results of {last:%Y-%m-%d %H:%M} UTC, computed by fraexp." if last else ""


def _code(provenance: Plain) -> str:
    git, python, machine = (provenance.get(key) or {} for key in ("git", "python", "machine"))
    changed = ", with local changes" if git.get("dirty") else ""
    parts = [
        f"fraexp {provenance.get('fraexp') or '(version unknown)'}",
        f"commit {git['commit'][:12]}{changed}" if git.get("commit") else "",
        f"Python {python['version']}" if python.get("version") else "",
        machine.get("platform") or "",
        f"{machine['cpu']}, {machine.get('usable_cores')} cores" if machine.get("cpu") else "",
    ]
    return ", ".join(part for part in parts if part)


def _packages(runs: Sequence[RunSummary]) -> str:
    pairs = {(name, version) for run in runs for name, version in (run.provenance.get("packages") or {}).items()}
    return ", ".join(f"{name} {version}" for name, version in sorted(pairs, key=str))
