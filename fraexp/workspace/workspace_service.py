"""A workspace as one object: the service that command line, terminal UI and notebooks call."""

import platform
import shlex
from collections.abc import Generator, Mapping, Sequence
from contextlib import closing, nullcontext
from dataclasses import dataclass, replace
from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING

from fraexp.components.kinds import Plant
from fraexp.data.results import Result
from fraexp.data.sweep import experiment_key
from fraexp.errors import FraexpError, StudyError
from fraexp.execution import background, provenance, scheduler
from fraexp.execution.database_retry import DatabaseRetry
from fraexp.execution.events import Ended, Event, Noticed, Planned
from fraexp.execution.executors import ResourceLimits
from fraexp.execution.scheduler import RunOptions
from fraexp.reports.published_comparisons import figure_name, run_title
from fraexp.reports.stored_figures import StoredFigures
from fraexp.store import RunSummary, Store, StoredSweep
from fraexp.study.catalogue import StudyEntry, catalogue
from fraexp.study.study_file import ResolvedStudy, find_studies, find_study, load, outline, read, resolve
from fraexp.workspace.workspace_folder import WorkspaceFolder

if TYPE_CHECKING:  # a run needs neither records nor fits: they are imported where they are used
    from fraexp.records.first_look import Choice, RecordLook
    from fraexp.records.study_writer import ImportRequest


@dataclass(frozen=True)
class WorkspaceService(WorkspaceFolder):
    """A workspace that resolves, runs, fits and draws studies."""

    @property
    def figures(self) -> StoredFigures:
        """The figures of stored results."""
        return StoredFigures(self.registry)

    def catalogue(self) -> list[StudyEntry]:
        """Return all studies, read but not resolved."""
        return catalogue(self.folder)

    def studies(self, names: Sequence[str], overrides: Sequence[str] = ()) -> list[ResolvedStudy]:
        """Return the studies of these names, files or folders, resolved; overrides apply to all."""
        found = [pair for name in names for pair in find_studies(name, self.folder)]
        return [load(name, file, self.folder, self.registry, overrides) for name, file in found]

    def study(self, name: str, overrides: Sequence[str] = ()) -> ResolvedStudy:
        """Return one study by name or file, resolved; StudyError for a folder of several."""
        return load(*find_study(name, self.folder), self.folder, self.registry, overrides)

    def run(
        self,
        studies: Sequence[str],
        executor: str | None = None,
        overrides: Sequence[str] = (),
        dry_run: bool = False,
        rerun: str | None = None,
        limits: ResourceLimits | None = None,
    ) -> Generator[Event, None, None]:
        """Run studies one after another and yield events; closing the generator interrupts the run.

        Finished sweeps are kept. All studies are resolved before the first one starts, and nothing is written if one of
        them is invalid.
        """
        options = RunOptions(executor, rerun, limits or ResourceLimits())
        options.check()
        resolved = self.studies(studies, overrides)
        if dry_run:
            for planned in self.plan_resolved(resolved, options, explain=True):
                yield from (planned, Ended(None, "dry"))
            return
        yield from self.run_resolved(resolved, self.command(studies, overrides), options)

    def run_resolved(
        self, studies: Sequence[ResolvedStudy], command: str, options: RunOptions
    ) -> Generator[Event, None, None]:
        """Run studies that are resolved already; `command` says in the database how the run was started."""
        options.check()
        with self.open_store("create") as store:
            for study in studies:
                yield from self._run_one(study, store, command, options)

    def _run_one(
        self, study: ResolvedStudy, store: Store, command: str, options: RunOptions
    ) -> Generator[Event, None, None]:
        facts = provenance.gather_provenance() | ({"executor": options.executor} if options.executor else {})
        plugins = str(self.folder / "plugins")
        events = scheduler.run(study, store, self.registry, options, command=command, provenance=facts, plugins=plugins)
        retry = DatabaseRetry(timeout=options.limits.database)
        with closing(events):
            for event in events:
                yield (yield from self._draw_ended(event, study, store, retry)) if isinstance(event, Ended) else event

    def fit(
        self,
        sweeps: Sequence[StoredSweep],
        name: str,
        settings: Sequence[str] = (),
        using: str = "",
        kind: str = Plant.kind,
    ) -> Generator[Event, None, None]:
        """Fit a component of a kind to the responses of stored sweeps, as sweeps of their own, and draw them.

        `settings` are texts such as ``modes=2`` for the estimator that fits: the one called `using`, or the one that
        there is.
        """
        from fraexp.workspace import fit_specs

        fitting = fit_specs.fit_estimator(self.registry, using, kind)
        wrapped = fit_specs.as_fit_sweeps(sweeps, fitting, settings, self.registry, self.record_files)
        word = "fit" if kind == Plant.kind else "tune"
        study = ResolvedStudy(name, Path(name), f"{word.capitalize()} of {name.removesuffix(f'-{word}')}", "", wrapped)
        with self.open_store("create") as store:
            command = shlex.join(["fraexp", word, *(s.key[4:12] for s in sweeps)])
            yield from self._run_one(study, store, command, RunOptions())

    def record_files(self, sweep: StoredSweep) -> Mapping[str, str]:
        """Return the files of a sweep's record, which the study of one of its runs names."""
        if "record" not in sweep.experiment:
            return {}
        with self.open_store() as store:
            runs = [run for run in store.runs() if any(of.key == sweep.key for of in store.sweeps(run.number))]
        for run in runs:
            if Path(run.study_file).is_file():
                study = load(run.study, Path(run.study_file), self.folder, self.registry)
                for found in study.sweeps:
                    if found.experiment_key == experiment_key(sweep.experiment):
                        return found.files
        raise StudyError(
            f"sweep {sweep.key[4:12]}: the study that names its record was deleted or changed; run that study again"
        )

    def models(self, result: Result) -> dict[str, dict[str, object]]:
        """Return state space and transfer function of fitted plants, by kind."""
        from fraexp.workspace import fit_specs

        return {fit.kind: fit_specs.matrices(fit, self.registry) for fit in result.fits if fit.kind == Plant.kind}

    def import_record(self, request: "ImportRequest", target: Path | None = None) -> Generator[Event, None, None]:
        """Write a study that analyses measured records, and run it.

        The study is ``studies/<name of the first file>.toml`` unless `target` is given; nothing is written if a record
        is invalid. Files without an estimator that are records at several amplitudes are identified together.
        """
        from fraexp.records.first_look import choose, find_levels
        from fraexp.records.study_writer import study_data

        path = self._study_path(request, target)
        is_chosen = request.estimators or request.each_file or request.options.get("join_files")
        look = find_levels(request, self.registry) if len(request.files) > 1 and not is_chosen else None
        if look is None:
            yield from self._run_written(path, study_data(request, path.parent, self.registry))
        else:
            yield from self.identify(request, look, choose(look), target)

    def identify(
        self, request: "ImportRequest", look: "RecordLook", choice: "Choice", target: Path | None = None
    ) -> Generator[Event, None, None]:
        """Write the study that applies an estimator to all records of one machine, and run it, as `import_record`."""
        from fraexp.records.first_look import identification_study

        path = self._study_path(request, target)
        data = identification_study(request, look, choice, path.parent, self.registry)
        yield from self._run_written(path if target else _free_path(path, data), data)

    def _study_path(self, request: "ImportRequest", target: Path | None) -> Path:
        return target or self.folder / "studies" / f"{request.stem}.toml"

    def _run_written(self, path: Path, data: Mapping[str, object]) -> Generator[Event, None, None]:
        from fraexp.records.study_writer import is_same_study, write_study

        resolve(path.stem, path, data, self.folder, self.registry)
        if path.suffix != ".toml":
            raise StudyError(f"{path}: a study is a file that ends in .toml; choose another one, such as --study")
        if path.exists() and not is_same_study(path, data):
            free = _free_path(path, data)
            raise StudyError(f"{path}: a different study is in this file; choose another one, such as --study {free}")
        write_study(path, data)
        if not path.resolve().is_relative_to(self.folder.resolve()):
            yield Noticed(f"the study is written outside the workspace, and is run by its path: {path.resolve()}")
        yield from self.run([str(path.resolve())])

    def study_of_record(self, name: Path, file: Path) -> Path | None:
        """Return the study of a name that analyses a record, such as one that `fraexp excite` has written; or None."""
        path = name if name.suffix == ".toml" else self.folder / "studies" / f"{name.stem}.toml"
        if not path.is_file():
            return None
        stated = read(path).get("record", {})
        named = stated.get("file") if isinstance(stated, dict) else None
        is_its_own = isinstance(named, str) and (path.parent / named).resolve() == file.resolve()
        return path if is_its_own else None

    def plan(
        self, study: str, overrides: Sequence[str] = (), rerun: str | None = None, executor: str | None = None
    ) -> tuple[list[ResolvedStudy], list[Planned]]:
        """Return studies by name, file or folder, resolved, and the plans of running them; nothing is written."""
        resolved = self.studies([study], overrides)
        return resolved, self.plan_resolved(resolved, RunOptions(executor, rerun))

    def plan_resolved(
        self, studies: Sequence[ResolvedStudy], options: RunOptions, explain: bool = False
    ) -> list[Planned]:
        """Return the plans of running studies that are resolved already; nothing is written."""
        with self.open_store() if self.has_database() else nullcontext() as store:
            return [scheduler.plan(of, store, self.registry, options, explain)[1] for of in studies]

    def outline(
        self, study: str, overrides: Sequence[str] = ()
    ) -> tuple[list[dict[str, object]], dict[str, list[object]]]:
        """Return the sections of each case of a study as written, and the axes of its grid; nothing is resolved."""
        _, file = find_study(study, self.folder)
        return outline(file, self.folder, overrides)

    def launch(
        self,
        study: str | Sequence[str],
        overrides: Sequence[str] = (),
        executor: str | None = None,
        rerun: str | None = None,
        limits: ResourceLimits | None = None,
        is_awaited: bool = False,
    ) -> background.BackgroundRun:
        """Start a run of one or several studies that outlives this process, as ``fraexp run --detach`` does.

        If `is_awaited`, the caller waits for it to begin.
        """
        options = limits.options() if limits else []
        return background.start(
            [*self._command(study, overrides, executor, rerun), *options, *self.location_options()],
            self.folder,
            self.location_environment(),
            is_awaited=is_awaited,
        )

    def command(
        self,
        study: str | Sequence[str],
        overrides: Sequence[str] = (),
        executor: str | None = None,
        rerun: str | None = None,
    ) -> str:
        """Return the command line that runs studies."""
        return shlex.join(["fraexp", *self._command(study, overrides, executor, rerun)])

    def _command(
        self, study: str | Sequence[str], overrides: Sequence[str], executor: str | None, rerun: str | None
    ) -> list[str]:
        options = [*(f"--set={text}" for text in overrides)]
        options += [f"--executor={executor}"] if executor else []
        options += [f"--rerun={rerun}"] if rerun else []
        return ["run", *([study] if isinstance(study, str) else study), *options]

    def stop(self, run: RunSummary, kill: bool = False) -> None:
        """Stop a run and keep finished sweeps; with `kill`, kill its processes at once."""
        if run.state != "running":
            raise StudyError(f"run {run.number} is {run.end}; it cannot be stopped")
        if run.process.host != platform.node():
            raise StudyError(f"run {run.number} runs on {run.process.host}; stop it there")
        background.stop(run.process.pid, kill)

    def _draw_ended(
        self, ended: Ended, study: ResolvedStudy, store: Store, retry: DatabaseRetry
    ) -> Generator[Event, None, Ended]:
        """Draw the figures of a run that has ended, and return its event with them, or with why there are none."""
        try:
            figures = yield from retry.call(lambda: self._draw_figures(study, store, ended.run))
            return replace(ended, figures=tuple(figures))
        except FraexpError as error:
            return replace(ended, note=str(error))
        except Exception as error:  # a figure is worth less than the run, whose results are stored
            return replace(ended, note=f"{type(error).__name__}: {error}")

    def _draw_figures(self, study: ResolvedStudy, store: Store, run: int | None) -> dict[Path, bool]:
        command = store.run(run).command if run is not None else ""
        path = self.folder / "figures" / figure_name(study.name, command)
        if not path.parent.resolve().is_relative_to(
            self.folder.resolve()
        ):  # a workspace from elsewhere may contain links
            raise FraexpError(f"{path}: a link leads outside of the workspace; draw the figure with 'fraexp plot'")
        stored = {sweep.key: sweep for sweep in store.sweeps(run)} if run is not None else {}
        sweeps = [replace(stored[sweep.key], labels=dict(sweep.labels)) for sweep in study.sweeps]
        title = run_title(study.name, study.title, command) if run is not None else study.title
        return self.figures.draw(store, sweeps, path, title, study.figure)


def _free_path(path: Path, data: Mapping[str, object]) -> Path:
    """Return a path, or if another study is there the first one with a number at which there is none or the same."""
    from fraexp.records.study_writer import is_same_study

    numbered = (path.with_stem(f"{path.stem}-{number}") for number in count(2))
    return next(of for of in chain([path], numbered) if not of.exists() or is_same_study(of, data))
