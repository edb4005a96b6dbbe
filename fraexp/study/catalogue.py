"""The studies that there are: those of a workspace, then the examples that come along."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

from fraexp.errors import FraexpError
from fraexp.study.study_file import describe_study, packaged_studies, read, study_name

FIRST_STUDY = "quick"
"""The study to begin with."""


@dataclass(frozen=True)
class StudyEntry:
    """A study's file, read but not resolved."""

    name: str
    file: Path
    title: str
    question: str
    error: str = ""
    """What is wrong with the file; empty if it can be read."""
    data: Mapping[str, Any] = field(default_factory=dict, compare=False)
    """What the file says."""
    stamp: int = 0
    """Changes when the file does."""

    @property
    def size(self) -> int:
        """Number of points that the file asks for, before what comes to the same is left out."""
        grid, random, cases = (self.data.get(key) for key in ("grid", "monte_carlo", "case"))
        axes = [len(of) for of in grid.values() if isinstance(of, list)] if isinstance(grid, Mapping) else []
        draws = random.get("count") if isinstance(random, Mapping) else 1
        return (
            math.prod(axes)
            * (draws if isinstance(draws, int) else 1)
            * (len(cases) if isinstance(cases, list) and cases else 1)
        )


def catalogue(folder: Path) -> list[StudyEntry]:
    """Return all studies of a workspace and of the package: the quick one first, then by name."""
    roots = (folder / "studies", packaged_studies())
    files: dict[str, Path] = {}
    for root in roots:
        for file in sorted(root.rglob("*.toml")):
            if file.parent.name != "machines" and not file.is_dir():
                files.setdefault(study_name(file, roots), file)  # a workspace's own hides one that comes along
    ordered = sorted(files, key=lambda name: (name != FIRST_STUDY, "/" in name, name))
    return [_entry(name, files[name], _stamp(files[name])) for name in ordered]


def _stamp(file: Path) -> int:
    try:
        return file.stat().st_mtime_ns
    except OSError:
        return 0  # gone meanwhile, which reading it tells


@lru_cache(4096)
def _entry(name: str, file: Path, stamp: int) -> StudyEntry:
    try:
        data = read(file)
        listed = {key: value for key, value in data.items() if key != "published"}  # whose units take half a second
        study = describe_study(name, file, listed)
    except FraexpError as error:
        return StudyEntry(name, file, name, "", str(error), stamp=stamp)
    return StudyEntry(name, file, study.title, study.question, data=data, stamp=stamp)
