"""``fraexp doctor``: the state of installation, database, plugins and numerics."""

import math
import shlex
import sqlite3
from argparse import Namespace
from dataclasses import asdict
from datetime import UTC, datetime, timedelta
from importlib import metadata
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import psutil

from fraexp.cli.exits import ExitCode
from fraexp.cli.output import print_fields, print_json, say
from fraexp.cli.sweep_lookup import workspace_folder
from fraexp.errors import StoreError
from fraexp.execution.provenance import gather_provenance
from fraexp.figures.result_files import json_value
from fraexp.kernels.cache_folder import cache_folder
from fraexp.store import RunSummary, Store, masked_url
from fraexp.store.backends.sqlite import NETWORK_TYPES, file_system_type
from fraexp.testing import selftest
from fraexp.views.words import duration_text, plural
from fraexp.workspace.workspace_folder import WorkspaceFolder

EXTRA_PACKAGES = {"postgresql": "psycopg", "dask": "distributed"}
"""Package that each optional extra installs."""
HEARTBEAT_TIMEOUT = timedelta(minutes=1)
"""A run without a heartbeat for so long hangs, or its machine is gone."""


def execute(arguments: Namespace) -> ExitCode:
    """Print the findings; the exit code reports whether something needs attention."""
    workspace = workspace_folder(arguments)
    registry = workspace.registry
    found, stored, tested = (
        gather_provenance(),
        _database_document(workspace, workspace.shown_options()),
        selftest.run_self_test(),
    )
    memory = psutil.virtual_memory()
    document = {
        "fraexp": found["fraexp"],
        "python": found["python"]["version"],
        "packages": found["packages"],
        "extras": {name: _version(package) for name, package in EXTRA_PACKAGES.items()},
        "sqlite": sqlite3.sqlite_version,
        "cores": found["machine"]["usable_cores"],
        "memory": {"total": memory.total, "available": memory.available},
        "platform": found["machine"]["platform"],
        "database": stored,
        "cache": {"folder": str(cache_folder()), "error": _cache_error()},
        "plugins": {
            "components": len(registry.providers),
            "broken": [f"{failure.place}: {failure.reason}" for failure in registry.failures],
        },
        "self_test": json_value(asdict(tested)),
    }
    if arguments.json:
        print_json(document)
    else:
        _print(document, tested)
    is_usable = not stored["error"] and (stored["exists"] or not stored["read_only"])
    if not (is_usable and tested.sound):
        return ExitCode.INCOMPLETE
    return ExitCode.USAGE if registry.failures else ExitCode.OK


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _cache_error() -> str:
    """Return why the folder of compiled friction laws cannot be written; empty if it can."""
    try:
        cache_folder().mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=cache_folder()):
            return ""
    except OSError as error:
        return error.strerror or str(error)


def _database_document(workspace: WorkspaceFolder, here: str) -> dict[str, Any]:
    url = workspace.database
    document: dict[str, Any] = {"url": masked_url(url), "exists": False, "runs": 0, "error": ""}
    document |= {"sweeps": 0, "size": 0, "hanging": [], "read_only": ""}
    is_file = "://" not in url or url.startswith("sqlite:")
    file = Path(url.removeprefix("sqlite:///"))
    document["file_system"] = file_system_type(file.parent) if is_file else ""
    try:
        document["exists"] = workspace.database_exists()
        document["read_only"] = workspace.write_refusal()
        if document["exists"]:
            with workspace.open_store() as store:
                finding = store.health()
                document["error"] = "" if finding == "sound" else f"{store.name}: {finding}"
                document |= _database_contents(store, here)
    except StoreError as error:
        document["error"] = document["error"] or str(error)
        document["exists"] |= is_file and file.exists()  # though something else may have written it
    return document


def _database_contents(store: Store, here: str) -> dict[str, object]:
    runs, leases = store.runs(), store.leases()
    complete = {run.study: run.number for run in reversed(runs) if run.state == "complete"}
    hanging = [
        _hanging_text(run, leases.get(run.number, 0), here) for run in runs if run.number > complete.get(run.study, 0)
    ]  # a later complete run makes earlier ones irrelevant
    return {
        "runs": len(runs),
        "sweeps": store.page(limit=0).total,
        "size": store.size(),
        "hanging": [text for text in hanging if text],
    }


def _hanging_text(run: RunSummary, leases: int, here: str) -> str:
    """Return the fault of a run that hangs or was interrupted; empty if it has none.

    `here` holds the options that name the workspace and its database.
    """
    holds = f", with {plural(leases, 'sweep')} leased to it" if leases else ""
    if run.state == "running":
        silence = (datetime.now(UTC) - run.heartbeat).total_seconds()
        if silence < HEARTBEAT_TIMEOUT.total_seconds():
            return ""
        remedy = f"fraexp stop {run.number}{here} ends it"
        return f"run {run.number}: last heartbeat {duration_text(silence)} ago{holds}; {remedy}"
    if run.ended is None:
        return f"run {run.number} was interrupted{holds}; fraexp run {shlex.quote(run.study)}{here} continues it"
    return f"run {run.number} has ended{holds}, which have no effect any more" if leases else ""


def _print(document: dict[str, Any], tested: selftest.SelfTest) -> None:
    stored, plugins, memory = document["database"], document["plugins"], document["memory"]
    packages = ", ".join(f"{name} {version or 'missing'}" for name, version in document["packages"].items())
    extras = ", ".join(f"{name} {version or 'not installed'}" for name, version in document["extras"].items())
    counts = f"{plural(stored['runs'], 'run')}, {plural(stored['sweeps'], 'sweep')}, {stored['size'] / 1e6:.1f} MB"
    sound = f"{counts}, sound" if stored["exists"] else "not created yet; the first run creates it"
    print_fields([
        ("fraexp", document["fraexp"] or "version unknown"),
        ("python", document["python"]),
        ("packages", packages),
        ("extras", extras),
        ("sqlite", document["sqlite"]),
        ("cores", str(document["cores"])),
        ("memory", f"{memory['total'] / 1e9:.1f} GB, {memory['available'] / 1e9:.1f} GB available"),
        ("platform", document["platform"]),
        ("database", _located_text(stored["error"] or sound, stored["url"])),
        ("file system", stored["file_system"]),
        ("cache", document["cache"]["folder"]),
        ("plugins", f"{plural(plugins['components'], 'component')}, {len(plugins['broken'])} broken"),
        ("self-test", _self_test_text(tested)),
    ])  # fmt: skip
    if document["cache"]["error"]:
        why = f"{document['cache']['folder']} cannot be written ({document['cache']['error']})"
        say(f"cache: {why}; every process compiles friction laws again; set FRAEXP_CACHE_DIR to a folder of yours")
    for reason in plugins["broken"]:
        say(f"broken: {reason}")
    if stored["read_only"]:
        say(f"read-only: {stored['read_only']}" if stored["exists"] else stored["read_only"])
    for text in stored["hanging"]:
        say(text)
    if stored["file_system"].startswith(NETWORK_TYPES):
        say("the database is on a network file system, where locks are unreliable; put it on a local disk with --db")


def _located_text(text: str, url: str) -> str:
    """Return a text about a database with its place, unless the text begins with it, as most errors do."""
    return text if text.startswith(url.removeprefix("sqlite:///")) else f"{url}: {text}"


def _self_test_text(tested: selftest.SelfTest) -> str:
    how = f" ({tested.kernel})" if tested.kernel else ""
    if not tested.sound:
        return f"wrong results: {tested.error}{how}"
    far = f"{tested.difference:.0e}" if math.isfinite(tested.difference) else "unknown"
    return f"sound, relative difference {far} from the reference, {duration_text(tested.seconds)}{how}"
