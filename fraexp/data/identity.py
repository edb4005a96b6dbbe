"""Identity of plain data and of files: hashes of canonical JSON and of content."""

import hashlib
import json
from contextlib import suppress
from pathlib import Path
from typing import Any

TAG = "fx2"
"""Names how keys are made, so that a later change shows."""
HASH_BYTES = 20
FileStamp = tuple[int, int]
"""Time of the last change [ns] and size of a file."""


def canonical(data: Any) -> str:
    """Return the one JSON text of plain data: sorted keys, no spaces, no NaN."""
    return json.dumps(data, sort_keys=True, separators=(",", ":"), allow_nan=False, ensure_ascii=True)


def digest_of(data: Any) -> bytes:
    """Return the hash of plain data, 20 bytes."""
    return hash_bytes(canonical(data).encode())


def hash_bytes(content: bytes) -> bytes:
    """Return the hash (blake2b-160) of bytes, 20 bytes."""
    return hashlib.blake2b(content, digest_size=HASH_BYTES).digest()


def key_of(data: Any) -> str:
    """Return the content key of plain data, such as ``fx2-3f9c...`` (44 characters)."""
    return f"{TAG}-{digest_of(data).hex()}"


def content_hash(content: bytes) -> str:
    """Return the content hash of a file that has been read."""
    return hash_bytes(content).hex()


def file_hash(path: Path) -> str:
    """Return the content hash of a file."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, lambda: hashlib.blake2b(digest_size=HASH_BYTES)).hexdigest()


def file_stamps(folder: Path) -> dict[str, FileStamp]:
    """Return the stamps of the Python files of a folder, by name."""
    stamps = {}
    with suppress(OSError):  # deleted meanwhile: the next look finds out
        for file in folder.glob("*.py"):
            state = file.stat()
            stamps[file.name] = (state.st_mtime_ns, state.st_size)
    return stamps


def key_heads(prefix: str) -> list[str]:
    """Return how keys begin that a user means by a prefix, with or without its tag; none if no key begins so."""
    head = prefix.strip().lower()
    whole = [head] if head.startswith(TAG) or f"{TAG}-".startswith(head) else []
    is_hexadecimal = not set(head) - set("0123456789abcdef")
    return [*whole, *([f"{TAG}-{head}"] if is_hexadecimal else [])]
