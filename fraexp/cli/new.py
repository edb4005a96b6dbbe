"""``fraexp new``: a working plugin from a template, and the next steps."""

import builtins
import keyword
import os
import re
import shlex
import sys
from argparse import Namespace
from collections.abc import Iterator, Mapping
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from string import Template

from fraexp import api
from fraexp.cli.exits import ExitCode
from fraexp.cli.output import print_line, print_path
from fraexp.cli.sweep_lookup import workspace_folder
from fraexp.components.registry import Registry
from fraexp.data.atomic_file import atomic_file
from fraexp.errors import PluginError

KINDS_WITH_STUDY = ("friction", "plant", "controller", "excitation", "estimator")
"""Kinds whose template comes with a study."""
NAME_PATTERN = re.compile(r"[a-z][a-z0-9_]*")
MAX_NAME_LENGTH = 100


def execute(arguments: Namespace) -> ExitCode:
    """Write the files, and print the next steps."""
    kind, name, workspace = arguments.kind, arguments.name, Path(arguments.workspace)
    _check_name(kind, name, workspace_folder(arguments).registry)
    words = {
        "name": name, "kind": kind, "class_name": _class_name(name),
        "module": f"fraexp_{name}", "project": f"fraexp-{name.replace('_', '-')}",
    }  # fmt: skip
    texts = dict(_package_files(kind, words) if arguments.package else _local_plugin_files(kind, words))
    for path in texts:
        if os.path.lexists(workspace / path):
            raise PluginError(f"{workspace / path}: already exists; choose another name, or remove it")
    for path, text in texts.items():
        with atomic_file(workspace / path, makes_folder=True) as draft:
            draft.write_text(text, encoding="utf-8")
        print_path(workspace / path)
    print("next:")
    steps = dict(_next_steps(kind, words, arguments))
    width = max(map(len, steps))
    for step, comment in steps.items():
        print_line(f"  {step:<{width}}  # {comment}", "    ")
    return ExitCode.OK


def _check_name(kind: str, name: str, registry: Registry) -> None:
    if not NAME_PATTERN.fullmatch(name):
        raise PluginError(
            f"'{name}' is not a valid plugin name; expected lower-case letters, digits and _, such as my_law"
        )
    if len(name) > MAX_NAME_LENGTH:
        raise PluginError(f"'{name}' is too long for a plugin's name; expected at most {MAX_NAME_LENGTH} letters")
    if meaning := _other_meaning(name):
        raise PluginError(f"'{name}' is {meaning}, which the plugin would hide; choose another name, such as my_{name}")
    if (kind, name) in registry.providers:
        where = registry.providers[kind, name].file
        raise PluginError(f"{kind} '{name}' already exists in {where}; choose another name")


def _other_meaning(name: str) -> str:
    """Return what else a name, or the class that is named after it, is in Python; empty if it is nothing."""
    name_of_class = _class_name(name)
    if keyword.iskeyword(name) or keyword.issoftkeyword(name) or keyword.iskeyword(name_of_class):
        return "a word of Python"
    if hasattr(builtins, name) or hasattr(builtins, name_of_class):
        return "a name of Python"
    if hasattr(api, name) or hasattr(api, name_of_class):
        return "a name of fraexp.api"
    found = None if name in sys.stdlib_module_names else find_spec(name)
    is_module = name in sys.stdlib_module_names or (found is not None and found.origin is not None)
    return "a Python module" if is_module else ""


def _class_name(name: str) -> str:
    return "".join(part.title() for part in name.split("_"))


def _local_plugin_files(kind: str, words: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    name = words["name"]
    yield f"plugins/{name}.py", _fill_template(f"{kind}.py", words)
    if kind in KINDS_WITH_STUDY:
        yield f"studies/{name}.toml", _fill_template(f"{kind}.toml", words)


def _package_files(kind: str, words: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    folder = words["project"]
    yield f"{folder}/{words['module']}.py", _fill_template(f"{kind}.py", words)
    for path in ("pyproject.toml", "README.md"):
        yield f"{folder}/{path}", _fill_template(f"package.{path}", words)
    yield f"{folder}/tests/test_{words['name']}.py", _fill_template("package.test.py", words)


def _fill_template(template: str, words: Mapping[str, str]) -> str:
    text = files("fraexp.cli").joinpath("templates", f"{template}.template").read_text(encoding="utf-8")
    return Template(text).substitute(words)


def _next_steps(kind: str, words: Mapping[str, str], arguments: Namespace) -> Iterator[tuple[str, str]]:
    """Yield commands, each with what it does."""
    name, workspace = words["name"], Path(arguments.workspace)
    here = workspace_folder(arguments).shown_options()
    if arguments.package:
        folder = shlex.quote(str(workspace / words["project"]))
        offline = " --no-deps --no-build-isolation" if find_spec("hatchling") else ""  # the build backend is here
        yield f"python -m pip install{offline} -e {folder}", "installs it"
        yield f"python -m pytest {folder}", "runs its tests"
        return
    yield f"fraexp check {name}{here}", "tests the plugin"
    if kind not in KINDS_WITH_STUDY:
        yield f"fraexp plugins{here}", "lists the components that were found"
        return
    yield f"fraexp run {name}{here}", "runs it, and plots into figures/"
    yield f"fraexp plot {name} -o {name}.pdf{here}", "plots it again, to a file of your choice"
