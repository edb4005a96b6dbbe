"""``fraexp doctor``: whether installation, database, plugins and numbers are sound."""

import math
import sqlite3
from argparse import Namespace
from dataclasses import asdict
from datetime import UTC, datetime, timedelta
from importlib import metadata
from pathlib import Path
from typing import Any

from fraexp.cli.documents import plain
from fraexp.cli.exits import ExitCode
from fraexp.cli.output import print_fields, print_json, say
from fraexp.cli.sweep_lookup import database, open_store
from fraexp.components.registry import discover
from fraexp.errors import StoreError
from fraexp.execution.provenance import gather
from fraexp.store import RunSummary, Store, shown
from fraexp.store.backends.file_system import NETWORK, file_system
from fraexp.testing import selftest
from fraexp.views.words import duration, plural

EXTRAS = {"postgresql": "psycopg", "dask": "distributed"}
"""Package of each extra."""
SILENT = timedelta(minutes=1)
"""A run that says nothing for so long hangs, or has lost its machine."""
MEMORY = Path("/proc/meminfo")


def execute(arguments: Namespace) -> ExitCode:
    """Print what was found; the exit code tells whether something needs care."""
    registry = discover(Path(arguments.workspace) / "plugins")
    found, stored, tested = gather(), _database(arguments), selftest.run()
    document = {
        "fraexp": found["fraexp"],
        "python": found["python"]["version"],
        "packages": found["packages"],
        "extras": {name: _version(package) for name, package in EXTRAS.items()},
        "sqlite": sqlite3.sqlite_version,
        "cores": found["machine"]["usable_cores"],
        "memory": _memory(),
        "platform": found["machine"]["platform"],
        "database": stored,
        "plugins": {
            "components": len(registry.supplies),
            "broken": [f"{failure.place}: {failure.reason}" for failure in registry.failures],
        },
        "self_test": plain(asdict(tested)),
    }
    if arguments.json:
        print_json(document)
    else:
        _print(document, tested)
    if stored["error"]:
        return ExitCode.STORE
    if not tested.sound:
        return ExitCode.INCOMPLETE
    return ExitCode.USAGE if registry.failures else ExitCode.OK


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _memory() -> dict[str, int]:
    """Return the machine's memory and what is left of it [bytes]; nothing where the system does not tell."""
    try:
        lines = MEMORY.read_text(encoding="utf-8").splitlines()
    except OSError:
        return {}
    found = {name: int(value.split()[0]) * 1024 for name, _, value in (line.partition(":") for line in lines) if value}
    return {"total": found["MemTotal"], "available": found["MemAvailable"]} if "MemAvailable" in found else {}


def _database(arguments: Namespace) -> dict[str, Any]:
    url = database(arguments)
    document: dict[str, Any] = {"url": shown(url), "exists": False, "runs": 0, "error": ""}
    document |= {"sweeps": 0, "size": 0, "journal": "", "hanging": [], "read_only": ""}
    is_file = "://" not in url or url.startswith("sqlite:")
    file = Path(url.removeprefix("sqlite:///"))
    document["file_system"] = file_system(file.parent) if is_file else ""
    try:
        document["exists"] = Store.exists(url)
        document["read_only"] = Store.refusal(url)
        if document["exists"]:
            with open_store(arguments) as store:
                document |= _stored(store)
                finding = store.health()
                document["error"] = "" if finding == "sound" else f"{store.name}: {finding}; restore a backup"
    except StoreError as error:
        document["error"] = str(error)
        document["exists"] |= is_file and file.exists()  # though it may be none of ours
    return document


def _stored(store: Store) -> dict[str, Any]:
    runs, leases = store.runs(), store.leases()
    complete = {run.study: run.number for run in reversed(runs) if run.state == "complete"}
    hanging = [
        _hangs(run, leases.get(run.number, 0)) for run in runs if run.number > complete.get(run.study, 0)
    ]  # what a later run has completed needs no care
    return {
        "runs": len(runs),
        "sweeps": store.page(limit=0).total,
        "size": store.size(),
        "journal": store.journal(),
        "hanging": [text for text in hanging if text],
    }


def _hangs(run: RunSummary, leases: int) -> str:
    """Return what is wrong with a run that has not ended as runs do; nothing if all is well."""
    holds = f", with {plural(leases, 'sweep')} leased to it" if leases else ""
    if run.state == "running":
        silence = (datetime.now(UTC) - run.heartbeat).total_seconds()
        if silence < SILENT.total_seconds():
            return ""
        return f"run {run.number} has said nothing for {duration(silence)}{holds}; fraexp stop {run.number} ends it"
    if run.ended is None:
        return f"run {run.number} was broken off{holds}; fraexp run {run.study} goes on from there"
    return f"run {run.number} has ended{holds}, which nobody waits for" if leases else ""


def _print(document: dict[str, Any], tested: selftest.SelfTest) -> None:
    stored, plugins, memory = document["database"], document["plugins"], document["memory"]
    packages = ", ".join(f"{name} {version or 'missing'}" for name, version in document["packages"].items())
    extras = ", ".join(f"{name} {version or 'not installed'}" for name, version in document["extras"].items())
    counts = f"{plural(stored['runs'], 'run')}, {plural(stored['sweeps'], 'sweep')}, {stored['size'] / 1e6:.1f} MB"
    sound = f"{counts}, sound" if stored["exists"] else "not there yet; the first run makes it"
    print_fields([
        ("fraexp", document["fraexp"] or "version unknown"),
        ("python", document["python"]),
        ("packages", packages),
        ("extras", extras),
        ("sqlite", document["sqlite"]),
        ("cores", str(document["cores"])),
        ("memory", f"{memory['total'] / 1e9:.1f} GB, {memory['available'] / 1e9:.1f} GB left" if memory else "unknown"),
        ("platform", document["platform"]),
        ("database", _placed(stored["error"] or sound, stored["url"])),
        ("journal", stored["journal"]),
        ("file system", stored["file_system"]),
        ("plugins", f"{plural(plugins['components'], 'component')}, {len(plugins['broken'])} broken"),
        ("self-test", _told(tested)),
    ])  # fmt: skip
    for reason in plugins["broken"]:
        say(f"broken: {reason}")
    if stored["read_only"]:
        say(f"read-only: {stored['read_only']}" if stored["exists"] else stored["read_only"])
    for text in stored["hanging"]:
        say(text)
    if stored["file_system"].startswith(NETWORK):
        say("the database lies on a network file system, where locks are unreliable; put it on a local disk with --db")


def _placed(text: str, url: str) -> str:
    """Return what is said of a database, with its place: an error mostly begins with that."""
    return text if text.startswith(url.removeprefix("sqlite:///")) else f"{url}: {text}"


def _told(tested: selftest.SelfTest) -> str:
    how = f" ({tested.kernel})" if tested.kernel else ""
    if not tested.sound:
        return f"wrong numbers: {tested.error}{how}"
    far = f"{tested.difference:.0e}" if math.isfinite(tested.difference) else "unknown"
    return f"sound, {far} from the stored numbers, in {duration(tested.seconds)}{how}"
