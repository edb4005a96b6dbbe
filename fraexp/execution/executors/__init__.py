"""Where jobs run: in this process, in processes of their own, or on a cluster."""

import os

from fraexp.errors import StudyError, did_you_mean
from fraexp.execution.executors.limits import ResourceLimits
from fraexp.execution.executors.workers import Answer, WorkerLostError, Workers

__all__ = ["Answer", "ResourceLimits", "WorkerLostError", "Workers", "make", "usable_cores", "workers_of"]

MOST_WORKERS = 512
KINDS = ("serial", "processes", "dask")


def make(name: str, jobs: int, limits: ResourceLimits | None = None) -> Workers:
    """Return the workers of an executor such as ``serial`` or ``processes:4`` for at most `jobs` jobs at a time."""
    count = min(workers_of(name), max(jobs, 1))
    limits = limits or ResourceLimits()
    limits.check(name)
    if name == "serial":
        from fraexp.execution.executors.serial import Serial

        return Serial(limits)
    if name.startswith("dask:"):
        from fraexp.execution.executors.dask import Dask

        return Dask(name, limits)
    from fraexp.execution.executors.processes import Processes

    return Processes(count, limits)


def workers_of(name: str) -> int:
    """Return how many jobs an executor such as ``serial`` or ``processes:4`` runs at once; StudyError for others.

    A cluster, ``dask:ADDRESS``, is not asked: it counts as one until it has been connected to.
    """
    kind, _, number = name.partition(":")
    if kind == "serial" and not number:
        return 1
    if kind == "dask":
        from fraexp.execution.executors.dask_place import check_name

        check_name(name)
        return 1
    if kind != "processes":
        raise StudyError(f"there is no executor '{name}'{did_you_mean(kind, KINDS)}")
    if number and (not number.isdecimal() or not 1 <= int(number) <= MOST_WORKERS):
        raise StudyError(f"executor '{name}': expected a number from 1 to {MOST_WORKERS}, such as processes:4")
    return int(number) if number else usable_cores()


def usable_cores() -> int:
    """Return the number of processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
