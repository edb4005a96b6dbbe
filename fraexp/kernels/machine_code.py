"""Kernels as machine code: compiled once on a machine, kept in the user's cache folder, and loaded from there.

Numba's own cache lies beside the sources and identifies a function by its place in them. Here a file is named after a
hash of everything that determines the machine code, so that all checkouts and processes of a machine share it.
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
from numba.core import types
from numba.core.bytecode import FunctionIdentity
from numba.core.caching import _Cache
from numba.core.compiler import CompileResult
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaError
from numba.core.registry import cpu_target
from numba.core.runtime.nrt import rtsys
from numba.core.serialize import dumps

from fraexp.kernels.announcement import announced_compilation
from fraexp.kernels.cache_folder import cache_folder

try:
    import fcntl
except ImportError:  # Windows: two processes may then compile the same kernel, which costs time and nothing else
    fcntl = None  # type: ignore[assignment]

DIGEST_BYTES = 32
"""Size of the hash at the beginning of a kernel's file, before the machine code."""
DAY_S = 86400.0
MAX_UNUSED_S = 90 * DAY_S
"""Time [s] after which a kernel that no process has loaded is deleted."""


def _randomise_function_ids() -> None:
    """Let this process number the functions that it compiles as no other process does.

    Numba counts the functions that a process compiles, and the number is part of their symbols. One process may load
    machine code from several others, where equal symbols would be one function: another law would answer. Numba has no
    public setting for this; `tests/kernels/test_machine_code.py` notices if the private one stops working.
    """
    FunctionIdentity._unique_ids = itertools.count(int.from_bytes(os.urandom(6), "big") << 16)


_randomise_function_ids()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_randomise_function_ids)


class _KernelFile(_Cache):
    """A file with the machine code of one function: numba loads it before it compiles, and saves it afterwards.

    Numba offers no public class for a cache elsewhere than beside the sources; the tests of this module notice a
    change. To load machine code takes what that may call, but not what only the compiler needs, such as all that numba
    knows of numpy and scipy: half of the time to start.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    @property
    def cache_path(self) -> str:
        return str(self.path.parent)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        rtsys.initialize(target_context)
        try:
            stored = self.path.read_bytes()
            code = stored[DIGEST_BYTES:]
            if _digest(code) != stored[:DIGEST_BYTES]:  # a single wrong bit may crash the process
                return None
            return CompileResult._rebuild(target_context, *pickle.loads(code))
        except Exception:  # missing, or from another version: the caller compiles
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        if not data.library.has_dynamic_globals:  # an address of this process means nothing to another
            code = dumps(data._reduce())
            _write_atomically(self.path, _digest(code) + code)

    def enable(self) -> None:
        """Do nothing: the cache is always enabled."""

    def disable(self) -> None:
        """Do nothing: the cache is never disabled."""

    def flush(self) -> None:
        self.path.unlink(missing_ok=True)


def _digest(code: bytes) -> bytes:
    return hashlib.blake2b(code, digest_size=DIGEST_BYTES).digest()


def compile_kernel(
    name: str,
    source: str,
    make: Callable[[], Any],
    signature: tuple[types.Type, ...],
    *,
    is_explained: bool = True,
    **options: Any,
) -> Dispatcher:
    """Return a compiled function: from the cache, or compiled now and cached.

    What the compiler refuses is compiled again, for its error, or with `is_explained` False is refused at once.

    Parameters
    ----------
    name
        Description of the kernel; part of its identity.
    source
        Hash of the sources behind it.
    make
        Returns the Python function to compile.
    signature
        Types of the function's arguments.
    options
        Options of the compiler.

    """
    identity = "\n".join((name, source, str(signature), str(sorted(options.items())), *_toolchain()))
    path = cache_folder() / "kernels" / f"{hashlib.blake2b(identity.encode(), digest_size=16).hexdigest()}.kernel"
    kernel: Any = njit(nogil=True, **options)(make())
    kernel._cache = _KernelFile(path)
    if path.exists():
        _mark_as_used(path)
        kernel.compile(signature)
        return kernel
    refused = path.with_suffix(".refused")
    with _compile_lock(path):
        if refused.exists() and not is_explained:
            raise NumbaError(f"{name}: refused before")
        is_new = not path.exists() and not refused.exists()  # another process may have tried it while this one waited
        try:
            with announced_compilation() if is_new else contextlib.nullcontext():
                kernel.compile(signature)
        except MemoryError:
            raise
        except Exception:  # it fails again in each process, but within a second: nothing to announce
            with contextlib.suppress(OSError):
                refused.touch()
            raise
    return kernel


@cache
def function_address(kernel: Dispatcher) -> int:
    """Return the address of a compiled function of one signature, for other compiled code to call."""
    result: Any = next(iter(kernel.overloads.values()))
    return int(result.library.get_pointer_to_function(result.fndesc.llvm_func_name))


@cache
def _toolchain() -> tuple[str, ...]:
    """Return what determines the machine code beside the sources: compiler, interpreter and processor."""
    processor = cpu_target.target_context.codegen().magic_tuple()
    return numba.__version__, llvmlite.__version__, platform.python_version(), str(processor)


@contextlib.contextmanager
def _compile_lock(path: Path) -> Iterator[None]:
    """Hold the lock of a kernel: wait for a process that compiles it just now, instead of compiling it as well."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        lock = path.with_suffix(".lock").open("wb")
    except OSError:  # a read-only folder, as in a container
        yield
        return
    with lock:
        if fcntl is not None:
            fcntl.flock(lock, fcntl.LOCK_EX)
        try:
            yield
        finally:
            path.with_suffix(".lock").unlink(missing_ok=True)


def _write_atomically(path: Path, content: bytes) -> None:
    """Write a file whole or not at all, and delete the files that no process has used for long."""
    with contextlib.suppress(OSError):
        with tempfile.NamedTemporaryFile(dir=path.parent, prefix=path.stem, delete=False) as part:
            part.write(content)
        Path(part.name).replace(path)
        for other in path.parent.iterdir():
            if time.time() - other.stat().st_mtime > MAX_UNUSED_S:
                other.unlink(missing_ok=True)


def _mark_as_used(path: Path) -> None:
    """Renew the time of a kernel's file, by which unused kernels are found; once a day is enough."""
    with contextlib.suppress(OSError):
        if time.time() - path.stat().st_mtime > DAY_S:
            os.utime(path)
