"""Kernels as machine code: compiled once on a machine, kept in the user's cache folder, and loaded from there.

Numba's own cache lies beside the sources and knows a function by its place there. Here a file is named after a hash of
all that decides on the machine code, so that all checkouts and processes of a machine share it.
"""

import contextlib
import hashlib
import itertools
import os
import pickle
import platform
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import numba
from numba import njit
from numba.core.bytecode import FunctionIdentity
from numba.core.caching import _Cache
from numba.core.compiler import CompileResult
from numba.core.registry import cpu_target
from numba.core.serialize import dumps

from fraexp.kernels.announcement import announce
from fraexp.kernels.cache_folder import cache_folder

try:
    import fcntl
except ImportError:  # Windows: two processes may then compile the same kernel, which costs time and nothing else
    fcntl = None  # type: ignore[assignment]

DIGEST_SIZE = 32
"""Bytes of the hash that stands before the machine code in its file."""
DAY_S = 86400.0
UNUSED_S = 90 * DAY_S
"""Time after which a kernel that nobody has loaded is deleted [s]."""


def _count_functions_apart() -> None:
    """Let this process name what it compiles as no other process does.

    Numba counts the functions that a process compiles and makes the number part of their symbols. Machine code that
    several processes have compiled meets in one, where equal symbols would be one function: another law would answer.
    """
    FunctionIdentity._unique_ids = itertools.count(int.from_bytes(os.urandom(6), "big") << 16)


_count_functions_apart()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_count_functions_apart)


class _File(_Cache):
    """A file with the machine code of one function; numba asks it before it compiles, and tells it afterwards."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @property
    def cache_path(self) -> str:
        return str(self.path.parent)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        target_context.refresh()
        try:
            stored = self.path.read_bytes()
            code = stored[DIGEST_SIZE:]
            if _digest(code) != stored[:DIGEST_SIZE]:  # a single wrong bit may crash what runs it
                return None
            return CompileResult._rebuild(target_context, *pickle.loads(code))  # type: ignore[no-untyped-call]
        except Exception:  # not there, or of no use: compile
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        if not data.library.has_dynamic_globals:  # such as an address in this process
            code = dumps(data._reduce())  # type: ignore[no-untyped-call]
            _write(self.path, _digest(code) + code)

    def enable(self) -> None:
        """It always is."""

    def disable(self) -> None:
        """It never is."""

    def flush(self) -> None:
        self.path.unlink(missing_ok=True)


def _digest(code: bytes) -> bytes:
    return hashlib.blake2b(code, digest_size=DIGEST_SIZE).digest()


def compile_kernel(name: str, source: str, make: Callable[[], Any], signature: tuple[Any, ...], **options: Any) -> Any:
    """Return a compiled function: from the cache, or made, compiled and cached.

    Parameters
    ----------
    name
        What it is, for people.
    source
        A hash of the sources behind it.
    make
        Returns the Python function.
    signature
        Types of its arguments.
    options
        Of the compiler.

    """
    identity = "\n".join((name, source, str(signature), str(sorted(options.items())), *_toolchain()))
    path = cache_folder() / "kernels" / f"{hashlib.blake2b(identity.encode(), digest_size=16).hexdigest()}.kernel"
    kernel = njit(nogil=True, **options)(make())
    kernel._cache = _File(path)
    if path.exists():
        _touch(path)
        kernel.compile(signature)
        return kernel
    with _alone(path):
        if not path.exists():
            announce()
        kernel.compile(signature)
    return kernel


@cache
def address(kernel: Any) -> int:
    """Return the address of a compiled function of one signature, which other compiled code can call."""
    result = next(iter(kernel.overloads.values()))
    return int(result.library.get_pointer_to_function(result.fndesc.llvm_func_name))


@cache
def _toolchain() -> tuple[str, ...]:
    """Return what decides, beside the sources, on the machine code: compiler, interpreter and processor."""
    processor = cpu_target.target_context.codegen().magic_tuple()
    return numba.__version__, llvmlite.__version__, platform.python_version(), str(processor)


@contextlib.contextmanager
def _alone(path: Path) -> Iterator[None]:
    """Hold the lock of a kernel: what another process compiles just now is waited for, not compiled as well."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        lock = path.with_suffix(".lock").open("wb")
    except OSError:  # no folder can be written, as in a container
        yield
        return
    with lock:
        if fcntl is not None:
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield
        path.with_suffix(".lock").unlink(missing_ok=True)


def _write(path: Path, content: bytes) -> None:
    """Write a file whole or not at all, and delete those that nobody has used for long."""
    with contextlib.suppress(OSError):
        with tempfile.NamedTemporaryFile(dir=path.parent, prefix=path.stem, delete=False) as part:
            part.write(content)
        Path(part.name).replace(path)
        for other in path.parent.iterdir():
            if time.time() - other.stat().st_mtime > UNUSED_S:
                other.unlink(missing_ok=True)


def _touch(path: Path) -> None:
    """Let a kernel count as used."""
    with contextlib.suppress(OSError):
        if time.time() - path.stat().st_mtime > DAY_S:
            os.utime(path)
