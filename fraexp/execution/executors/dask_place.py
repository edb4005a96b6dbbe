"""Where a Dask cluster is: an address, or the file in which its scheduler has written it; why it is not reached."""

import importlib.util
import json
import re
from pathlib import Path

from fraexp.errors import StudyError

HOST_AND_PORT = re.compile(r"[\w.\-]+:\d+|\[[\da-fA-F:.]+\]:\d+")


def check_name(name: str) -> str:
    """Return the place in an executor's name such as ``dask:tcp://host:8786``; StudyError if it cannot be one."""
    place = name.partition(":")[2]
    if not place:
        raise StudyError(f"executor '{name}': expected dask:ADDRESS, such as dask:tcp://host:8786, or dask:FILE")
    if importlib.util.find_spec("distributed") is None:
        raise StudyError(f"executor '{name}' needs Dask, which is not installed: pip install 'fraexp[dask]'")
    if "://" in place:
        if not re.fullmatch(r"\w+://\S+:\d+", place):
            raise StudyError(f"executor '{name}': expected an address with its port, such as dask:tcp://host:8786")
    elif not HOST_AND_PORT.fullmatch(place):
        address_of(place)
    return place


def address_of(place: str) -> str:
    """Return the scheduler's address, from the file that it has written if `place` is one."""
    if "://" in place or HOST_AND_PORT.fullmatch(place):
        return place
    try:
        return str(json.loads(Path(place).read_text(encoding="utf-8"))["address"])
    except OSError as error:
        reason = f"{place}: {error.strerror}; expected dask:tcp://host:port, or a file that dask scheduler writes"
    except (ValueError, KeyError, TypeError):
        reason = f"{place}: it is no scheduler file; expected what dask scheduler --scheduler-file writes"
    raise StudyError(f"executor 'dask:{place}': {reason}")


def cause(error: BaseException | None) -> str:
    """Return in brackets what the system said; empty if it just took too long."""
    while error is not None:
        if isinstance(error, OSError) and error.strerror:
            return f" ({error.strerror})"
        error = error.__cause__
    return ""


def first_line(error: BaseException) -> str:
    """Return the first line of what an error says."""
    return next(iter(str(error).splitlines()), "")
