"""``fraexp fit``, ``tune`` and ``design``: a plant, feedback or excitation found from stored responses."""

from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path

from fraexp.cli.exits import ExitCode
from fraexp.cli.follow import RunEvents, follow, print_outcome
from fraexp.cli.output import print_path, say
from fraexp.cli.sweep_lookup import choose_sweeps, find_run_number
from fraexp.components.kinds import Controller, Excitation, Plant
from fraexp.components.registry import Registry
from fraexp.data import toml
from fraexp.errors import FraexpError
from fraexp.store import StoredSweep, leave_out_damaged
from fraexp.workspace.fit_specs import fit_estimator, inherited_fit_settings, write_designed_study
from fraexp.workspace.workspace_service import WorkspaceService

KINDS = {"fit": Plant.kind, "tune": Controller.kind, "design": Excitation.kind}
"""Kind of component that each command finds."""


def execute(arguments: Namespace) -> ExitCode:
    """Find the component for the responses of sweeps, and print the results; a design becomes a study."""
    workspace = WorkspaceService.open(arguments.workspace, arguments.db)
    followed = _follow_fit(arguments, KINDS[arguments.command], workspace)
    code = print_outcome(followed, arguments, workspace)
    runs = [ended.run for ended in followed.ended if ended.run is not None]
    if arguments.command == "design" and code is ExitCode.OK and runs:
        _write_study(arguments, workspace, runs[-1])
    return code


def _write_study(arguments: Namespace, workspace: WorkspaceService, run: int) -> None:
    """Write the study of the excitation that a run has designed."""
    output: Path = arguments.output
    with workspace.open_store() as store:
        sweeps = store.sweeps(run)
        if len(sweeps) != 1:
            raise FraexpError(
                f"design: run {run} has {len(sweeps)} excitations; expected one: name a sweep by the beginning of its "
                "key, which fraexp list shows"
            )
        result = store.result(sweeps[0].key)
    write_designed_study(sweeps[0], result, f"{output.stem}: the sines that tell most", output, force=arguments.force)
    if arguments.json:
        say(f"wrote {output}")
    else:
        print_path(output, "study ")


def _follow_fit(arguments: Namespace, kind: str, workspace: WorkspaceService) -> RunEvents:
    """Fit a component of a kind to the responses of sweeps, and show the events of the run."""
    command = arguments.command
    with workspace.open_store() as store:
        numbers = [find_run_number(store, identifier) for identifier in arguments.ids]
        names = {store.run(number).study for number in numbers if number is not None}
        chosen = choose_sweeps(store, arguments.ids)
        results = store.results(sweep.key for sweep in chosen)
        sweeps = [sweep for sweep in chosen if sweep.key in results]
    sweeps = leave_out_damaged(sweeps, results, say)
    with_response = [sweep for sweep in sweeps if results[sweep.key].response is not None]
    if not with_response:
        raise FraexpError(f"{command}: found no frequency response; expected a run or sweeps that have one")
    name = f"{names.pop() if len(names) == 1 else with_response[0].key[4:12]}-{command}"
    fitting = fit_estimator(workspace.registry, arguments.estimator, kind)
    report_inherited(with_response, fitting, arguments.overrides, workspace.registry)
    return follow(workspace.fit(with_response, name, arguments.overrides, fitting, kind))


def report_inherited(sweeps: Sequence[StoredSweep], fitting: str, overrides: Sequence[str], registry: Registry) -> None:
    """Report which settings are inherited from the fits of the studies."""
    kept = [inherited_fit_settings(sweep, fitting, overrides, registry) for sweep in sweeps]
    texts = {", ".join(f"{name}={toml.dumps(value)}" for name, value in each.items()): each for each in kept if each}
    for text, each in texts.items():
        say(f"settings of the study's own fit are kept: {text}; reset one by --set {next(iter(each))}=")
