"""The folder that a user sees, as one object: the service that command line, terminal UI and notebooks call."""

import platform
import shlex
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from fraexp import detached, fitted, perform, provenance, report, scheduler
from fraexp.catalogue import Entry, catalogue
from fraexp.components import Plant
from fraexp.errors import FraexpError, PluginError, StoreError, StudyError
from fraexp.events import Ended, Event, Planned
from fraexp.executors import Limits, workers_of
from fraexp.figures.bundles import MANY
from fraexp.figures.kinds import AGAINST_PLANT, OF_METRICS
from fraexp.figures.label_units import label_units
from fraexp.figures.labels import curve_names, drawn_names, group_names
from fraexp.figures.shown import Shown
from fraexp.figures.stamp import digest, is_current
from fraexp.figures.view import ALL, View
from fraexp.identity import key_of
from fraexp.learning import timed_figures
from fraexp.paths import units_of
from fraexp.plugins import Registry, discover
from fraexp.printed import Compared
from fraexp.records.written import Request, same_study, study_of, toml
from fraexp.results import Result
from fraexp.store import RunSummary, Store, StoredSweep
from fraexp.study import Study, find_studies, load, outline, resolve

AMPLITUDE = "excitation.amplitude"
"""Where a study says how strongly is excited."""
REFERENCE_POINTS = 800
"""Frequencies at which P(jω) is drawn: enough for a resonance with 1 % damping."""


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

    def catalogue(self) -> list[Entry]:
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
        limits: Limits | None = None,
    ) -> Generator[Event, None, None]:
        """Run studies one after another and yield events; closing the generator interrupts and keeps what is done.

        All studies are resolved before the first one starts, and nothing is written if one of them is wrong.
        """
        workers_of(executor or "processes")
        limits = limits or Limits()
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
        limits: Limits | None = None,
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
        fitting = fitted.estimator(self.registry, using)
        wrapped = fitted.wrapped(sweeps, fitting, settings, self.registry, self._files)
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
        return {fit.kind: fitted.matrices(fit, self.registry) for fit in result.fits if fit.kind == Plant.kind}

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
        limits: Limits | None = None,
    ) -> detached.Started:
        """Start a run of one or several studies that outlives this process, as ``fraexp run --detach`` does."""
        options = limits.options() if limits else []
        return detached.start([*self._command(study, overrides, executor, rerun), *options, *self.place()], self.folder)

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
        detached.stop(run.process.pid, hard)

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
        return self.draw(store, sweeps, path, study.title, study.figure)

    def draw(
        self,
        store: Store,
        sweeps: Sequence[StoredSweep],
        path: Path,
        title: str,
        kind: str = "",
        tell: Callable[[str], object] = lambda _: None,
        view: View = ALL,
    ) -> dict[Path, bool]:
        """Draw sweeps into a file for each unit of their responses: the first is `path`, then ``<name>-2`` and so on.

        `kind` is that of the figure, by default what fits the results. `tell` is called with what had to be left
        out: the plant's own response if its plugin is no longer there. Returns for each file whether it was drawn
        now or showed them already; nothing if there is nothing to draw.
        """
        results = store.results(sweep.key for sweep in sweeps)
        groups: dict[str | None, list[StoredSweep]] = {}
        for sweep in sweeps:
            result = results.get(sweep.key)
            if result and result.response and not all(0 < f < np.inf for f in result.response.frequency):
                raise StoreError(f"sweep {sweep.key[4:12]}: a stored frequency is not above 0; compute it again")
            if result and (result.response or result.curves or kind in OF_METRICS):
                groups.setdefault(result.response.unit if result.response else None, []).append(sweep)
        drawn: dict[Path, bool] = {}
        unfit: list[FraexpError] = []
        for group in groups.values():
            target = path.with_stem(f"{path.stem}-{len(drawn) + 1}") if drawn else path
            try:
                drawn[target] = self._draw_group(group, results, target, title, kind, tell, view)
            except FraexpError as error:  # a kind need not fit what other sweeps of the study have found
                unfit.append(error)
        if unfit and not (drawn and kind):
            raise unfit[0]
        return drawn

    def _draw_group(
        self,
        sweeps: Sequence[StoredSweep],
        results: Mapping[str, Result],
        path: Path,
        title: str,
        kind: str,
        tell: Callable[[str], object],
        view: View,
    ) -> bool:
        stamp = [f"{sweep.key} {sweep.created} {sorted(sweep.labels.items())}" for sweep in sweeps] + [title]
        stamp += group_names([sweep.labels for sweep in sweeps]) if len(sweeps) > MANY else []
        stamp += [f"as {kind}"] if kind else []
        stamp += view.options()
        if is_current(path, digest(stamp)):
            return False
        try:
            reference = self.reference(sweeps, results)
        except PluginError as error:  # what is stored can be drawn without the plugins that computed it
            tell(f"the plant's own response is left out: {error}")
            reference, stamp = None, [*stamp, "without the plant"]
        from fraexp.figures.drawing import figure_for, save  # matplotlib: only when something is drawn

        shown = self.shown(sweeps, results, kind in AGAINST_PLANT)
        save(figure_for(shown, reference, title, kind, view), path, stamp)
        return True

    def report(self, store: Store, runs: Sequence[int], path: Path, title: str) -> list[Compared]:
        """Write an HTML report of runs, and return the printed numbers of their studies beside ours.

        Their figures are those of the workspace; a run that is not its study's newest one leaves them as they are.
        """
        newest = {run.study: run.number for run in reversed(store.runs())}
        with TemporaryDirectory() as spare:
            chapters = []
            for number in runs:
                current = number == newest[store.run(number).study]
                folder = self.folder / "figures" if current else Path(spare) / str(number)
                chapters.append(report.chapter(store, number, self.folder, self.registry, self._drawer(store, folder)))
            report.write(path, title, chapters)
        return [one for chapter in chapters for one in chapter.compared]

    def _drawer(self, store: Store, folder: Path) -> Callable[[Study, Sequence[StoredSweep]], Iterable[Path]]:
        """Return what draws the sweeps of a study into a folder."""
        return lambda study, sweeps: self.draw(store, sweeps, folder / f"{study.name}.png", study.title, study.figure)

    def shown(self, sweeps: Sequence[StoredSweep], results: Mapping[str, Result], fully: bool = True) -> list[Shown]:
        """Return the results of sweeps with their names; `fully`, with P(jω) and the amplitude where they are known."""
        units = label_units(((s.labels, {**s.experiment, "estimator": s.estimator}) for s in sweeps), self.registry)
        labels, keys = [sweep.labels for sweep in sweeps], [sweep.key[4:12] for sweep in sweeps]
        names, groups = curve_names(labels, keys, units), group_names(labels, units)
        found = [
            (sweep, Shown(name, results[sweep.key], group, key=sweep.key, drawn=drawn))
            for sweep, name, group, drawn in zip(sweeps, names, groups, drawn_names(labels, units), strict=True)
            if sweep.key in results
        ]
        if not fully:
            return [shown for _, shown in found]
        others = [{path: value for path, value in of.labels.items() if path != AMPLITUDE} for of, _ in found]
        series = curve_names(others, [""] * len(found), units)
        return [
            replace(of, truth=self._truth(sweep, of.result), series=name, **self._amplitude(sweep))
            for (sweep, of), name in zip(found, series, strict=True)
        ]

    def _truth(self, sweep: StoredSweep, result: Result) -> np.ndarray | None:
        """Return P(jω) at a result's frequencies if its response is that of a plant that can be made."""
        response = result.response
        if response is None or response.unit != "m/N" or "plant" not in sweep.experiment:
            return None
        try:
            return self.reference_response(sweep.experiment, response.frequency)
        except PluginError:  # no longer there
            return None

    def _amplitude(self, sweep: StoredSweep) -> dict[str, Any]:
        value = sweep.experiment.get("excitation", {}).get("amplitude")
        if isinstance(value, bool) or not isinstance(value, int | float):
            return {}
        unit = label_units([({AMPLITUDE: value}, sweep.experiment)], self.registry).get(AMPLITUDE, "")
        return {"amplitude": float(value), "amplitude_unit": unit}

    def reference(
        self, sweeps: Sequence[StoredSweep], results: Mapping[str, Result]
    ) -> tuple[str, np.ndarray, np.ndarray] | None:
        """Return label, frequency [Hz] and P(jω) [m/N] if all sweeps are simulations of the same plant in this unit."""
        responses = [results[sweep.key].response for sweep in sweeps]
        frequencies = [response.frequency for response in responses if response and response.unit == "m/N"]
        plants = [sweep.experiment.get("plant") for sweep in sweeps]
        if not frequencies or plants[0] is None or any(plant != plants[0] for plant in plants):
            return None
        everything = np.concatenate(frequencies)
        frequency = np.geomspace(everything.min(), everything.max(), REFERENCE_POINTS)
        return "P(s), linear plant", frequency, self.reference_response(sweeps[0].experiment, frequency)

    def reference_response(self, experiment: Mapping[str, Any], frequency: np.ndarray) -> np.ndarray:
        """Return P(jω) [m/N] of a simulated experiment's plant at `frequency` [Hz], shape (n,)."""
        return perform.reference_response(experiment, frequency, self.registry)
