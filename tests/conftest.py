"""What all tests share: the checkout, the installed components, and how hypothesis searches."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

from fraexp.plugins import Registry, discover

# The first example compiles the law, so that no deadline fits; elsewhere a search that differs each time finds more.
settings.register_profile("local", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True, print_blob=True)
settings.load_profile("ci" if os.environ.get("CI") else "local")
# What tests teach about the machine's speed is not for the user's own runs.
os.environ.setdefault("FRAEXP_CACHE_DIR", str(Path(__file__).parents[1] / ".pytest_cache" / "fraexp"))


@pytest.fixture(scope="session")
def checkout() -> Path:
    """The root of the checkout."""
    return Path(__file__).parents[1]


@pytest.fixture(scope="session")
def registry() -> Registry:
    """All installed components."""
    return discover()
