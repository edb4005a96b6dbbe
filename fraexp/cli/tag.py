"""``fraexp tag``: give sweeps a tag, or take it away."""

from argparse import Namespace

from fraexp.cli.exits import ExitCode
from fraexp.cli.output import say
from fraexp.cli.sweep_lookup import chosen, database
from fraexp.store import Store
from fraexp.views.words import plural


def execute(arguments: Namespace) -> ExitCode:
    """Change the tags of sweeps."""
    with Store.open(database(arguments)) as store:
        keys = [sweep.key for sweep in chosen(store, arguments.ids)]
        (store.untag if arguments.remove else store.tag)(keys, arguments.tag)
    done = "no longer tagged" if arguments.remove else "tagged"
    say(f"{plural(len(keys), 'sweep')} {done} {arguments.tag}; fraexp list tag:{arguments.tag} shows which have it")
    return ExitCode.OK
