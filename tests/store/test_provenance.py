import json
import shutil
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

from fraexp.execution import provenance


def gathered_in(checkout: Path, **environment: str) -> dict:
    code = "import json; from fraexp import provenance; print(json.dumps(provenance.gather_provenance()))"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=checkout, env=environment, capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout)


@pytest.fixture
def checkout(tmp_path):
    """Return a folder with a copy of the module in a package of its own."""
    (tmp_path / "fraexp").mkdir()
    (tmp_path / "fraexp" / "__init__.py").touch()
    shutil.copy(provenance.__file__, tmp_path / "fraexp")
    return tmp_path


def git(folder: Path, *arguments: str) -> str:
    named = ("-c", "user.name=A", "-c", "user.email=a@example.org")
    command = ["git", *named, *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True).stdout.strip()


def test_it_is_plain_data():
    found = provenance.gather_provenance()
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert found["python"]["version"] == sys.version.split()[0]
    assert found["machine"]["cores"] >= found["machine"]["usable_cores"] >= 1


def test_packages_are_named_with_their_versions_but_not_imported():
    code = """
import sys
from fraexp.execution import provenance
print(provenance.gather_provenance()["packages"]["numpy"], "numpy" in sys.modules)
"""
    root = Path(provenance.__file__).parents[1]
    done = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True)
    assert done.stdout.split() == [version("numpy"), "False"]


@pytest.mark.skipif(shutil.which("git") is None, reason="needs git")
def test_the_commit_and_what_differs_from_it_are_told(checkout):
    path = {"PATH": str(Path(shutil.which("git") or "").parent)}
    assert gathered_in(checkout, **path)["git"] is None
    git(checkout, "init")
    assert gathered_in(checkout, **path)["git"] == {"commit": None, "dirty": True}
    (checkout / ".gitignore").write_text("__pycache__/\n")
    git(checkout, "add", ".")
    git(checkout, "commit", "-m", "first")
    assert gathered_in(checkout, **path)["git"] == {"commit": git(checkout, "rev-parse", "HEAD"), "dirty": False}
    (checkout / "studies").mkdir()
    (checkout / "studies" / "own.toml").touch()  # no code
    assert gathered_in(checkout, **path)["git"]["dirty"] is False
    (checkout / "fraexp" / "new.py").touch()
    assert gathered_in(checkout, **path)["git"]["dirty"] is True
    assert gathered_in(checkout, PATH="")["git"] is None  # no git to ask
