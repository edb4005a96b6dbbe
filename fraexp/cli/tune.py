"""``fraexp tune``: feedback gains for stored responses, with guaranteed margins."""

from argparse import Namespace

from fraexp.cli.exits import ExitCode
from fraexp.cli.fit import fit_sweeps
from fraexp.components.kinds import Controller


def execute(arguments: Namespace) -> ExitCode:
    """Tune the feedback of the machines whose responses sweeps have, and print the results."""
    return fit_sweeps(arguments, Controller.kind)
