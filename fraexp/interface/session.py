"""A workspace in Python: studies are run, results read, and experiments computed without a database."""

from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from inspect import signature
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeVar

from fraexp.cli.output import say
from fraexp.components.kinds import KINDS, Component, FrictionModel
from fraexp.components.parameters import example_call
from fraexp.components.registry import SESSION, LoadFailure, Registry, create
from fraexp.data.identity import FileStamp
from fraexp.errors import FraexpError, ParameterError, StudyError, did_you_mean
from fraexp.execution.executors import ResourceLimits
from fraexp.execution.scheduler import RunOptions
from fraexp.interface import direct_computation
from fraexp.interface.argument_checks import require_mapping, require_path, require_positive, require_text
from fraexp.interface.callable_law import FrictionLaw
from fraexp.interface.direct_computation import Recording
from fraexp.interface.result_sets import Identification, Results, Run
from fraexp.interface.run_monitor import follow_run
from fraexp.interface.study_source import Study, component_spec, override_texts, resolve_study, session_classes
from fraexp.interface.sweep_results import SweepResult
from fraexp.records import RecordSettings
from fraexp.records import resolve as resolve_record
from fraexp.records.first_look import choose, look_at, with_channels
from fraexp.records.study_writer import PERIODIC_ESTIMATOR, ImportRequest
from fraexp.study.study_file import ResolvedStudy, find_study
from fraexp.views.identified_axis import answers
from fraexp.workspace.workspace_service import WorkspaceService

Arguments = ParamSpec("Arguments")
Found = TypeVar("Found")
_reported: set[tuple[LoadFailure, FileStamp | None]] = set()
"""Broken plugins that have been reported, each as its file was: calls in a loop report it once."""


class Workspace:
    """A folder with ``plugins/``, ``studies/`` and ``results.db``, each of which may be missing.

    All methods raise `FraexpError`, whose text is one line, for what a user can mend.

    Parameters
    ----------
    folder
        The folder; by default the current one.
    database
        Path or URL of the database; by default ``results.db`` in the folder.
    """

    def __init__(self, folder: str | Path = ".", database: str | None = None) -> None:
        if database is not None:
            require_text(database, "database")
        # Absolute: a session goes on in the folder in which it began, wherever the program goes.
        self._service = WorkspaceService.open(require_path(folder, "folder").absolute(), database)

    @property
    def folder(self) -> Path:
        """The folder of the workspace."""
        return self._service.folder

    def studies(self) -> dict[str, str]:
        """Return the titles of all studies, those of the workspace and the examples, by name."""
        return {entry.name: entry.title for entry in self._service.catalogue()}

    def study(self, name: str) -> Study:
        """Return a study by name or file, to be changed and run; StudyError names the nearest one."""
        own_name, file = find_study(require_text(name, "study"), self.folder)
        study = Study.from_file(file)
        study.name = own_name
        return study

    def components(self, kind: str = "friction") -> list[str]:
        """Return the names of all components of a kind: friction, plant, controller, excitation, estimator, reader."""
        refresh_plugins(self._service)
        known = self._service.registry.names(kind)
        if not known:
            kinds = sorted(of.kind for of in KINDS)
            raise ParameterError(f"there is no kind of component '{kind}'{did_you_mean(str(kind), kinds)}")
        return known

    def reload(self) -> None:
        """Load the plugins again, and report on standard error which of them are broken, in one line each.

        Calls do so by themselves after a file in ``plugins/`` has changed; a `FrictionLaw` made before keeps its law.
        """
        reload_plugins(self._service, is_asked=True)

    def run(
        self,
        study: str | Path | Study,
        changes: Mapping[str, object] | None = None,
        *,
        executor: str | None = None,
        rerun: str | None = None,
        time_limit: float | None = None,
        progress: bool = True,
    ) -> Run:
        """Run a study: missing sweeps are computed, stored ones are reused; return its results.

        An interrupt (Ctrl-C, or the notebook's stop button) stops the run, keeps finished sweeps, and is then raised
        again as KeyboardInterrupt, so that a script ends; `open_run` has what is there, and the same call continues.

        Parameters
        ----------
        study
            Name or file of a study, or a `Study`.
        changes
            Values by path, such as ``{"excitation.points": 30}``, as ``--set`` on the command line.
        executor
            ``serial``, ``processes``, ``processes:4`` or ``dask:ADDRESS``; by default the faster one.
        rerun
            Which stored sweeps are computed again: ``stale``, ``unusable`` or ``all``.
        time_limit
            Time for an experiment with its first estimator, and for each further estimator [s].
        progress
            Whether plan, progress and failures are shown, in the cell of a notebook or on standard error.
        """
        limits = ResourceLimits()
        if time_limit is not None:
            limits = ResourceLimits(time=require_positive(time_limit, "time_limit"))
        for word, what in ((executor, "executor"), (rerun, "rerun")):
            if word is not None:
                require_text(word, what)
        resolved, command = self._resolve(study, changes)
        events = self._service.run_resolved([resolved], command, RunOptions(executor, rerun, limits))
        ended = follow_run(events, progress)
        if ended.run is None:
            raise FraexpError(f"{resolved.name}: the run was interrupted before it had begun")
        run = self.open_run(ended.run, resolved.title)
        run.figures = tuple(ended.figures)
        return run

    def plan(self, study: str | Path | Study, changes: Mapping[str, object] | None = None) -> dict[str, Any]:
        """Return how many sweeps a run would reuse and compute, and the expected time; nothing is written.

        ``seconds`` is the time [s] that follows from ``like`` computed sweeps, None if there are none; it leaves out
        ``unlike`` sweeps, of which it is unknown.
        """
        resolved, _ = self._resolve(study, changes)
        (planned,) = self._service.plan_resolved([resolved], RunOptions())
        counts = {"total": planned.total, "reused": planned.reused, "missing": planned.missing}
        return counts | planned.time._asdict()

    def _resolve(self, study: str | Path | Study, changes: Mapping[str, object] | None) -> tuple[ResolvedStudy, str]:
        """Return a study with all its sweeps, and the command that the database keeps."""
        overrides = override_texts(require_mapping(changes or {}, "changes", '{"excitation.points": 30}'))
        if not isinstance(study, str | Path | Study):
            raise ParameterError(f"study is {study!r:.60}; expected its name, its file or a Study")
        refresh_plugins(self._service)
        if isinstance(study, Study):
            self._register(study.classes)
            resolved = resolve_study(study, self.folder, self._service.registry, overrides)
            command = f"fraexp.Workspace.run({study.name!r}, a study written in Python)"
        else:
            resolved = self._service.study(str(study), overrides)
            command = self._service.command(resolved.name, overrides)
        self._require_files(resolved)
        return resolved, command

    def _register(self, classes: Sequence[type[Component]]) -> None:
        for component in classes:
            self._service.registry.add_from_session(component)

    def _require_files(self, study: ResolvedStudy) -> None:
        """Refuse a class that only this session knows: a worker and a later reader need its file."""
        providers = self._service.registry.providers
        known = {of.component.name: of.component for of in providers.values() if of.distribution == SESSION}
        for name in known.keys() & direct_computation.used_names(study.sweeps):
            raise StudyError(
                f"{study.name}: '{name}' is defined in this session only; write it to "
                f"{self.folder / 'plugins'}/{name}.py and call reload(), or use simulate() and estimate()"
            )

    def runs(self) -> list[Run]:
        """Return all runs, newest first; their results are read when they are needed."""
        with self._service.open_store() as store:
            return [Run(summary, store.sweeps(summary.number), self._service) for summary in store.runs()]

    def open_run(self, number: int | str, title: str = "") -> Run:
        """Return a run by its number, or the newest run of a study; StoreError if there is none."""
        if not isinstance(number, int | str):
            raise ParameterError(f"run {number!r:.60}: expected its number, or the name of a study")
        with self._service.open_store() as store:
            newest = next((of.number for of in store.runs() if of.study == number), None)
            if newest is None and isinstance(number, str) and not number.isdecimal():
                raise StudyError(f"no run of a study '{number}' is stored; run it first")
            summary = store.run(int(number) if newest is None else newest)
            return Run(summary, store.sweeps(summary.number), self._service, title)

    def sweeps(self, filter: str = "") -> Results:  # noqa: A002 (the word that users know)
        """Return all stored sweeps that match a filter, such as ``estimator=conventional excitation.amplitude>=12``."""
        require_text(filter, "filter")
        with self._service.open_store() as store:
            found = list(store.find_all(store.keys(filter)).values())
        return Results(found, self._service, filter)

    def sweep(self, key: str) -> SweepResult:
        """Return the result of the sweep whose key starts with `key`; StoreError if there is none."""
        require_text(key, "key")
        with self._service.open_store() as store:
            found = store.find(key)
            return SweepResult(found, store.result(found.key), self._service)

    def friction_law(self, /, name: str, **parameters: object) -> FrictionLaw:
        """Return a friction law by name with its parameters, such as ``stiffness="17 N/µm"``, to be called."""
        refresh_plugins(self._service)
        if isinstance(name, type) and issubclass(name, FrictionModel):
            raise ParameterError(f"name is the class {name.__name__}; expected FrictionLaw({example_call(name)})")
        if isinstance(name, FrictionModel):
            raise ParameterError(f"name is a {type(name).__name__}; expected FrictionLaw(...) around it")
        spec = component_spec({"name": require_text(name, "name"), **parameters})
        return FrictionLaw(create(self._service.registry, FrictionModel, spec))

    def simulate(
        self, /, machine: str | Mapping[str, Any], excitation: str | Mapping[str, Any] | Component, **sections: Any
    ) -> Recording:
        """Return the signals of a simulated experiment, without a database.

        Parameters
        ----------
        machine
            Name of a machine, or its sections plant, friction, controller and loop.
        excitation
            A table such as ``{"name": "stepped_sine", "amplitude": 12.0}``, or its name.
        sections
            Sections laid over those of the machine, such as ``friction=FrictionLaw(...)`` or
            ``loop={"noise": 30e-9}``.
        """
        base = {"machine": machine} if isinstance(machine, str) else machine
        require_mapping(base, "machine", '{"plant": {...}, "friction": {...}}')
        if "estimator" in sections:
            raise ParameterError("simulate takes no estimator; give it to estimate()")
        data = {**base, **sections, "excitation": excitation, "estimator": PERIODIC_ESTIMATOR}
        refresh_plugins(self._service)
        study = Study("simulation", self.folder, **data)
        self._register(study.classes)
        resolved = resolve_study(study, self.folder, self._service.registry, place="simulate")
        sweep = direct_computation.single_sweep(resolved)
        return direct_computation.record_signals(sweep.experiment, {}, self._service)

    def read_record(
        self, /, file: str | Path | Sequence[str | Path], channels: Mapping[str, Any] | None = None, **keys: Any
    ) -> Recording:
        """Return the signals of a measured record, without a database.

        Parameters
        ----------
        file
            A file, or one for each realisation.
        channels
            Column of each channel by its name, such as ``{"u": "Torque[Nm]", "y": "Position"}``, or its
            settings. The input is called u and the output y, unless an estimator is told otherwise. Without it, the
            error proposes channels.
        keys
            Other keys of the section ``[record]``, such as ``sample_rate=2000.0`` or ``samples_per_period=4096``.
        """
        given = list(file) if isinstance(file, list | tuple) else [file]
        if not given:
            raise ParameterError("read_record: there is no file; expected one at least")
        files = [str(require_path(one, "file")) for one in given]
        refresh_plugins(self._service)
        if channels is None:
            raise missing_channels(Path(files[0]), self._service.registry)
        columns = dict(require_mapping(channels, "channels", '{"u": "iq [A]", "y": "pos [mm]"}'))
        section = {"file": files if len(files) > 1 else files[0], "channels": columns, **keys}
        settings = RecordSettings.parse(component_spec(section), "record")
        experiment, paths = resolve_record(settings, Path(), self._service.registry)
        return direct_computation.record_signals(experiment, paths, self._service)

    def signals(self, result: SweepResult) -> Recording:
        """Return the signals behind a result: simulated again, or read again from its record."""
        if not isinstance(result, SweepResult):
            raise ParameterError(f"signals: found {type(result).__name__}; expected a SweepResult, such as run[0]")
        refresh_plugins(self._service)
        return direct_computation.record_signals(
            result.sweep.experiment, self._service.record_files(result.sweep), self._service
        )

    def estimate(
        self, /, recording: Recording, estimator: str | Mapping[str, Any] | Component, **parameters: Any
    ) -> SweepResult:
        """Return what an estimator makes of signals, without a database.

        Parameters
        ----------
        recording
            Signals of `simulate`, `read_record` or `signals`.
        estimator
            Its name, its table, or an object.
        parameters
            Parameters of the estimator; others are inherited from the experiment, as in a study.
        """
        if not isinstance(recording, Recording):
            raise ParameterError(
                f"found {type(recording).__name__}; expected a Recording of simulate(), read_record() or signals()"
            )
        refresh_plugins(recording.service)
        for component in session_classes([estimator, parameters]):
            recording.service.registry.add_from_session(component)
        spec = component_spec({**component_spec(estimator), **parameters})
        return direct_computation.estimate_signals(recording, spec)

    def identify(
        self,
        /,
        file: str | Path | Sequence[str | Path],
        channels: Mapping[str, Any] | None = None,
        *,
        study: str | Path | None = None,
        progress: bool = True,
        **keys: Any,
    ) -> Identification:
        """Return plant and friction of one machine from its records, as ``fraexp identify`` does.

        The estimator follows from the records: at several amplitudes all are identified together.

        Parameters
        ----------
        file
            A file, or several: repetitions, or other amplitudes.
        channels
            As those of `read_record`; without it, those that names, units and values of the columns show.
        study
            File of the study that is written; by default ``studies/``, with the name of the first file.
        progress
            Whether plan, progress and failures are shown.
        keys
            Other keys of the section ``[record]``, such as ``skip_periods=2``.
        """
        given = list(file) if isinstance(file, list | tuple) else [file]
        if not given:
            raise ParameterError("identify: there is no file; expected one at least")
        files = [require_path(one, "file") for one in given]
        target = None if study is None else require_path(study, "study")
        columns = require_mapping(channels or {}, "channels", '{"u": "iq [A]", "y": "pos [mm]"}')
        refresh_plugins(self._service)
        registry = self._service.registry
        request = with_channels(ImportRequest(files, dict(columns), component_spec(keys)), registry)
        look = look_at(request, registry)
        choice = choose(look)
        ended = follow_run(self._service.identify(request, look, choice, target), progress)
        if ended.run is None:
            raise FraexpError("identify: the run was interrupted before it had begun")
        run = self.open_run(ended.run)
        results = {str(of.labels.get("case", "")): of.result for of in run}
        return Identification(run, tuple(answers(files, look, choice, results)))

    def __repr__(self) -> str:
        return f"<Workspace {self.folder}, database {self._database_name()}>"

    def _database_name(self) -> str:
        from fraexp.store import url_without_password

        return url_without_password(self._service.database)


def refresh_plugins(service: WorkspaceService) -> None:
    """Load the plugins of a workspace, unless their files are those that it has loaded; report each that is broken."""
    if not service.has_current_plugins():
        reload_plugins(service)


def reload_plugins(service: WorkspaceService, is_asked: bool = False) -> None:
    """Load the plugins of a workspace anew; if this `is_asked` for, what has been reported is reported again."""
    service.reload()
    registry = service.registry
    for failure in registry.failed:
        if failure.file is None:
            continue
        seen = (failure, registry.local_files.get(failure.file.name))
        if is_asked or seen not in _reported:
            say(f"fraexp: the plugin {failure.place} is broken: {failure.reason}")
        _reported.add(seen)


def missing_channels(file: Path, registry: Registry) -> ParameterError:
    """Return the error for a record without channels, which proposes some as ``fraexp import FILE`` does."""
    from fraexp.records.proposals import propose_import
    from fraexp.records.record_files import list_contents

    found = list_contents(file, registry)
    proposal = propose_import(file, found, registry)
    needs = "".join(f"; {need}" for need in proposal.needs)
    return ParameterError(f"read_record needs channels; probably those of '{proposal.command}'{needs}")


def _in_current_folder(method: Callable[Concatenate[Workspace, Arguments], Found]) -> Callable[Arguments, Found]:
    """Return a method of the workspace in the current folder as a function."""

    @wraps(method)
    def call(*arguments: Arguments.args, **options: Arguments.kwargs) -> Found:
        return method(Workspace(), *arguments, **options)

    _, *parameters = signature(method).parameters.values()
    vars(call)["__signature__"] = signature(method).replace(parameters=parameters)
    return call


run = _in_current_folder(Workspace.run)
friction_law = _in_current_folder(Workspace.friction_law)
simulate = _in_current_folder(Workspace.simulate)
read_record = _in_current_folder(Workspace.read_record)
estimate = _in_current_folder(Workspace.estimate)
identify = _in_current_folder(Workspace.identify)
