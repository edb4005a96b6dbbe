"""Files that inflate, and headers that claim more than there is."""

import io
import struct
import zipfile
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

import h5py
import numpy as np

from fraexp.components.registry import Registry
from fraexp.store.codec import NPY_MAGIC, decode_array
from tests.fuzz import files, mutation
from tests.fuzz.watching import Target
from tests.records.corpus_writers import uff_response

CLAIMS = (10 * 2**30, 2**31 - 1, 2**32 - 1, 2**40, 2**62, 2**63 - 1)
"""Bytes or elements that a header claims."""
INFLATED_BYTES = 64 * 2**20
"""Bytes of zeros to which a bomb inflates really."""
DOUBLE_CLASS, DOUBLE_TYPE, INT8_TYPE, INT32_TYPE, UINT32_TYPE, MATRIX_TYPE, COMPRESSED_TYPE = 6, 9, 1, 5, 6, 14, 15


def targets(folder: Path, registry: Registry) -> list[Target]:
    """Return the readers of files that claim or inflate."""
    bombs = [zlib.compress(bytes(INFLATED_BYTES), 9)]
    return [
        Target("MATLAB claims", partial(_matlab, bombs), partial(_read, folder, registry, "claim.mat"), 0.002),
        Target("HDF5 claims", partial(_hdf5, folder), partial(_read, folder, registry, "claim.mat"), 0.001),
        Target("array claims", _array, decode_array, 0.02),
        Target("universal and zip", _others(folder), partial(_read_any, folder, registry), 0.003),
    ]


def _element(kind: int, data: bytes, size: int | None = None) -> bytes:
    """Return an element of a MATLAB 5 file, which may claim another size."""
    return struct.pack("<II", kind, (len(data) if size is None else size) & 0xFFFFFFFF) + data + bytes(-len(data) % 8)


def _matlab(bombs: list[bytes], rng: Random) -> bytes:
    """Return a MATLAB 5 or 4 file whose array claims more than there is, or inflates."""
    claim = rng.choice(CLAIMS)
    rows = min(claim // 8, 2**31 - 1)
    if rng.random() < 0.2:
        return struct.pack("<5i", 0, rows, rng.choice((1, 8)), 0, 2) + b"t\0" + bytes(8 * rng.randrange(100))
    shape = _element(INT32_TYPE, struct.pack("<2i", rows, rng.choice((1, 2))))
    head = _element(UINT32_TYPE, struct.pack("<2I", DOUBLE_CLASS, 0)) + shape + _element(INT8_TYPE, b"t")
    values = bytes(8 * rng.randrange(200))
    array = _element(MATRIX_TYPE, head + _element(DOUBLE_TYPE, values, rng.choice((None, claim))))
    if rng.random() < 0.5:
        array = _element(COMPRESSED_TYPE, zlib.compress(array) if rng.random() < 0.9 else rng.choice(bombs))
    header = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
    return mutation.octets(rng, header + array, [array]) if rng.random() < 0.3 else header + array


def _hdf5(folder: Path, rng: Random) -> bytes:
    """Return an HDF5 file with datasets that claim 10 GB and more, chunked, compressed or not."""
    file = folder / "claims.h5"
    count = rng.choice(CLAIMS[:4]) // 8
    with h5py.File(file, "w", userblock_size=512) as made:
        options: dict[str, Any] = rng.choice(({}, {"chunks": (1024,)}, {"chunks": (1024,), "compression": "gzip"}))
        made.create_dataset(rng.choice(("t", "u", "big")), (count,), float, **options)
        made["y"] = np.arange(rng.randrange(1, 50), dtype=float)
    data = file.read_bytes()
    return mutation.octets(rng, data, [data]) if rng.random() < 0.5 else data


def _array(rng: Random) -> bytes:
    """Return a stored array whose header claims a shape that its bytes do not have."""
    sizes = [rng.choice((*CLAIMS, -1, 0, 2**70, 10**30)) for _ in range(rng.randrange(1, 4))]
    kind = rng.choice(("<f8", "<c16", "|b1", "|O", "<U1000000000", "|V2147483647"))
    layout = f"{{'descr':{kind!r},'fortran_order':False,'shape':({','.join(map(str, sizes))},)}}\n".encode()
    claimed = rng.choice((len(layout), 65535, 0, len(layout) + 1))
    return NPY_MAGIC + claimed.to_bytes(2, "little") + layout + bytes(rng.randrange(200))


def _others(folder: Path) -> Callable[[Random], tuple[str, bytes]]:
    """Return what makes universal files, archives of arrays, and archives under other names."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("t.npy", bytes(INFLATED_BYTES))
    uff_response(folder)
    seeds = [packed.getvalue(), (folder / "a.unv").read_bytes()]
    names = ("a.unv", "a.uff", "a.npz", "a.zip", "a.csv", "a.mat", "a.h5", "a.txt")
    return lambda rng: (rng.choice(names), mutation.octets(rng, rng.choice(seeds), seeds))


def _read(folder: Path, registry: Registry, name: str, data: bytes) -> None:
    files.read_file(folder, registry, name, data)


def _read_any(folder: Path, registry: Registry, made: tuple[str, bytes]) -> None:
    files.read_file(folder, registry, *made)
