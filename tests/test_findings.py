"""No code reads a sentence: what is said of a result or an error is data, and views make words of it."""

import re
from pathlib import Path

from fraexp.data.findings import Finding

ROOT = Path(__file__).parent.parent
READ = re.compile(
    r"""["'\w\])]\s+(?:not\s+)?in\s+(?:str\(error\)|\w+\.message\b|(?:message|reason|sentence)\b(?!s))"""
    r"""|(?:str\(error\)|\.message|\b(?:message|sentence))\.(?:startswith|endswith|partition|replace|removeprefix)\(|str\(error\)\.split\(["']"""
    r"""|\bre\.\w+\([^\n]*,\s*(?:str\(error\)|\w+\.message|message)\)"""
)
"""A condition on, or a change of, what a message or an error says."""
FOREIGN = {
    "fraexp/kernels/law.py", "fraexp/store/backends/engine.py", "fraexp/store/backends/postgresql.py",
    "fraexp/store/backends/sqlite.py", "fraexp/store/damage.py", "fraexp/execution/executors/dask.py",
    "fraexp/components/parameters.py", "fraexp/store/store.py", "fraexp/interface/study_source.py",
}  # fmt: skip
"""Modules that read what compiler, database, Dask or pydantic say, which have nothing else to offer, and those that put
another place before an error of their own."""


def test_a_finding_of_another_version_is_one_line_with_all_that_it_says():
    found = Finding.from_plain({"kind": "worn belt", "quantities": [[2.0, "m", "length", None]], "frequencies": [3.0]})
    assert str(found) == "finding 'worn belt' of another version of fraexp at 3 Hz: length 2 m"
    assert Finding.from_plain(found.plain()) == found


def test_no_module_reads_a_sentence():
    files = [file for folder in ("fraexp", "plugins") for file in (ROOT / folder).rglob("*.py")]
    found = {
        f"{name}: {line.strip()}"
        for file in files
        if (name := str(file.relative_to(ROOT))) not in FOREIGN
        for line in file.read_text("utf-8").splitlines()
        if READ.search(line.partition("  #")[0]) and r'"\n" not in' not in line  # that an error is one line is checked
    }
    assert len(files) > 400
    assert sorted(found) == []
