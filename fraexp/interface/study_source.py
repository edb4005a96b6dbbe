"""A study written in Python, with the keys that a TOML file has."""

import copy
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from pathlib import Path
from typing import Any

import numpy as np

from fraexp.components.kinds import Component
from fraexp.components.parameters import example_call
from fraexp.components.registry import Registry
from fraexp.data import toml
from fraexp.errors import FraexpError, StudyError
from fraexp.interface.argument_checks import is_there, require_path, require_text
from fraexp.interface.callable_law import FrictionLaw
from fraexp.interface.html import page_part
from fraexp.records.study_writer import study_text, write_study
from fraexp.study import study_file
from fraexp.study.sections import COMPONENTS
from fraexp.study.study_file import ResolvedStudy

NAME_PATTERN = re.compile(r"[^\W_][\w.-]*(/[^\W_][\w.-]*)*")
"""Names of studies: they become names of files."""
MAX_NAME_LENGTH = 100
"""Letters of a name, and of each folder in it: a file system takes 255 bytes, of which endings and signs take some."""
RECORD_FILE = "record.file"
"""Path of the record's file in a grid."""


class Study:
    """A study as Python values: the same keys as in TOML, the same sweeps, the same reuse.

    StudyError if a name or a value cannot stand in a study; sections are checked when the study is run or planned.

    Parameters
    ----------
    name
        Name under which its runs and figures appear.
    folder
        Folder from which relative paths of records start; by default the current one.
    keys
        Sections and keys of a study, such as ``machine="linear_motor_table"``,
        ``excitation={"name": "stepped_sine"}``, ``grid={"excitation.amplitude": [12.0, 75.0]}`` or ``case=[...]``. A
        component is a table, its name alone, or an object such as a `FrictionLaw`; numbers may be numpy's.
    """

    def __init__(self, name: str = "study", folder: str | Path = ".", **keys: Any) -> None:
        if not NAME_PATTERN.fullmatch(require_text(name, "study name")):
            raise StudyError(
                f"study name {name!r:.60}: expected letters, digits, '.', '_' and '-', such as 'amplitudes'"
            )
        if max(map(len, name.split("/"))) > MAX_NAME_LENGTH:
            raise StudyError(
                f"study name {name[:20]!r}... has {len(name)} letters; expected {MAX_NAME_LENGTH} or fewer"
            )
        self.name, self.folder = name, require_path(folder, "folder")
        self.classes = session_classes(keys)
        """Classes of the components that are given as objects."""
        self.data: dict[str, Any] = {key: _section(key, value) for key, value in keys.items()}
        """All keys as plain data."""

    @classmethod
    def from_toml(cls, text: str, name: str = "study", folder: str | Path = ".") -> "Study":
        """Return the study in a TOML text; StudyError if it is no TOML."""
        try:
            return cls(name, folder, **toml.loads(require_text(text, "text")))
        except ValueError as error:
            raise StudyError(f"{name}: is no valid TOML: {error}") from None

    @classmethod
    def from_file(cls, path: str | Path) -> "Study":
        """Return the study in a TOML file, to be changed and run."""
        file = require_path(path, "path")
        return cls(re.sub(r"[^\w.-]", "_", file.stem), file.parent, **study_file.read(file))

    def to_toml(self) -> str:
        """Return the study as TOML text."""
        return study_text(self.data)

    def save(self, path: str | Path, force: bool = False) -> Path:
        """Write the study as a TOML file and return its path; paths of records are rewritten to start there.

        A name without an ending gets ``.toml``. StudyError if it has another one, if the file exists and `force` is not
        set, or if it cannot be written.
        """
        file = require_path(path, "path")
        if file.name in ("", ".."):
            raise StudyError(f"'{file}' is no name of a file; expected one such as studies/{self.name}.toml")
        file = file if file.suffix else file.with_name(f"{file.name}.toml")
        if file.suffix != ".toml":
            raise StudyError(f"{file}: '{file.suffix}' is no ending of a study; expected {file.stem}.toml")
        if is_there(file) and not force:
            raise StudyError(f"{file}: the file exists; give force=True to replace it, or another name")
        data = _move_records(self.data, lambda record: _path_from(self.folder / record, file.parent))
        write_study(file, data)
        return file

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Study) and self.data == other.data

    __hash__ = None  # type: ignore[assignment]  # its data can be changed

    def __repr__(self) -> str:
        return f"<Study {self.name!r}: {', '.join(self.data)}>"

    def _repr_html_(self) -> str:
        return page_part(f"Study {self.name}", text=self.to_toml())


def plain_value(value: Any) -> Any:
    """Return a Python value as TOML has it: numpy's numbers and arrays, tuples, paths and components are converted."""
    match value:
        case type() if issubclass(value, Component):
            raise StudyError(f"found the class {value.__name__}; expected an object: {example_call(value)}")
        case FrictionLaw() | Component():
            return (value.model if isinstance(value, FrictionLaw) else value).spec()
        case _ if hasattr(value, "__array__"):  # arrays and numbers of numpy, pandas and xarray
            return np.asarray(value).tolist()
        case Path():
            return value.as_posix()
        case Mapping():
            return {str(key): plain_value(item) for key, item in value.items() if item is not None}
        case list() | tuple() | range():
            return [plain_value(item) for item in value]
        case str() | bool() | int() | float():
            return value
    remedy = "; put its values into a list" if isinstance(value, Iterator | Set) else ""
    raise StudyError(
        f"a study cannot contain {value!r:.60}; expected numbers, texts, lists, tables or components{remedy}"
    )


def resolve_study(
    study: Study, folder: Path, registry: Registry, overrides: Sequence[str] = (), place: str = ""
) -> ResolvedStudy:
    """Return a study with every point of its grid; StudyError or ParameterError says what does not fit.

    They name `place`, by default the study, where those of a study file name the file.
    """
    file = study.folder / f"{study.name}.toml"
    data = _move_records(study.data, lambda record: _path_from(study.folder / record, file.parent))
    try:
        return study_file.resolve(study.name, file, data, folder, registry, overrides)
    except FraexpError as error:
        raise type(error)(str(error).replace(str(file), place or f"Study('{study.name}')")) from None


def component_spec(value: Any) -> dict[str, Any]:
    """Return a component as plain data: a table, a name alone, or an object."""
    plain = plain_value(value)
    if isinstance(plain, str):
        return {"name": plain}
    if not isinstance(plain, dict):
        several = "; call it for each of them, or vary them in the grid of a Study" if isinstance(plain, list) else ""
        raise StudyError(
            f"found {value!r:.60}; expected one component: its name, a table with its name, or an object{several}"
        )
    return plain


def session_classes(value: Any) -> list[type[Component]]:
    """Return the classes of all component objects in a value, each once."""
    match value:
        case FrictionLaw():
            return session_classes(value.model)
        case Component():
            inner = [getattr(value, name) for name in type(value).model_fields]
            return list(dict.fromkeys([type(value), *session_classes(inner)]))
        case Mapping():
            return session_classes(list(value.values()))
        case list() | tuple():
            return list(dict.fromkeys(found for one in value for found in session_classes(one)))
    return []


def _section(key: str, value: Any) -> Any:
    """Return a key's value; the name of a component stands for its table."""
    plain = plain_value(value)
    if key == "grid" and isinstance(plain, Mapping):
        return {path: [_section(path, one) for one in of] if isinstance(of, list) else of for path, of in plain.items()}
    if key == "case":
        if not isinstance(plain, list) or not all(isinstance(case, Mapping) for case in plain):
            raise StudyError(f'case is {value!r:.60}; expected a list of tables, such as [{{"label": "stiff", ...}}]')
        return [{inner: _section(inner, of) for inner, of in case.items()} for case in plain]
    return {"name": plain} if key in COMPONENTS and isinstance(plain, str) else plain


def _path_from(path: Path, base: Path) -> str:
    return Path(os.path.relpath(path.absolute(), base.absolute())).as_posix()


def _move_records(data: Mapping[str, Any], move: Callable[[str], str]) -> dict[str, Any]:
    """Return a study in which the paths of records are replaced, those of cases and of the grid included."""

    def moved_paths(value: Any) -> Any:
        return [move(one) for one in value] if isinstance(value, list) else move(value)

    result = copy.deepcopy(dict(data))
    for sections in [result, *result.get("case", [])]:
        record = sections.get("record")
        if isinstance(record, dict) and "file" in record:
            record["file"] = moved_paths(record["file"])
    grid = result.get("grid")
    if isinstance(grid, dict) and RECORD_FILE in grid:
        grid[RECORD_FILE] = [moved_paths(one) for one in grid[RECORD_FILE]]
    return result


def override_texts(changes: Mapping[str, object]) -> list[str]:
    """Return each change as ``path=value`` with the value as TOML has it."""
    return [f"{path}={toml.dumps(plain_value(value))}" for path, value in changes.items()]
