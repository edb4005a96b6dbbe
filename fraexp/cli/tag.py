"""``fraexp tag``: tags on sweeps."""

import shlex
from argparse import Namespace

from fraexp.cli.exits import ExitCode
from fraexp.cli.output import say
from fraexp.cli.sweep_lookup import choose_sweeps, workspace_folder
from fraexp.views.words import plural


def execute(arguments: Namespace) -> ExitCode:
    """Add a tag to sweeps, or remove it."""
    with workspace_folder(arguments).open_store("write") as store:
        keys = [sweep.key for sweep in choose_sweeps(store, arguments.ids)]
        (store.untag if arguments.remove else store.tag)(keys, arguments.tag)
    done = "no longer tagged" if arguments.remove else "tagged"
    listing = f"fraexp list {shlex.quote(f'tag:{arguments.tag}')}{workspace_folder(arguments).shown_options()}"
    say(f"{plural(len(keys), 'sweep')} {done} {arguments.tag}; {listing} lists all with this tag")
    return ExitCode.OK
