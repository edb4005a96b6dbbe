"""The folder for what is made once per machine and can be made again: measured speeds, compiled kernels."""

import os
from pathlib import Path

from platformdirs import user_cache_path

VARIABLE = "FRAEXP_CACHE_DIR"
"""Environment variable that names another folder."""


def cache_folder() -> Path:
    """Return the folder of the user's cache; it may be missing, or not writable."""
    given = os.environ.get(VARIABLE)
    return Path(given) if given else user_cache_path("fraexp")
