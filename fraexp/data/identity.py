"""Identity of plain data: a tagged hash of its canonical JSON, and of source files."""

import hashlib
import json
from pathlib import Path
from typing import Any

TAG = "fx1"
"""Names the algorithm (blake2b-160 of canonical JSON), so that a later change is detectable."""
SIZE = 20
"""Bytes of a key."""


def canonical(data: Any) -> str:
    """Return the one JSON text of plain data: sorted keys, no spaces, no NaN."""
    return json.dumps(data, sort_keys=True, separators=(",", ":"), allow_nan=False, ensure_ascii=True)


def key_of(data: Any) -> str:
    """Return the content key of plain data, such as ``fx1-3f9c...`` (44 characters)."""
    digest = hashlib.blake2b(canonical(data).encode(), digest_size=SIZE).hexdigest()
    return f"{TAG}-{digest}"


def file_hash(path: Path) -> str:
    """Return the content hash of a file."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, lambda: hashlib.blake2b(digest_size=SIZE)).hexdigest()
