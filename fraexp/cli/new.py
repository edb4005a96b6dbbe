"""``fraexp new``: a plugin to start from, that works as it stands, and what to do with it."""

import keyword
import os
import shlex
from argparse import Namespace
from collections.abc import Iterator, Mapping
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from string import Template

from fraexp.cli.exits import ExitCode
from fraexp.cli.output import print_path
from fraexp.components.registry import Registry, discover
from fraexp.errors import PluginError

STUDIES = ("friction", "plant", "controller", "excitation", "estimator")
"""Kinds that come with a study."""
COMMENTS = {
    "fraexp check": "is it sound?",
    "fraexp run": "draws it into figures/",
    "fraexp plot": "draws it again, for a paper",
    "fraexp plugins": "lists what was found",
    "python -m pip": "makes it known to fraexp",
    "python -m pytest": "the same checks, as a test",
}
"""What a next step does, by how it begins."""


def execute(arguments: Namespace) -> ExitCode:
    """Write the files, and print the next steps."""
    kind, name, workspace = arguments.kind, arguments.name, Path(arguments.workspace)
    _check_name(kind, name, discover(workspace / "plugins"))
    words = {
        "name": name, "kind": kind, "class_name": "".join(part.title() for part in name.split("_")),
        "module": f"fraexp_{name}", "project": f"fraexp-{name.replace('_', '-')}",
    }  # fmt: skip
    texts = dict(_package(kind, words) if arguments.package else _drop_in(kind, words))
    for path in texts:
        if os.path.lexists(workspace / path):
            raise PluginError(f"{workspace / path}: is there already; choose another name, or remove it")
    for path, text in texts.items():
        _write(workspace / path, text)
        print_path(workspace / path)
    print("next:")
    _print_steps(list(_steps(kind, words, arguments)))
    return ExitCode.OK


def _write(path: Path, text: str) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        reason = error.strerror or error
        raise PluginError(f"{path}: cannot be written ({reason}); name a folder of yours with --workspace") from None


def _check_name(kind: str, name: str, registry: Registry) -> None:
    if not name.isascii() or not name.isidentifier() or keyword.iskeyword(name) or name != name.lower():
        raise PluginError(f"'{name}' is no name for a plugin; expected small letters, digits and _, such as my_law")
    if (kind, name) in registry.supplies:
        where = registry.supplies[kind, name].file
        raise PluginError(f"there is a {kind} called '{name}' already, in {where}; choose another name")


def _drop_in(kind: str, words: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    name = words["name"]
    yield f"plugins/{name}.py", _filled(f"{kind}.py", words)
    if kind in STUDIES:
        yield f"studies/{name}.toml", _filled(f"{kind}.toml", words)


def _package(kind: str, words: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    folder = words["project"]
    yield f"{folder}/{words['module']}.py", _filled(f"{kind}.py", words)
    for path in ("pyproject.toml", "README.md"):
        yield f"{folder}/{path}", _filled(f"package.{path}", words)
    yield f"{folder}/tests/test_{words['name']}.py", _filled("package.test.py", words)


def _filled(template: str, words: Mapping[str, str]) -> str:
    text = files("fraexp.cli").joinpath("templates", f"{template}.template").read_text(encoding="utf-8")
    return Template(text).substitute(words)


def _steps(kind: str, words: Mapping[str, str], arguments: Namespace) -> Iterator[str]:
    name, workspace = words["name"], Path(arguments.workspace)
    here = "" if workspace == Path() else f" --workspace {shlex.quote(str(workspace))}"
    if arguments.package:
        folder = shlex.quote(str(workspace / words["project"]))
        offline = " --no-deps --no-build-isolation" if find_spec("hatchling") else ""  # the build backend is here
        yield f"python -m pip install{offline} -e {folder}"
        yield f"python -m pytest {folder}"
        return
    yield f"fraexp check {name}{here}"
    if kind not in STUDIES:
        yield f"fraexp plugins{here}"
        return
    yield f"fraexp run {name}{here}"
    yield f"fraexp plot {name} -o {name}.pdf{here}"


def _print_steps(steps: list[str]) -> None:
    width = max(map(len, steps))
    for step in steps:
        comment = next(text for begin, text in COMMENTS.items() if step.startswith(begin))
        print(f"  {step:<{width}}  # {comment}")
