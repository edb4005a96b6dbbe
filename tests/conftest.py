"""What all tests share: the checkout, the installed components, and how hypothesis searches."""

import gc
import os
import sys
from collections.abc import Generator
from functools import cache
from pathlib import Path

# Each test process has a processor to itself: the threads of linear algebra would only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from hypothesis import settings

from fraexp.components import registry as plugins
from fraexp.components.registry import Registry, discover
from fraexp.execution import provenance
from tests.examples import QUICK, THOROUGH

# The first example compiles the law, so that no deadline fits; elsewhere a search that differs each time finds more.
COMMON = settings(deadline=None, **({"derandomize": True, "print_blob": True} if os.environ.get("CI") else {}))
settings.register_profile("quick", COMMON, max_examples=QUICK)
settings.register_profile("thorough", COMMON, max_examples=THOROUGH)
settings.load_profile("quick")


ALLOCATION_THRESHOLD = 20_000
"""Allocations until a collection of new objects: by default hundreds, which takes an eighth of all processor time."""


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Spare the garbage collector what is imported for all tests, and look less often for what tests leave behind."""
    gc.disable()
    gc.set_threshold(ALLOCATION_THRESHOLD, 10, 10)
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the tests that take longest, so that no process is left alone with one at the end."""
    items.sort(key=lambda item: (item.get_closest_marker("thorough") is None, "/docs/" not in item.nodeid))


# What tests compile, and teach about the machine's speed, is not for the user's own runs.
os.environ.setdefault("FRAEXP_CACHE_DIR", str(Path(__file__).parents[1] / ".pytest_cache" / "fraexp"))

# Each run asks git for the state of the code, which is the same for all tests.
provenance._git_state = cache(provenance._git_state)

# Each look for plugins reads what all installed packages say of themselves.
entries = cache(lambda group, path, read=plugins.entry_points: read(group=group))
plugins.entry_points = lambda group: entries(group, tuple(sys.path))


@pytest.fixture(scope="session")
def checkout() -> Path:
    """The root of the checkout."""
    return Path(__file__).parents[1]


@pytest.fixture(scope="session")
def registry() -> Registry:
    """All installed components."""
    return discover()
