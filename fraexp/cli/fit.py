"""``fraexp fit``: a plant model fitted to stored responses."""

from argparse import Namespace
from collections.abc import Sequence

from fraexp.cli.exits import ExitCode
from fraexp.cli.follow import follow, report
from fraexp.cli.output import say
from fraexp.cli.sweep_lookup import chosen, database, open_store, run_of
from fraexp.errors import FraexpError
from fraexp.store import StoredSweep
from fraexp.workspace.fit_specs import estimator, taken_over
from fraexp.workspace.workspace import Workspace


def execute(arguments: Namespace) -> ExitCode:
    """Fit the responses of sweeps, and print what came out."""
    workspace = Workspace.open(arguments.workspace, database(arguments))
    with open_store(arguments) as store:
        numbers = [run_of(store, identifier) for identifier in arguments.ids]
        names = {store.run(number).study for number in numbers if number is not None}
        results = store.results(sweep.key for sweep in chosen(store, arguments.ids))
        sweeps = [sweep for sweep in chosen(store, arguments.ids) if sweep.key in results]
    with_response = [sweep for sweep in sweeps if results[sweep.key].response is not None]
    if not with_response:
        raise FraexpError("fit: found no frequency response; name a run or sweeps that have one")
    name = f"{names.pop() if len(names) == 1 else with_response[0].key[4:12]}-fit"
    _tell_taken_over(with_response, arguments, workspace)
    return report(
        follow(workspace.fit(with_response, name, arguments.overrides, arguments.using)), arguments, workspace
    )


def _tell_taken_over(sweeps: Sequence[StoredSweep], arguments: Namespace, workspace: Workspace) -> None:
    """Say which settings of the studies' own fits hold."""
    fitting = estimator(workspace.registry, arguments.using)
    kept = [taken_over(sweep, fitting, arguments.overrides, workspace.registry) for sweep in sweeps]
    texts = {", ".join(f"{name}={value}" for name, value in each.items()): each for each in kept if each}
    for text, each in texts.items():
        say(f"taken over from the study's own fit: {text}; --set {next(iter(each))}= for the default")
