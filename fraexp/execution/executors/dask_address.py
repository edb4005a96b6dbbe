"""Address of a Dask cluster: as text, or in the file that its scheduler has written; and why it cannot be reached."""

import importlib.util
import json
import re
from pathlib import Path

from fraexp.errors import StudyError

HOST_AND_PORT = re.compile(r"[\w.\-]+:\d+|\[[\da-fA-F:.]+\]:\d+")


def check_executor_name(name: str) -> str:
    """Return the address in an executor's name such as ``dask:tcp://host:8786``; StudyError if it is invalid."""
    address = name.partition(":")[2]
    if not address:
        raise StudyError(f"executor '{name}': expected dask:ADDRESS, such as dask:tcp://host:8786, or dask:FILE")
    if importlib.util.find_spec("distributed") is None:
        raise StudyError(f"executor '{name}' needs Dask, which is not installed: pip install distributed")
    if "://" in address:
        if not re.fullmatch(r"\w+://\S+:\d+", address):
            raise StudyError(f"executor '{name}': expected an address with its port, such as dask:tcp://host:8786")
    elif not HOST_AND_PORT.fullmatch(address):
        scheduler_address(address)
    return address


def scheduler_address(address: str) -> str:
    """Return the scheduler's address; a file is read, in which the scheduler has written it."""
    if "://" in address or HOST_AND_PORT.fullmatch(address):
        return address
    try:
        return str(json.loads(Path(address).read_text(encoding="utf-8"))["address"])
    except OSError as error:
        reason = f"{address}: {error.strerror}; expected dask:tcp://host:port, or a file that dask scheduler writes"
    except (ValueError, KeyError, TypeError):
        reason = f"{address}: this is not a scheduler file; expected what dask scheduler --scheduler-file writes"
    raise StudyError(f"executor 'dask:{address}': {reason}")


def cause_text(error: BaseException | None) -> str:
    """Return the system's reason in brackets; empty after a mere timeout."""
    while error is not None:
        if isinstance(error, OSError) and error.strerror:
            return f" ({error.strerror})"
        error = error.__cause__
    return ""


def first_line(error: object) -> str:
    """Return the first line of an error's text."""
    return next(iter(str(error).splitlines()), "")
