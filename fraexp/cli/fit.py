"""``fraexp fit``: a plant model fitted to stored responses."""

from argparse import Namespace
from collections.abc import Sequence

from fraexp.cli.exits import ExitCode
from fraexp.cli.follow import RunEvents, follow, print_outcome
from fraexp.cli.output import say
from fraexp.cli.sweep_lookup import choose_sweeps, find_run_number
from fraexp.components.kinds import Plant
from fraexp.errors import FraexpError
from fraexp.store import StoredSweep, leave_out_damaged
from fraexp.workspace.fit_specs import fit_estimator, inherited_fit_settings
from fraexp.workspace.workspace_service import WorkspaceService


def execute(arguments: Namespace) -> ExitCode:
    """Fit a plant to the responses of sweeps, and print the results."""
    return fit_sweeps(arguments, Plant.kind)


def fit_sweeps(arguments: Namespace, kind: str) -> ExitCode:
    """Fit a component of a kind to the responses of sweeps, and print the results."""
    workspace = WorkspaceService.open(arguments.workspace, arguments.db)
    return print_outcome(follow_fit(arguments, kind, workspace), arguments, workspace)


def follow_fit(arguments: Namespace, kind: str, workspace: WorkspaceService) -> RunEvents:
    """Fit a component of a kind to the responses of sweeps, and show the events of the run."""
    command = arguments.command
    with workspace.open_store() as store:
        numbers = [find_run_number(store, identifier) for identifier in arguments.ids]
        names = {store.run(number).study for number in numbers if number is not None}
        results = store.results(sweep.key for sweep in choose_sweeps(store, arguments.ids))
        sweeps = [sweep for sweep in choose_sweeps(store, arguments.ids) if sweep.key in results]
    sweeps = leave_out_damaged(sweeps, results, say)
    with_response = [sweep for sweep in sweeps if results[sweep.key].response is not None]
    if not with_response:
        raise FraexpError(f"{command}: found no frequency response; expected a run or sweeps that have one")
    name = f"{names.pop() if len(names) == 1 else with_response[0].key[4:12]}-{command}"
    fitting = fit_estimator(workspace.registry, arguments.estimator, kind)
    _report_inherited(with_response, fitting, arguments, workspace)
    return follow(workspace.fit(with_response, name, arguments.overrides, fitting, kind))


def _report_inherited(
    sweeps: Sequence[StoredSweep], fitting: str, arguments: Namespace, workspace: WorkspaceService
) -> None:
    """Report which settings are inherited from the fits of the studies."""
    kept = [inherited_fit_settings(sweep, fitting, arguments.overrides, workspace.registry) for sweep in sweeps]
    texts = {", ".join(f"{name}={value}" for name, value in each.items()): each for each in kept if each}
    for text, each in texts.items():
        say(f"settings of the study's own fit are kept: {text}; reset one by --set {next(iter(each))}=")
