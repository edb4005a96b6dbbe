from pathlib import Path

import pytest

import fraexp

POINTS = 6
"""Frequencies of the responses: as few as show what they should."""


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A workspace whose run 1 is of the study quick; a test that adds runs of it takes a folder of its own."""
    folder = tmp_path_factory.mktemp("interface")
    fraexp.Workspace(folder).run("quick", {"excitation.points": POINTS}, executor="serial", progress=False)
    return folder


@pytest.fixture
def workspace(folder: Path) -> fraexp.Workspace:
    return fraexp.Workspace(folder)


@pytest.fixture
def run(workspace: fraexp.Workspace) -> fraexp.Run:
    return workspace.open_run(1)
