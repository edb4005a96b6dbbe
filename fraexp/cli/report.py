"""``fraexp report``: stored runs as one HTML file; also written after running a folder of studies."""

import os
from argparse import Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path

from fraexp.cli.exits import ExitCode
from fraexp.cli.output import print_path, say
from fraexp.cli.sweep_lookup import find_run_number
from fraexp.errors import FraexpError
from fraexp.reports.published_comparisons import verdict
from fraexp.store import Store
from fraexp.study.published_values import PublishedComparison
from fraexp.study.study_file import find_studies, packaged_studies
from fraexp.workspace.workspace_service import WorkspaceService


def execute(arguments: Namespace) -> ExitCode:
    """Write the report of runs, and print its path."""
    from fraexp.views.html_report import check_target

    check_target(arguments.output, arguments.force)
    workspace = WorkspaceService.open(arguments.workspace, arguments.db)
    with workspace.open_store() as store:
        runs = list(dict.fromkeys(number for text in arguments.ids for number in _run_numbers(store, text)))
        title = arguments.title or (f"Report: {', '.join(arguments.ids)}" if len(runs) > 1 else "")
        compared = _write(workspace, store, runs, arguments.output, title)
    return ExitCode.INCOMPLETE if any(one.remark for one in compared) else ExitCode.OK


def _run_numbers(store: Store, identifier: str) -> list[int]:
    """Return the run of a number or study name; for a folder name, the newest run of each study in it.

    Runs of fits are named after the folder too, but have no study file.
    """
    number = find_run_number(store, identifier)
    if number is not None:
        return [store.run(number).number]
    inside = f"{identifier.rstrip('/')}/"
    studies = [run for run in reversed(store.runs()) if run.study_file.endswith(".toml")]
    newest = {run.study: run.number for run in studies if run.study.startswith(inside)}
    if not newest:
        raise FraexpError(f"report: no run of '{identifier}'; expected a run or a study as fraexp list shows them")
    return [newest[study] for study in sorted(newest)]


def report_folders(arguments: Namespace, runs: Sequence[int], workspace: WorkspaceService) -> None:
    """Write ``figures/FOLDER.html`` for each folder of studies that was run."""
    with workspace.open_store() as store:
        numbers = {store.run(number).study: number for number in runs}
        for name, studies in _study_folders(arguments.study, workspace.folder):
            found = [numbers[study] for study in studies if study in numbers]
            if found:
                path = workspace.folder / "figures" / f"{name}.html"
                path.parent.mkdir(parents=True, exist_ok=True)
                _write(workspace, store, found, path, f"Report: {name}", as_talk=arguments.json)


def _study_folders(names: Sequence[str], folder: Path) -> Iterator[tuple[str, list[str]]]:
    """Yield name and studies of those that are folders of studies."""
    bases = (folder, folder / "studies", packaged_studies())
    for name in names:
        found = find_studies(name, folder)
        direct = {os.path.realpath(base / text) for base in bases for text in (name, f"{name}.toml")}
        if os.path.realpath(found[0][1]) not in direct:
            inside = Path(found[0][0]).parent.as_posix()
            yield inside if inside != "." else Path(os.path.realpath(found[0][1])).parent.name, [of for of, _ in found]


def _write(
    workspace: WorkspaceService, store: Store, runs: Sequence[int], path: Path, title: str, as_talk: bool = False
) -> list[PublishedComparison]:
    from fraexp.views.html_report import report_runs  # of use to few runs

    compared = report_runs(workspace, store, runs, path, title)
    if as_talk:
        say(f"report {path}")
    else:
        print_path(path, "report ")
    for one in compared:
        if one.remark:
            say(f"published value '{one.published.what}': {one.remark}")
    if compared:
        say(verdict(compared))
    return compared
