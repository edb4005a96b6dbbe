"""``fraexp migrate``: bring a database up to date, and give back unused room."""

from argparse import Namespace

from fraexp.cli.exits import ExitCode
from fraexp.cli.output import print_json
from fraexp.cli.sweep_lookup import database
from fraexp.store import Store, shown


def execute(arguments: Namespace) -> ExitCode:
    """Do it, and tell what was done."""
    url = database(arguments)
    done = Store.migrate(url)
    if arguments.json:
        print_json(
            {"database": shown(url), "before": done.before, "now": done.now, "bytes": [done.size_before, done.size]}
        )
        return ExitCode.OK
    what = f"schema {done.now}" if done.before == done.now else f"schema {done.before} -> {done.now}"
    print(f"{shown(url)}: {what}, {done.size_before / 2**20:.1f} -> {done.size / 2**20:.1f} MiB")
    return ExitCode.OK
