"""The study that a command line describes: what `fraexp import` writes."""

import json
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fraexp.components.kinds import Estimator
from fraexp.components.registry import Registry
from fraexp.data import toml as toml_file
from fraexp.errors import StudyError, did_you_mean
from fraexp.records.record_settings import INJECTED

ROLES = {"input": "first", "thrust": "first", "force": "first", "output": "second", "displacement": "second"}
"""Parameters of estimators that name a channel, and which of a record's channels fills them."""
PERIODIC = "conventional"
SEVERAL = "best_linear_approximation"


@dataclass(frozen=True)
class Request:
    """What is asked of an import."""

    files: Sequence[Path]
    channels: Mapping[str, str]
    """The first is the input, the others are outputs, but for those called reference or excitation."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """Keys of the section [record]."""
    estimators: Sequence[str] = ()
    settings: Sequence[str] = ()
    """Texts such as ``estimator.order=2``."""
    levels: Sequence[str | int | float] = ()
    each_file: bool = False
    """Whether each file is an experiment of its own, not a realisation of one."""

    @property
    def stem(self) -> str:
        """Name of the study: that of the first file, without what stands for levels and realisations."""
        return re.sub(r"[{}]", "", self.files[0].stem)


def study_of(request: Request, folder: Path, registry: Registry) -> dict[str, Any]:
    """Return the data of a study in `folder` that analyses measured records."""
    outputs = [name for name in request.channels if name not in INJECTED]
    if len(outputs) < 2:
        raise StudyError(
            f"{request.files[0]}: {len(outputs)} channel given; expected an input and an output, such as u=... "
            "and y=..."
        )
    first, *others = outputs
    names = [Path(os.path.relpath(file.absolute(), folder.resolve())).as_posix() for file in request.files]
    file: Any = names[0] if len(names) == 1 or request.each_file else names
    record: dict[str, Any] = {"file": file, **request.options, "channels": dict(request.channels)}
    grid: dict[str, Any] = {}
    if request.each_file and len(names) > 1:
        grid["record.file"] = names
    if len(request.levels) == 1:
        record["level"] = request.levels[0]
    elif request.levels:
        record["level"] = request.levels[0]
        grid["record.level"] = list(request.levels)
    settings = dict(map(_setting, request.settings))
    chosen = request.estimators or [_usual(request)]
    _check_settings(settings, chosen, registry)
    estimators = [_estimator(name, settings, first, others[0], registry) for name in chosen]
    if len(estimators) > 1:
        grid["estimator"] = estimators
    elif len(others) > 1 and "output" in estimators[0]:
        grid["estimator.output"] = others
    return {
        "title": f"{'Analysis' if request.estimators else 'Frequency response'} of {_name(names)}",
        "record": record,
        **({} if len(estimators) > 1 else {"estimator": estimators[0]}),
        **({"grid": grid} if grid else {}),
    }


def _name(names: Sequence[str]) -> str:
    return Path(names[0]).name + (f" and {len(names) - 1} more" if len(names) > 1 else "")


def _usual(request: Request) -> str:
    if request.options.get("periodic", True):
        several = any(request.options.get(key) for key in ("realisations", "segment", "periods"))
        joined = len(request.files) > 1 and not request.each_file
        return SEVERAL if several or joined else PERIODIC
    raise StudyError(
        f"{request.files[0]}: a record that does not repeat itself needs --estimator: sliding_identification for mass "
        "and friction, rolling_identification for presliding, local_polynomial for a response; see fraexp plugins"
    )


def _check_settings(settings: Mapping[str, Any], estimators: Sequence[str], registry: Registry) -> None:
    known = {name for estimator in estimators for name in _parameters(estimator, registry)}
    for path in settings:
        name = path.partition(".")[0]
        if name not in known:
            who = " and ".join(estimators)
            raise StudyError(f"--set estimator.{path}: {who} has no such parameter{did_you_mean(name, known)}")


def _parameters(estimator: str, registry: Registry) -> Iterable[str]:
    return registry.supply(Estimator.kind, estimator).component.model_fields


def _estimator(name: str, settings: Mapping[str, Any], first: str, second: str, registry: Registry) -> dict[str, Any]:
    """Return an estimator with its channels, and with those settings that it has."""
    known = _parameters(name, registry)
    roles = [role for role in ROLES if role in known and not (role == "force" and "thrust" in known)]
    if "thrust" in roles and ("force" in settings or first == "friction"):  # measured, nothing is accelerated by it
        roles.remove("thrust")
    spec: dict[str, Any] = {"name": name, **{role: first if ROLES[role] == "first" else second for role in roles}}
    for path, value in settings.items():
        parts = path.split(".")
        if parts[0] in known:
            _put(spec, parts, value)
    return spec


def _setting(text: str) -> tuple[str, Any]:
    path, equals, value = (part.strip() for part in text.partition("="))
    section, _, key = path.partition(".")
    if not equals or section != "estimator" or not key:
        raise StudyError(f"--set {text}: expected estimator.PARAMETER=VALUE, such as estimator.order=2")
    try:
        return key, toml_file.value(value)
    except ValueError:
        return key, value


def _put(spec: dict[str, Any], path: Sequence[str], value: Any) -> None:
    for part in path[:-1]:
        spec = spec.setdefault(part, {})
    spec[path[-1]] = value


def same_study(path: Path, data: Mapping[str, Any]) -> bool:
    """Say whether a file holds these data."""
    try:
        return toml_file.loads(path.read_text(encoding="utf-8")) == toml_file.loads(toml(data))
    except ValueError:  # no TOML, or no text
        return False


def toml(data: Mapping[str, Any]) -> str:
    """Return a study as TOML text."""
    lines = [f"{key} = {_value(value)}" for key, value in data.items() if not isinstance(value, Mapping)]
    for section, values in data.items():
        if isinstance(values, Mapping):
            lines += ["", f"[{section}]"]
            nested = {f"{section}.{key}": value for key, value in values.items() if isinstance(value, Mapping)}
            lines += [f"{_key(key)} = {_value(of)}" for key, of in values.items() if not isinstance(of, Mapping)]
            for key, table in nested.items():
                lines += ["", f"[{key}]", *(f"{_key(name)} = {_value(of)}" for name, of in table.items())]
    return "\n".join(lines) + "\n"


def _key(name: str) -> str:
    return name if name.replace("_", "").replace("-", "").isalnum() and name.isascii() else json.dumps(name)


def _value(value: Any) -> str:
    """Return a value as TOML; a JSON text, number or list is one of TOML too."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(name)} = {_value(of)}" for name, of in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_value, value)) + "]"
    return json.dumps(value)
