"""The pages against the code: what is named exists, links lead somewhere, and nothing is left out."""

import ast
import importlib.util
import os
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.options import COMMANDS
from fraexp.components.registry import Registry
from fraexp.data.findings import KINDS
from fraexp.data.results import Outcome
from fraexp.study.study_file import KEYS
from fraexp.workspace.workspace_service import WorkspaceService
from tests.docs.conftest import MAKE_RUN, ROOT, blocks

TOP = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")
PAGES = sorted([*TOP, *(str(path.relative_to(ROOT)) for path in (ROOT / "docs").rglob("*.md"))])
MAKEFILE = (ROOT / "Makefile").read_text("utf-8")
ANCHOR = re.compile(r"\]\((?!https?:)([^)#]*)#([^)]+)\)")
LINK = re.compile(r"\]\((?!https?:)([^)#]+)")
NAMED = re.compile(r"`((?:studies|docs|plugins|benchmarks|tests|fraexp)/[\w./-]*)[` ]")
WRITTEN_BY_READERS = ("plugins/", "studies/", "studies/amplitudes.toml", "studies/bench.toml", "studies/machines/")
LONGEST_README = 200
LONGEST_DECISION = 600
"""Words of a decision: a page."""


def read(page: str) -> str:
    return (ROOT / page).read_text("utf-8")


@pytest.fixture(scope="module")
def make_reference() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_reference", ROOT / "docs/make_reference.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def reference(make_reference: ModuleType, registry: Registry) -> dict[str, str]:
    """Return the generated pages by their path, with the page that lists them."""
    pages = {f"docs/reference/{name}": text for name, text in make_reference.pages(registry).items()}
    return {**pages, "docs/reference/README.md": read("docs/reference/README.md") + make_reference.contents(registry)}


def test_every_component_and_parameter_is_in_the_reference(reference: dict[str, str], registry: Registry) -> None:
    text = "".join(reference.values())
    for (kind, name), provider in registry.providers.items():
        section = text.partition(f"## {kind} `{name}`, version {provider.component.version}\n")[2].partition("\n#")[0]
        assert section, f"{kind} {name}"
        for parameter in provider.component.model_fields:
            assert f"| `{parameter}` |" in section


def test_links_of_the_reference_lead_to_headings(reference: dict[str, str]) -> None:
    for page, text in reference.items():
        folder = Path(page).parent
        for link in LINK.findall(text):
            target = os.path.normpath(folder / link)
            assert target in reference or (ROOT / target).exists(), f"{page}: {link}"
        for file, name in ANCHOR.findall(text):
            target = os.path.normpath(folder / file) if file else page
            assert name in anchors(reference.get(target) or read(target)), f"{page}: {file}#{name}"


def test_every_command_and_option_is_in_the_reference(reference: dict[str, str]) -> None:
    for command in COMMANDS:
        assert f"## `fraexp {command}`" in reference["docs/reference/commands.md"]
    assert "`--workspace DIR`" in reference["docs/reference/commands.md"]
    assert "| everywhere | `s` |" in reference["docs/reference/keys.md"]


def test_every_command_is_in_the_readme_and_on_its_page() -> None:
    for command in COMMANDS:
        assert re.search(rf"`?fraexp {command}\b", read("README.md")), command
        assert re.search(rf"`fraexp {command}\b", read("docs/command-line.md")), command


def test_every_exit_code_is_on_the_page_of_the_command_line() -> None:
    page = read("docs/command-line.md")
    assert [code.value for code in ExitCode if f"| {code.value} | {code.sentence} |" not in page] == []


def test_every_section_of_a_study_is_explained() -> None:
    table = read("docs/studies.md").partition("\n## ")[0]
    assert [key for key in KEYS if f"`{key}`" not in table and f"`[{key}]`" not in table] == []


@pytest.mark.thorough
def test_the_messages_in_troubleshooting_are_those_of_the_code() -> None:
    tables = re.findall(r"^\| message \|.*\n\|-.*\n((?:\|.*\n)+)", read("docs/troubleshooting.md"), re.MULTILINE)
    quoted = [row.split(" | ")[0].strip("| ") for table in tables for row in table.splitlines()]
    texts = [
        text for folder in ("fraexp", "plugins") for file in (ROOT / folder).rglob("*.py") for text in texts_in(file)
    ]
    assert len(quoted) > 30
    assert [text for text in quoted if not any(all(part in one for part in parts(text)) for one in texts)] == []


def parts(quoted: str) -> list[str]:
    """Return what stands between the values of a message."""
    return [part.strip("' ") for part in quoted.split("…") if part.strip("' ")]


def texts_in(file: Path) -> Iterator[str]:
    """Yield the texts of a module; a value in one is an ellipsis."""
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        if isinstance(node, ast.JoinedStr):
            yield "".join(str(of.value) if isinstance(of, ast.Constant) else "…" for of in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


def test_every_kind_of_finding_is_explained() -> None:
    page = read("docs/troubleshooting.md")
    rows = [
        f"| {name} | {of.words or '(free text)'} | {of.meaning} | {of.remedy or 'none is needed'} |"
        for name, of in KINDS.items()
    ]
    assert [row for row in rows if row not in page] == []


def test_every_outcome_is_explained() -> None:
    page = read("docs/concepts.md")
    assert [outcome.name for outcome in Outcome if f"| {outcome.name.lower().replace('_', ' ')} |" not in page] == []


def test_the_readme_names_the_two_commands_and_every_target_that_is_named_exists() -> None:
    targets = set(re.findall(r"^([\w-]+):", MAKEFILE, re.MULTILINE))
    assert "make run" in read("README.md")
    assert "make test" in read("README.md")
    assert {"run", "test", "docs-figures"} <= targets
    lines = {line for page in PAGES for block in blocks(page) for line in block.text.splitlines()}
    named = {line.split()[1] for line in lines if line.startswith("make ")}
    named |= {name for page in PAGES for name in re.findall(r"`make ([\w-]+)", read(page))}
    assert named - targets == set()
    recipe = MAKEFILE.partition("\nrun: ")[2].partition("\n\n")[0]
    assert MAKE_RUN in recipe


@pytest.mark.parametrize("page", PAGES)
def test_links_and_named_files_exist(page: str) -> None:
    text = read(page)
    assert re.findall(r"^(?:<<<<<<<|>>>>>>>) .*", text, re.MULTILINE) == [], "a merge that was not finished"
    assert [link for link in LINK.findall(text) if not (ROOT / page).parent.joinpath(link).exists()] == []
    named = [name for name in NAMED.findall(text) if name not in WRITTEN_BY_READERS and "FILE" not in name]
    assert [name for name in named if not (ROOT / name).exists()] == []


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_to_headings(page: str) -> None:
    found = [((ROOT / page).parent / file if file else ROOT / page, name) for file, name in ANCHOR.findall(read(page))]
    assert [name for file, name in found if name not in anchors(file.read_text("utf-8"))] == []


def anchors(text: str) -> set[str]:
    """Return the anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", re.sub(r"```.*?```", "", text, flags=re.DOTALL), re.MULTILINE)
    return {re.sub(r"[^\w\s-]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_every_page_is_in_the_index() -> None:
    index = read("docs/README.md")
    assert [file.name for file in (ROOT / "docs").glob("*.md") if f"]({file.name})" not in index] == ["README.md"]


@pytest.mark.parametrize("page", PAGES)
def test_every_toml_block_is_toml_and_every_python_block_is_python(page: str) -> None:
    for block in blocks(page):
        if block.language == "toml":
            assert tomllib.loads(block.text)
        elif block.language == "python":
            compile(block.text, page, "exec")
            assert block.file or block.run, "a program that no test runs"


def test_the_readme_is_short_and_its_figure_is_there() -> None:
    assert len(read("README.md").splitlines()) <= LONGEST_README
    assert (ROOT / "docs/figures/fig12.png").read_bytes().startswith(b"\x89PNG")


def test_decisions_have_their_parts_and_are_listed() -> None:
    folder = ROOT / "docs/decisions"
    pages = sorted(folder.glob("0*.md"))
    assert pages
    for page in pages:
        text = page.read_text("utf-8")
        assert text.startswith(f"# {page.name[:4]} ")
        assert [part for part in ("## Why", "## Decision", "## Consequences") if part not in text] == []
        assert len(text.split()) <= LONGEST_DECISION, page.name
        consequences = text.partition("## Consequences")[2]
        assert "\n- **+** " in consequences
        assert "\n- **−** " in consequences
        assert page.name in (folder / "README.md").read_text("utf-8")


def test_studies_share_sweeps_as_the_page_on_concepts_says(tmp_path: Path) -> None:
    first, second = WorkspaceService.open(tmp_path).studies(["paper/fig14", "paper/fig15"])
    assert {sweep.key for sweep in first.sweeps} & {sweep.key for sweep in second.sweeps}


def test_a_number_with_a_unit_makes_the_same_sweep(tmp_path: Path) -> None:
    workspace = WorkspaceService.open(tmp_path)
    (plain,) = workspace.studies(["quick"], ["loop.sample_time=500e-6"])
    (worded,) = workspace.studies(["quick"], ["loop.sample_time=0.5 ms"])
    assert [sweep.key for sweep in plain.sweeps] == [sweep.key for sweep in worded.sweeps]
