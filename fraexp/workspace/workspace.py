"""The folder that a user sees, as one object: the service that command line, terminal UI and notebooks call."""

import platform
import shlex
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from fraexp.components.kinds import Plant
from fraexp.components.registry import Registry, discover
from fraexp.data.identity import key_of
from fraexp.data.results import Result
from fraexp.errors import FraexpError, StoreError, StudyError
from fraexp.execution import background, provenance, scheduler
from fraexp.execution.estimates.learning import timed_figures
from fraexp.execution.events import Ended, Event, Planned
from fraexp.execution.executors import ResourceLimits, workers_of
from fraexp.records.written import Request, same_study, study_of, toml
from fraexp.reports import html_report
from fraexp.reports.stored_figures import StoredFigures
from fraexp.store import RunSummary, Store, StoredSweep
from fraexp.study.catalogue import StudyEntry, catalogue
from fraexp.study.paths import units_of
from fraexp.study.published_values import PublishedComparison
from fraexp.study.study_file import Study, find_studies, load, outline, resolve
from fraexp.workspace import fit_specs


@dataclass(frozen=True)
class Workspace:
    """A folder with ``plugins/``, ``studies/`` and ``results.db``, each of which may be missing."""

    folder: Path
    database: str

    @classmethod
    def open(cls, folder: str | Path, database: str | None = None) -> "Workspace":
        """Open a folder; the database is ``results.db`` in it, unless a path or URL is given."""
        root = Path(folder)
        if not root.is_dir():
            raise StudyError(f"{root}: there is no such folder to work in")
        return cls(root, str(database or root / "results.db"))

    @cached_property
    def registry(self) -> Registry:
        """All components: installed ones and those in the workspace's ``plugins/``."""
        return discover(self.folder / "plugins")

    @property
    def figures(self) -> StoredFigures:
        """What draws stored results."""
        return StoredFigures(self.registry)

    def reload(self) -> None:
        """Look at the plugins again: one may have been added, mended or broken since."""
        self.__dict__.pop("registry", None)

    def units(self, path: str) -> set[str]:
        """Return the units in which a parameter may be declared: for filters."""
        return units_of(path, self.registry)

    def has_database(self) -> bool:
        """Return whether there is a database already; the first run makes it."""
        if "://" not in self.database:
            return Path(self.database).exists()
        try:
            return Store.exists(self.database)
        except StoreError:  # whoever opens it is told
            return True

    def catalogue(self) -> list[StudyEntry]:
        """Return the studies that there are, read but not resolved."""
        return catalogue(self.folder)

    def studies(self, names: Sequence[str], overrides: Sequence[str] = ()) -> list[Study]:
        """Return the studies of these names, files or folders, resolved; overrides apply to all."""
        found = [pair for name in names for pair in find_studies(name, self.folder)]
        return [load(name, file, self.folder, self.registry, overrides) for name, file in found]

    def run(
        self,
        studies: Sequence[str],
        executor: str | None = None,
        overrides: Sequence[str] = (),
        dry_run: bool = False,
        rerun: str | None = None,
        limits: ResourceLimits | None = None,
    ) -> Generator[Event, None, None]:
        """Run studies one after another and yield events; closing the generator interrupts and keeps what is done.

        All studies are resolved before the first one starts, and nothing is written if one of them is wrong.
        """
        workers_of(executor or "processes")
        limits = limits or ResourceLimits()
        limits.check(executor)
        resolved = self.studies(names := list(studies), overrides)
        if dry_run:
            yield from self._plans(resolved, rerun, executor=executor, limits=limits)
            return
        command = shlex.join(["fraexp", "run", *names, *(f"--set={text}" for text in overrides)])
        with Store.open(self.database, create=True) as store:
            for study in resolved:
                yield from self._run_one(study, store, command, executor, rerun, limits)

    def _run_one(
        self,
        study: Study,
        store: Store,
        command: str,
        executor: str | None = None,
        rerun: str | None = None,
        limits: ResourceLimits | None = None,
    ) -> Generator[Event, None, None]:
        events = scheduler.run(
            study,
            store,
            self.registry,
            executor=executor,
            limits=limits,
            rerun=rerun,
            command=command,
            provenance=provenance.gather() | ({"executor": executor} if executor else {}),
            plugins=str(self.folder / "plugins"),
        )
        for event in events:
            yield self._illustrated(event, study, store) if isinstance(event, Ended) else event

    def fit(
        self, sweeps: Sequence[StoredSweep], name: str, settings: Sequence[str] = (), using: str = ""
    ) -> Generator[Event, None, None]:
        """Fit a model to the responses of stored sweeps, as sweeps of their own, and draw them.

        `settings` are texts such as ``modes=2`` for the estimator that fits: the one called `using`, or the one that
        there is.
        """
        fitting = fit_specs.estimator(self.registry, using)
        wrapped = fit_specs.wrapped(sweeps, fitting, settings, self.registry, self._files)
        study = Study(name, Path(name), f"Fit of {name.removesuffix('-fit')}", "", wrapped)
        with Store.open(self.database, create=True) as store:
            yield from self._run_one(study, store, shlex.join(["fraexp", "fit", *(s.key[4:12] for s in sweeps)]))

    def _files(self, sweep: StoredSweep) -> Mapping[str, str]:
        """Return where the files are that a sweep names: its studies know."""
        if "record" not in sweep.experiment:
            return {}
        with Store.open(self.database, read_only=True) as store:
            runs = [run for run in store.runs() if any(of.key == sweep.key for of in store.sweeps(run.number))]
        for run in runs:
            if Path(run.study_file).is_file():
                study = load(run.study, Path(run.study_file), self.folder, self.registry)
                for found in study.sweeps:
                    if found.experiment_key == key_of(sweep.experiment):
                        return found.files
        raise StudyError(f"sweep {sweep.key[4:12]}: the study that knows where its record is has gone or has changed")

    def models(self, result: Result) -> dict[str, dict[str, Any]]:
        """Return state space and transfer function of the plants that were fitted, by kind."""
        return {fit.kind: fit_specs.matrices(fit, self.registry) for fit in result.fits if fit.kind == Plant.kind}

    def import_record(self, request: Request, target: Path | None = None) -> Generator[Event, None, None]:
        """Write a study that analyses measured records, and run it.

        The study is ``studies/<name of the first file>.toml`` unless told otherwise; nothing is written if a record
        does not fit.
        """
        path = target or self.folder / "studies" / f"{request.stem}.toml"
        data = study_of(request, path.parent, self.registry)
        resolve(path.stem, path, data, self.folder, self.registry)
        if path.exists() and not same_study(path, data):
            raise StudyError(f"{path}: there is another study already; choose a file with --study")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(toml(data), encoding="utf-8")
        yield from self.run([str(path.resolve())])

    def plan(
        self, study: str, overrides: Sequence[str] = (), rerun: str | None = None, executor: str | None = None
    ) -> tuple[list[Study], list[Planned]]:
        """Return studies by name, file or folder, resolved, and what running them would do; nothing is written."""
        resolved = self.studies([study], overrides)
        store = Store.open(self.database, read_only=True) if self.has_database() else None
        try:
            return resolved, [scheduler.plan(of, store, self.registry, rerun, executor=executor)[1] for of in resolved]
        finally:
            if store:
                store.close()

    def outline(self, study: str, overrides: Sequence[str] = ()) -> tuple[list[dict[str, Any]], dict[str, list[Any]]]:
        """Return what a study's cases write into their sections, and the axes of its grid; nothing is resolved."""
        ((_, file),) = find_studies(study, self.folder)[:1]
        return outline(file, self.folder, overrides)

    def launch(
        self,
        study: str | Sequence[str],
        overrides: Sequence[str] = (),
        executor: str | None = None,
        rerun: str | None = None,
        limits: ResourceLimits | None = None,
    ) -> background.BackgroundRun:
        """Start a run of one or several studies that outlives this process, as ``fraexp run --detach`` does."""
        options = limits.options() if limits else []
        return background.start(
            [*self._command(study, overrides, executor, rerun), *options, *self.place()], self.folder
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

    def place(self) -> list[str]:
        """Return the options that name this workspace and its database from any folder."""
        database = self.database if "://" in self.database else str(Path(self.database).absolute())
        return [f"--workspace={self.folder.absolute()}", f"--db={database}"]

    def stop(self, run: RunSummary, hard: bool = False) -> None:
        """Ask a run to end and keep what is finished; `hard`, end its processes at once."""
        if run.state != "running":
            raise StudyError(f"run {run.number} is {run.state}; there is nothing to stop")
        if run.process.host != platform.node():
            raise StudyError(f"run {run.number} runs on {run.process.host}; stop it there")
        background.stop(run.process.pid, hard)

    def _plans(self, studies: Sequence[Study], rerun: str | None, **how: Any) -> Generator[Event, None, None]:
        store = Store.open(self.database, read_only=True) if self.has_database() else None
        for study in studies:
            yield from (scheduler.plan(study, store, self.registry, rerun, True, **how)[1], Ended(None, "dry"))
        if store:
            store.close()

    def _illustrated(self, ended: Ended, study: Study, store: Store) -> Ended:
        try:
            return replace(ended, figures=timed_figures(lambda: self._figures(study, store, ended.run)))
        except FraexpError as error:
            return replace(ended, note=str(error))
        except Exception as error:  # whatever drawing runs into, the numbers are there and are worth more
            return replace(ended, note=f"{type(error).__name__}: {error}")

    def _figures(self, study: Study, store: Store, run: int | None) -> dict[Path, bool]:
        path = self.folder / "figures" / f"{study.name}.png"
        if not path.parent.resolve().is_relative_to(self.folder.resolve()):  # a workspace may come from a stranger
            raise FraexpError(f"{path}: it lies outside of the workspace, by a link; draw it with 'fraexp plot'")
        stored = {sweep.key: sweep for sweep in store.sweeps(run)} if run is not None else {}
        sweeps = [replace(stored[sweep.key], labels=dict(sweep.labels)) for sweep in study.sweeps]
        return self.figures.draw(store, sweeps, path, study.title, study.figure)

    def report(self, store: Store, runs: Sequence[int], path: Path, title: str) -> list[PublishedComparison]:
        """Write an HTML report of runs, and return the printed numbers of their studies beside ours.

        Their figures are those of the workspace; a run that is not its study's newest one leaves them as they are.
        """
        newest = {run.study: run.number for run in reversed(store.runs())}
        with TemporaryDirectory() as spare:
            chapters = []
            for number in runs:
                current = number == newest[store.run(number).study]
                folder = self.folder / "figures" if current else Path(spare) / str(number)
                chapters.append(
                    html_report.chapter(store, number, self.folder, self.registry, self._drawer(store, folder))
                )
            html_report.write(path, title, chapters)
        return [one for chapter in chapters for one in chapter.compared]

    def _drawer(self, store: Store, folder: Path) -> Callable[[Study, Sequence[StoredSweep]], Iterable[Path]]:
        """Return what draws the sweeps of a study into a folder."""
        draw = self.figures.draw
        return lambda study, sweeps: draw(store, sweeps, folder / f"{study.name}.png", study.title, study.figure)
