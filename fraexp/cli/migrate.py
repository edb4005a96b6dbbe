"""``fraexp migrate``: a database updated to the current schema, or studies to the current names."""

from argparse import Namespace

from fraexp.cli.exits import ExitCode
from fraexp.cli.output import print_json, print_line, say
from fraexp.cli.sweep_lookup import workspace_folder
from fraexp.store import masked_url
from fraexp.views.words import plural

DIGESTS_SINCE = "0007"
"""Revision of the schema from which on results have digests."""


def execute(arguments: Namespace) -> ExitCode:
    """Migrate the database or the studies, and print what changed."""
    if arguments.studies is not None:
        return _rewrite_studies(arguments)
    workspace = workspace_folder(arguments)
    url, done = workspace.database, workspace.migrate_database()
    if arguments.json:
        print_json(
            {
                "database": masked_url(url),
                "before": done.before,
                "now": done.now,
                "bytes": [done.size_before, done.size],
                "copy": done.copy,
            }
        )
        return ExitCode.OK
    what = f"schema {done.now}" if done.before == done.now else f"schema {done.before} -> {done.now}"
    print_line(f"{masked_url(url)}: {what}, {done.size_before / 2**20:.1f} -> {done.size / 2**20:.1f} MiB")
    if done.copy:
        say(done.copy)
    if done.before < DIGESTS_SINCE <= done.now:
        say("digests of what was stored were computed: damage is noticed from now on, older damage is not")
    return ExitCode.OK


def _rewrite_studies(arguments: Namespace) -> ExitCode:
    """Rewrite study files with the current names; a file that cannot be rewritten does not stop the others."""
    from fraexp.workspace.workspace_service import WorkspaceService

    done = list(WorkspaceService.open(arguments.workspace, arguments.db).rewrite_studies(arguments.studies))
    if arguments.json:
        print_json([{"file": str(one.file), "renamed": one.renamed, "error": one.error} for one in done])
    for one in done if not arguments.json else ():
        if one.renamed:
            print_line(f"{one.file}: {', '.join(f'{old} -> {new}' for old, new in one.renamed.items())}")
        if one.error:
            say(f"fraexp: {one.error}")
    changed, failed = sum(bool(one.renamed) for one in done), sum(bool(one.error) for one in done)
    if not arguments.json:
        print_line(
            f"{plural(changed, 'study file')} rewritten, {len(done) - changed - failed} up to date, {failed} unusable"
        )
    return ExitCode.USAGE if failed else ExitCode.OK
