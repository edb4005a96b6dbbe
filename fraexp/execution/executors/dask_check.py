"""What is asked of a Dask worker before it is trusted with work: versions, code, and what a job needs there."""

import logging
import pickle
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from fraexp.components.supplies import Supply
from fraexp.execution.executors.dask_remote import Need, code_hashes, hello
from fraexp.execution.job import Job, registry_of

PACKAGES = ("fraexp", "numpy", "scipy", "numba")
"""What numbers may depend on."""


def quiet() -> None:
    """Keep to ourselves what Dask logs and warns of: what matters is told in fraexp's words."""
    import distributed

    for name in ("asyncio", "tornado", *logging.root.manager.loggerDict):
        if name.partition(".")[0] in ("asyncio", "distributed", "tornado"):
            logger = logging.getLogger(name)
            logger.handlers = [logging.NullHandler()]
            logger.propagate = False
    warnings.filterwarnings("ignore", category=distributed.versions.VersionMismatchWarning)
    warnings.filterwarnings("ignore", message="Sending large graph")


def need_of(job: Job) -> tuple[Job, Need]:
    """Return what a job needs on a worker; the job does without the workspace's plugins if none of them is used."""
    supplies = list(_supplies(job))
    own = any(supply.distribution == "workspace" for supply in supplies)
    folder = str(Path(job.plugins).resolve()) if own else ""
    components = {(s.component.kind, s.component.name, s.source_hash, s.distribution) for s in supplies}
    return replace(job, plugins=folder), Need(frozenset(components), _files(job), folder)


def _supplies(job: Job) -> Iterator[Supply]:
    registry = registry_of(job.plugins)
    sections = dict(job.experiment)
    sections["reader"] = sections.get("record", {}).get("reader")
    compensation = sections.pop("compensation", None) or {}
    pairs = [*sections.items(), *compensation.items(), *(("estimator", spec) for spec in job.estimators)]
    for kind, spec in pairs:
        if isinstance(spec, Mapping):
            yield from registry.used(kind, spec)


def _files(job: Job) -> frozenset[tuple[str, str]]:
    record = job.experiment.get("record")
    if not record:
        return frozenset()
    parts = record.get("parts", [record])
    names = ["record", *(f"record.{number}" for number in range(1, len(parts)))]
    return frozenset((job.files[name], part["hash"]) for name, part in zip(names, parts, strict=True))


def together(needs: list[Need]) -> Need:
    """Return what several jobs need."""
    first = needs[0]
    if all(need == first for need in needs):
        return first
    components = frozenset[tuple[str, str, str, str]]().union(*(need.components for need in needs))
    files = frozenset[tuple[str, str]]().union(*(need.files for need in needs))
    return Need(components, files, max(need.plugins for need in needs))


async def unfit(client: Any, address: str) -> tuple[str, str]:
    """Return what tells a worker's process from others, and why it must not compute; empty if it may.

    Versions are asked of Dask itself, before any code of ours is sent.
    """
    from distributed.versions import get_versions

    answers = await client.scheduler.broadcast(
        msg={"op": "versions", "packages": list(PACKAGES)}, workers=[address], on_error="return_pickle"
    )
    answer = answers.get(address)
    if not isinstance(answer, Mapping):
        return "", f"does not answer ({type(pickle.loads(answer)).__name__})" if answer else "does not answer"
    theirs, ours = answer["packages"], get_versions(packages=PACKAGES)["packages"]
    reason = _other_version(theirs, ours)
    if reason:
        return "", reason
    future = client.submit(hello, workers=[address], allow_other_workers=False, pure=False)
    try:
        process, code = await future._result()
    except Exception as error:
        if future.status != "error":  # the connection is broken
            raise
        # an import there fails, in whatever way
        return "", f"cannot run fraexp ({type(error).__name__}: {str(error).splitlines()[0] if str(error) else ''})"
    finally:
        future.release()
    here = code_hashes(list(code))
    other = sorted(name for name in code if here.get(name) != code[name])
    if other:
        return (
            "",
            f"has another source of {other[0]}, though of the same version; install the same there and restart it",
        )
    return process, ""


def _other_version(theirs: Mapping[str, Any], ours: Mapping[str, Any]) -> str:
    python = [".".join(str(one["python"]).split(".")[:2]) for one in (theirs, ours)]
    if python[0] != python[1]:
        return f"has Python {python[0]}, here is {python[1]}; start it with the same"
    for name in PACKAGES:
        if theirs.get(name) == ours.get(name):
            continue
        if theirs.get(name) is None:
            return f"has no {name}; install {name} {ours.get(name)} there and restart it"
        return f"has {name} {theirs[name]}, here is {ours.get(name)}; install the same there and restart it"
    return ""
