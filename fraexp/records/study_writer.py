"""The study that ``fraexp import`` writes: measured records, their channels, and the estimators that analyse them."""

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from fraexp.components.kinds import Estimator
from fraexp.components.registry import Registry
from fraexp.data import toml
from fraexp.data.atomic_file import atomic_file
from fraexp.data.identity import hash_bytes
from fraexp.errors import StudyError, did_you_mean
from fraexp.records.record_settings import INJECTED_CHANNELS
from fraexp.records.stated_response import INPUT, OUTPUT, is_response

CHANNEL_ROLES = {"input": "first", "thrust": "first", "force": "first", "output": "second", "displacement": "second"}
"""Parameters of estimators that name a channel, and which of a record's channels they are given."""
PERIODIC_ESTIMATOR = "conventional"
AVERAGING_ESTIMATOR = "best_linear_approximation"
"""The estimator of several realisations, levels or periods."""


@dataclass(frozen=True)
class ImportRequest:
    """The records to import, their channels, and how to analyse them."""

    files: Sequence[Path]
    channels: Mapping[str, object]
    """Column of each channel by its name, or the settings of the channel.

    The first channel is the input; the others are outputs, except for those named reference or excitation.
    """
    options: Mapping[str, object] = field(default_factory=dict)
    """Keys of the section [record]."""
    estimators: Sequence[str] = ()
    settings: Sequence[str] = ()
    """Parameters of the estimators, each written as ``estimator.order=2``."""
    levels: Sequence[str | int | float] = ()
    each_file: bool = False
    """Whether each file is a separate experiment; otherwise the files are realisations of one experiment."""

    @property
    def stem(self) -> str:
        """Name of the study: the name of the first file without the braces of its placeholders."""
        return re.sub(r"[{}]", "", self.files[0].stem)


def study_data(request: ImportRequest, folder: Path, registry: Registry) -> dict[str, object]:
    """Return the study, as plain data, that analyses the records of a request and lies in `folder`.

    Raises
    ------
    StudyError : if the input or the output is missing, an estimator is needed, or no estimator has a given parameter.
    """
    outputs = [name for name in request.channels if name not in INJECTED_CHANNELS]
    if is_response(request.channels):
        outputs = [INPUT, OUTPUT]
    elif len(outputs) < 2:
        raise StudyError(
            f"{request.files[0]}: {len(outputs)} channel given; expected an input and an output, such as u=... "
            "and y=..."
        )
    first, *others = outputs
    names = [Path(os.path.relpath(file.absolute(), folder.resolve())).as_posix() for file in request.files]
    file = names[0] if len(names) == 1 or request.each_file else names
    record: dict[str, object] = {"file": file, **request.options, "channels": dict(request.channels)}
    grid: dict[str, object] = {}
    if request.each_file and len(names) > 1:
        grid["record.file"] = names
    if len(request.levels) == 1:
        record["level"] = request.levels[0]
    elif request.levels:
        record["level"] = request.levels[0]
        grid["record.level"] = list(request.levels)
    settings = dict(map(_parse_setting, request.settings))
    chosen = request.estimators or [_default_estimator(request)]
    _check_settings(settings, chosen, registry)
    estimators = [_estimator_spec(name, settings, first, others[0], registry) for name in chosen]
    if len(estimators) > 1:
        grid["estimator"] = estimators
    elif len(others) > 1 and "output" in estimators[0]:
        grid["estimator.output"] = others
    return {
        "title": f"{'Analysis' if request.estimators else 'Frequency response'} of {_files_text(names)}",
        "record": record,
        **({} if len(estimators) > 1 else {"estimator": estimators[0]}),
        **({"grid": grid} if grid else {}),
    }


def _files_text(names: Sequence[str]) -> str:
    return Path(names[0]).name + (f" and {len(names) - 1} more" if len(names) > 1 else "")


def _default_estimator(request: ImportRequest) -> str:
    if request.options.get("periodic", True):
        several = any(request.options.get(key) for key in ("realisations", "segment_column", "periods_per_realisation"))
        joined = len(request.files) > 1 and not request.each_file and not request.options.get("join_files")
        return AVERAGING_ESTIMATOR if several or joined else PERIODIC_ESTIMATOR
    raise StudyError(
        f"{request.files[0]}: a record that does not repeat itself needs --estimator: friction_identification for mass "
        "and friction, local_polynomial for a response; see fraexp plugins"
    )


def _check_settings(settings: Mapping[str, object], estimators: Sequence[str], registry: Registry) -> None:
    components = [registry.provider(Estimator.kind, estimator).component for estimator in estimators]
    known = {name for component in components for name in component.model_fields}
    for path in settings:
        name = path.partition(".")[0]
        if name not in known:
            who = " and ".join(estimators)
            raise StudyError(f"--set estimator.{path}: {who} has no such parameter{did_you_mean(name, known)}")


def _estimator_spec(
    name: str, settings: Mapping[str, object], first: str, second: str, registry: Registry
) -> dict[str, object]:
    """Return an estimator's table: its channels, and those of the settings that are parameters of it."""
    component = registry.provider(Estimator.kind, name).component
    known = component.model_fields
    roles = [role for role in CHANNEL_ROLES if role in known and not (role == "force" and "thrust" in known)]
    if "thrust" in roles and ("force" in settings or first == "friction"):  # measured friction accelerates nothing
        roles.remove("thrust")
    spec: dict[str, object] = {"name": component.name}
    spec |= {role: first if CHANNEL_ROLES[role] == "first" else second for role in roles}
    for path, value in settings.items():
        parts = path.split(".")
        if parts[0] in known:
            _set_nested(spec, parts, value)
    return spec


def _parse_setting(text: str) -> tuple[str, object]:
    path, equals, value = (part.strip() for part in text.partition("="))
    section, _, key = path.partition(".")
    if not equals or section != "estimator" or not key:
        raise StudyError(f"--set {text}: expected estimator.PARAMETER=VALUE, such as estimator.order=2")
    return key, toml.value(value)


def _set_nested(spec: dict[str, object], path: Sequence[str], value: object) -> None:
    for part in path[:-1]:
        inner = spec.setdefault(part, {})
        if not isinstance(inner, dict):
            raise StudyError(f"--set estimator.{'.'.join(path)}: '{part}' is a value; expected a table")
        spec = inner
    spec[path[-1]] = value


def is_same_study(path: Path, data: Mapping[str, object]) -> bool:
    """Return whether a file contains exactly these data."""
    try:
        return toml.loads(path.read_text(encoding="utf-8")) == toml.loads(study_text(data))
    except ValueError:  # it is not TOML, or not text
        return False


def write_study(path: Path, data: Mapping[str, object]) -> None:
    """Write a study as a TOML file, complete or not at all, into a folder that is made; FraexpError if it cannot be."""
    with atomic_file(path, makes_folder=True) as draft:
        draft.write_text(study_text(data), encoding="utf-8")


def renew_study(path: Path, data: Mapping[str, object]) -> Path:
    """Write a study that is written anew each time, and return its file.

    A file that was edited since is kept, and the study is written beside it, as NAME-new.toml.
    """
    while path.exists() and not _is_unedited(path):
        path = path.with_stem(f"{path.stem}-new")
    text = study_text(data)
    with atomic_file(path, makes_folder=True) as draft:
        draft.write_text(f"{_unedited_mark(text)}\n{text}", encoding="utf-8")
    return path


def _is_unedited(path: Path) -> bool:
    """Return whether a file is as it was written."""
    mark, _, text = path.read_bytes().decode(errors="replace").partition("\n")
    return mark == _unedited_mark(text)


def _unedited_mark(text: str) -> str:
    """Return the first line of a file that contains a text, by which it shows that it was not edited."""
    digest = hash_bytes(text.encode()).hex()
    return f"# Each measurement writes this study anew, unless it was edited: digest {digest}"


def study_text(data: Mapping[str, object]) -> str:
    """Return a study as TOML text; StudyError if TOML cannot express it."""
    import tomlkit  # half a second when it is loaded for the first time, and only an import needs it

    try:
        text = tomlkit.dumps(data)
        text.encode()
    except UnicodeEncodeError as error:
        letter = error.object[error.start : error.end]
        raise StudyError(f"a name contains {letter!r}, which is invalid Unicode; rename the file or channel") from None
    except TypeError as error:  # such as None, which TOML does not have
        raise StudyError(f"the study cannot be written as TOML: {error}") from None
    return text
