"""Where jobs run: in this process, in processes of their own, or on a cluster."""

from fraexp.errors import StudyError, did_you_mean
from fraexp.execution.executors.limits import ResourceLimits
from fraexp.execution.executors.workers import Answer, WorkerLostError, Workers
from fraexp.execution.provenance import usable_cores

__all__ = ["Answer", "ResourceLimits", "WorkerLostError", "Workers", "create_workers", "usable_cores", "worker_count"]

MAX_WORKERS = 512
KINDS = ("serial", "processes", "dask")


def create_workers(name: str, jobs: int, limits: ResourceLimits | None = None) -> Workers:
    """Return the workers of an executor such as ``serial`` or ``processes:4``: no more than there are `jobs`."""
    count = min(worker_count(name), max(jobs, 1))
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


def worker_count(name: str) -> int:
    """Return how many jobs an executor such as ``serial`` or ``processes:4`` computes at the same time.

    A cluster, ``dask:ADDRESS``, counts as one worker until it has been connected to. StudyError for other names.
    """
    kind, _, number = name.partition(":")
    if kind == "serial" and not number:
        return 1
    if kind == "dask":
        from fraexp.execution.executors.dask import check_executor_name

        check_executor_name(name)
        return 1
    if kind != "processes":
        raise StudyError(f"there is no executor '{name}'{did_you_mean(kind, KINDS)}")
    if number and (not number.isdecimal() or not 1 <= int(number) <= MAX_WORKERS):
        raise StudyError(f"executor '{name}': expected a number from 1 to {MAX_WORKERS}, such as processes:4")
    return int(number) if number else usable_cores()
