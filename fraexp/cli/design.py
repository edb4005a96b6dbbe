"""``fraexp design``: the excitation that tells most in a given measuring time, for a machine known from a run."""

from argparse import Namespace
from pathlib import Path

from fraexp.cli.exits import ExitCode
from fraexp.cli.fit import follow_fit
from fraexp.cli.follow import print_outcome
from fraexp.cli.output import print_path, say
from fraexp.components.kinds import Excitation
from fraexp.errors import FraexpError
from fraexp.workspace.designed_study import write_designed_study
from fraexp.workspace.workspace_service import WorkspaceService


def execute(arguments: Namespace) -> ExitCode:
    """Design an excitation for the machine of a sweep, print what it is predicted to tell, and write its study."""
    workspace = WorkspaceService.open(arguments.workspace, arguments.db)
    followed = follow_fit(arguments, Excitation.kind, workspace)
    code = print_outcome(followed, arguments, workspace)
    runs = [ended.run for ended in followed.ended if ended.run is not None]
    if code is ExitCode.OK and runs:
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
                "key, which fraexp show lists"
            )
        result = store.result(sweeps[0].key)
    write_designed_study(sweeps[0], result, f"{output.stem}: the sines that tell most", output, force=arguments.force)
    if arguments.json:
        say(f"wrote {output}")
    else:
        print_path(output, "study ")
