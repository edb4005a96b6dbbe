"""The folder of files that can be made again and are worth keeping: compiled kernels."""

import os
from pathlib import Path

from platformdirs import user_cache_path

CACHE_FOLDER_VARIABLE = "FRAEXP_CACHE_DIR"
"""Environment variable that names another folder."""


def cache_folder() -> Path:
    """Return the user's cache folder; it may be missing or read-only."""
    given = os.environ.get(CACHE_FOLDER_VARIABLE)
    return Path(given) if given else user_cache_path("fraexp")
