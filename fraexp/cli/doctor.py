"""``fraexp doctor``: whether installation, database and plugins are sound."""

import sqlite3
from argparse import Namespace
from pathlib import Path
from typing import Any

from fraexp.cli.exits import ExitCode
from fraexp.cli.selection import database, open_store
from fraexp.cli.terminal import print_fields, print_json, say
from fraexp.errors import StoreError
from fraexp.plugins import discover
from fraexp.provenance import gather
from fraexp.store import Store, shown
from fraexp.store.file_system import NETWORK, file_system
from fraexp.views.words import plural


def execute(arguments: Namespace) -> ExitCode:
    """Print what was found; the exit code tells whether something needs care."""
    registry = discover(Path(arguments.workspace) / "plugins")
    found, stored = gather(), _database(arguments)
    document = {
        "fraexp": found["fraexp"],
        "python": found["python"]["version"],
        "packages": found["packages"],
        "sqlite": sqlite3.sqlite_version,
        "cores": found["machine"]["usable_cores"],
        "platform": found["machine"]["platform"],
        "database": stored,
        "plugins": {
            "components": len(registry.supplies),
            "broken": [f"{failure.place}: {failure.reason}" for failure in registry.failures],
        },
    }
    if arguments.json:
        print_json(document)
    else:
        _print(document)
    if stored["error"]:
        return ExitCode.STORE
    return ExitCode.USAGE if registry.failures else ExitCode.OK


def _database(arguments: Namespace) -> dict[str, Any]:
    url = database(arguments)
    document: dict[str, Any] = {"url": shown(url), "exists": False, "runs": 0, "error": ""}
    is_file = "://" not in url or url.startswith("sqlite:")
    document["file_system"] = file_system(Path(url.removeprefix("sqlite:///")).parent) if is_file else ""
    try:
        document["exists"] = Store.exists(url)
        if document["exists"]:
            with open_store(arguments) as store:
                document["runs"] = len(store.runs())
                finding = store.health()
                document["error"] = "" if finding == "sound" else f"{store.name}: {finding}; restore a backup"
    except StoreError as error:
        document["error"] = str(error)
    return document


def _print(document: dict[str, Any]) -> None:
    stored, plugins = document["database"], document["plugins"]
    packages = ", ".join(f"{name} {version or 'missing'}" for name, version in document["packages"].items())
    sound = f"{plural(stored['runs'], 'run')}, sound" if stored["exists"] else "not there yet; the first run makes it"
    print_fields([
        ("fraexp", document["fraexp"] or "version unknown"),
        ("python", document["python"]),
        ("packages", packages),
        ("sqlite", document["sqlite"]),
        ("cores", str(document["cores"])),
        ("platform", document["platform"]),
        ("database", f"{stored['url']}: {stored['error'] or sound}"),
        ("file system", stored["file_system"]),
        ("plugins", f"{plural(plugins['components'], 'component')}, {len(plugins['broken'])} broken"),
    ])  # fmt: skip
    for reason in plugins["broken"]:
        say(f"broken: {reason}")
    if stored["file_system"].startswith(NETWORK):
        say("the database lies on a network file system, where locks are unreliable; put it on a local disk with --db")
