"""Checks of a Dask worker before it is given work: versions, code, and what a job requires there."""

import logging
import pickle
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from fraexp.components.providers import Provider
from fraexp.execution.executors.dask_address import first_line
from fraexp.execution.executors.dask_remote import Requirements, code_hashes, worker_versions
from fraexp.execution.job import Job, job_registry
from fraexp.execution.used_components import component_sections

COMPARED_PACKAGES = ("fraexp", "numpy", "scipy", "numba")
"""Packages on which results may depend."""
DaskClient = Any
"""An asynchronous ``distributed.Client``: the package describes the types of a blocking one."""


def silence_dask() -> None:
    """Suppress the logs and warnings of Dask: fraexp reports what matters in its own words."""
    import distributed

    for name in ("asyncio", "tornado", *logging.root.manager.loggerDict):
        if name.partition(".")[0] in ("asyncio", "distributed", "tornado"):
            logger = logging.getLogger(name)
            logger.handlers = [logging.NullHandler()]
            logger.propagate = False
    warnings.filterwarnings("ignore", category=distributed.versions.VersionMismatchWarning)
    warnings.filterwarnings("ignore", message="Sending large graph")


def split_requirements(job: Job) -> tuple[Job, Requirements]:
    """Return a job, without the local plugins if it uses none of them, and what it requires on a worker."""
    providers = list(_used_components(job))
    own = any(provider.distribution == "workspace" for provider in providers)
    folder = str(Path(job.plugins).resolve()) if own else ""
    components = {(s.component.kind, s.component.name, s.source_hash, s.distribution) for s in providers}
    return replace(job, plugins=folder), Requirements(frozenset(components), _record_files(job), folder)


def _used_components(job: Job) -> Iterator[Provider]:
    registry = job_registry(job)
    for kind, spec in component_sections(job.experiment, job.estimators):
        yield from registry.used_providers(kind, spec)


def _record_files(job: Job) -> frozenset[tuple[str, str]]:
    record = job.experiment.get("record")
    if not record:
        return frozenset()
    parts = record.get("parts", [record])
    names = ["record", *(f"record.{number}" for number in range(1, len(parts)))]
    return frozenset((job.files[name], part["hash"]) for name, part in zip(names, parts, strict=True))


def merge_requirements(all_requirements: list[Requirements]) -> Requirements:
    """Return the requirements of several jobs together."""
    first = all_requirements[0]
    if all(requirements == first for requirements in all_requirements):
        return first
    components = frozenset[tuple[str, str, str, str]]().union(
        *(requirements.components for requirements in all_requirements)
    )
    files = frozenset[tuple[str, str]]().union(*(requirements.files for requirements in all_requirements))
    return Requirements(components, files, max(requirements.plugins for requirements in all_requirements))


class WorkerCheck(NamedTuple):
    """Result of the check of a worker."""

    process: str
    """Identifier of the worker's process; empty if it is refused."""
    refusal: str
    """Why the worker must not compute; empty if it may."""


async def check_worker(client: DaskClient, address: str) -> WorkerCheck:
    """Check a worker: Dask itself reports its versions, before any code of fraexp is sent."""
    from distributed.versions import get_versions

    answers = await client.scheduler.broadcast(
        msg={"op": "versions", "packages": list(COMPARED_PACKAGES)}, workers=[address], on_error="return_pickle"
    )
    answer = answers.get(address)
    if not isinstance(answer, Mapping):
        return WorkerCheck(
            "", f"does not answer ({type(pickle.loads(answer)).__name__})" if answer else "does not answer"
        )
    theirs, ours = answer["packages"], get_versions(packages=COMPARED_PACKAGES)["packages"]
    reason = _version_difference(theirs, ours)
    if reason:
        return WorkerCheck("", reason)
    future = client.submit(worker_versions, workers=[address], allow_other_workers=False, pure=False)
    try:
        process, code = await future.result()
    except Exception as error:
        if future.status != "error":  # the connection is broken
            raise
        # an import there fails, in whatever way
        return WorkerCheck("", f"cannot run fraexp ({type(error).__name__}: {first_line(error)})")
    finally:
        future.release()
    here = code_hashes(list(code))
    other = sorted(name for name in code if here.get(name) != code[name])
    if other:
        reason = f"has another source of {other[0]} in the same version; install the same source there and restart it"
        return WorkerCheck("", reason)
    return WorkerCheck(process, "")


def _version_difference(theirs: Mapping[str, object], ours: Mapping[str, object]) -> str:
    python = [".".join(str(one["python"]).split(".")[:2]) for one in (theirs, ours)]
    if python[0] != python[1]:
        return f"has Python {python[0]}, but {python[1]} is here; start it with the same"
    for name in COMPARED_PACKAGES:
        if theirs.get(name) == ours.get(name):
            continue
        if theirs.get(name) is None:
            return f"has no {name}; install {name} {ours.get(name)} there and restart it"
        return f"has {name} {theirs[name]}, but {ours.get(name)} is here; install the same there and restart it"
    return ""
