"""The pages as a site: it builds without a warning, loads nothing from elsewhere, and leaves no page out."""

import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from types import ModuleType

import pytest

from fraexp.components.registry import Registry
from tests.docs.conftest import ROOT, Follow, blocks
from tests.waiting import HANG_TIMEOUT_S

DOCS = ROOT / "docs"
CONFIG = DOCS / "site/mkdocs.yml"
LANGUAGES = {"sh", "toml", "python", "text", "console", "json", "matlab"}
"""Languages of blocks: the first three are run or parsed, all others are output, or for other programs."""
MAX_FIGURE_BYTES = 150_000
BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
LOADED = re.compile(
    r"<(?:script|link|img|iframe|source|audio|video)\b[^>]*?\s(?:src|href)=[\"']?((?:https?:)?//[^\"'> ]+)"
)
LOADED_BY_STYLE = re.compile(r"@import|url\(\s*[\"']?(?:https?:)?//")


def module_of(file: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(file.stem, file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[file.stem] = module  # dataclasses look it up
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the built site; a warning ends the build."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--config-file", CONFIG, "--site-dir", folder]
    quiet = {"NO_MKDOCS_2_WARNING": "1", "DISABLE_MKDOCS_2_WARNING": "true"}
    done = subprocess.run(
        command, env=os.environ | quiet, capture_output=True, text=True, check=False, timeout=HANG_TIMEOUT_S
    )
    printed = done.stdout + done.stderr
    assert done.returncode == 0, printed
    assert [line for line in printed.splitlines() if not line.startswith("INFO ")] == []
    return folder


@pytest.mark.thorough
def test_the_site_builds_and_loads_nothing_from_elsewhere(site: Path) -> None:
    pages = {path.relative_to(site).as_posix(): path.read_text("utf-8") for path in site.rglob("*.html")}
    assert {
        "index.html",
        "tutorial.html",
        "reference/index.html",
        "reference/friction.html",
        "decisions/index.html",
    } <= pages.keys()
    assert 'href="friction.html#friction-lugre' in pages["reference/index.html"]
    assert "Makefile" not in {path.name for path in site.rglob("*")}
    assert [path for path in site.rglob("*") if path.suffix in {".py", ".yml", ".md"}] == []
    assert {name: LOADED.findall(text) for name, text in pages.items() if LOADED.findall(text)} == {}
    styles = {path.name: path.read_text("utf-8") for path in site.rglob("*.css")}
    assert [name for name, text in styles.items() if LOADED_BY_STYLE.search(text)] == []
    check_search(site)


def check_search(site: Path) -> None:
    found = json.loads((site / "search/search_index.json").read_text("utf-8"))["docs"]
    assert any("lugre" in entry["text"].lower() and entry["location"].startswith("reference/") for entry in found)
    assert (site / "search/search_index.js").is_file()  # for pages that are opened as files
    assert (site / "site/iframe-worker.js").is_file()


@pytest.mark.thorough
@pytest.mark.skipif(BROWSER is None, reason="there is no Chromium on this machine")
def test_the_search_works_in_pages_that_are_opened_as_files(site: Path) -> None:
    playwright = pytest.importorskip("playwright.sync_api")
    requested: list[str] = []
    sandbox = [] if os.name != "posix" or os.geteuid() else ["--no-sandbox"]  # which Chromium wants of root
    with playwright.sync_playwright() as browsers:
        browser = browsers.chromium.launch(executable_path=BROWSER, args=sandbox)
        page = browser.new_page()
        page.on("request", lambda request: requested.append(request.url))
        page.goto((site / "index.html").as_uri())
        page.click("input[name=query]")
        page.keyboard.type("lugre")
        page.wait_for_selector(".md-search-result__item")
        assert "LuGre" in page.locator(".md-search-result__list").inner_text()
        browser.close()
    assert [url for url in requested if not url.startswith(("file:", "data:", "about:"))] == []


def test_every_page_is_in_the_navigation_once(registry: Registry) -> None:
    nav = CONFIG.read_text("utf-8").partition("\nnav:\n")[2].partition("\ntheme:")[0]
    named = re.findall(r"^ +- (?:[^#\n]*: )?(\S+\.md)", nav, re.MULTILINE)
    folders = re.findall(r"^ +- [^#\n]*: (\S+/)$", nav, re.MULTILINE)
    pages = [path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")]
    elsewhere = ("paper/", *folders)  # the article is published elsewhere
    pages = [page for page in pages if page != "README.md" and not page.startswith(elsewhere)]
    moved = module_of(DOCS / "site/hooks.py").MOVED.values()
    generated = [f"reference/{name}" for name in module_of(DOCS / "make_reference.py").pages(registry)]
    assert sorted(named) == sorted([*pages, *moved, *generated, "gallery.md"])


def test_folders_of_the_navigation_are_their_pages(tmp_path: Path) -> None:
    hooks = module_of(DOCS / "site/hooks.py")
    entries = ["index.md", {"How-to guides": [{"Notebooks": "notebooks/"}, {"Studies": "studies.md"}]}]
    assert list(hooks._expanded(entries, tmp_path)) == ["index.md", {"How-to guides": [{"Studies": "studies.md"}]}]
    (tmp_path / "notebooks").mkdir()
    for name in ("b.ipynb", "a.ipynb", "README.md", "data.csv"):
        (tmp_path / "notebooks" / name).touch()
    found = list(hooks._expanded(entries, tmp_path))[1]["How-to guides"][0]["Notebooks"]
    assert found == ["notebooks/README.md", "notebooks/a.ipynb", "notebooks/b.ipynb"]


@pytest.mark.parametrize(
    ("source", "path", "link", "expected"),
    [
        ("README.md", "index.md", "[a](docs/studies.md#limits)", "[a](studies.md#limits)"),
        ("README.md", "index.md", "[a](LICENSE)", "a"),
        ("docs/README.md", "all-pages.md", "[a](../CONTRIBUTING.md)", "[a](contributing.md)"),
        ("docs/reference/README.md", "reference/README.md", "[a](../README.md)", "[a](../all-pages.md)"),
        ("docs/concepts.md", "concepts.md", "[a](https://example.org/x)", "[a](https://example.org/x)"),
    ],
)
def test_links_of_the_repository_are_those_of_the_site(source: str, path: str, link: str, expected: str) -> None:
    hooks = module_of(DOCS / "site/hooks.py")
    assert hooks.LINK.sub(lambda found: hooks._moved_link(found, source, path), link) == expected


def test_every_block_has_a_language_that_is_known() -> None:
    fences = {path: re.findall(r"^```(\w*)", path.read_text("utf-8"), re.MULTILINE)[::2] for path in DOCS.rglob("*.md")}
    assert {path.name: found for path, found in fences.items() if set(found) - LANGUAGES} == {}


def test_the_figures_of_the_gallery_are_there_and_small() -> None:
    gallery = module_of(DOCS / "make_gallery.py")
    assert all(f"figures/{entry.file}" in gallery.page() for entry in gallery.ENTRIES)
    figures = [DOCS / "figures" / entry.file for entry in gallery.ENTRIES]
    assert [figure.name for figure in figures if figure.stat().st_size > MAX_FIGURE_BYTES] == []


def test_the_drawing_of_the_layers_is_that_of_the_contracts() -> None:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]["contracts"]
    layers = next(contract["layers"] for contract in contracts if contract["name"] == "Imports point downward only")
    expected = [name for layer in layers for name in re.findall(r"\w+", layer) if name != "__main__"]
    assert re.findall(r'class="c"[^>]*>(\w+)<', (DOCS / "figures/layers.svg").read_text("utf-8")) == expected


@pytest.mark.thorough
def test_the_page_on_other_tools(follow: Follow) -> None:
    printed = follow("docs/comparison.md")
    (by_hand,) = re.findall(r"(-?\d+\.\d+) dB at 40 Hz", printed["python response.py"])
    imported = next(text for command, text in printed.items() if command.startswith("fraexp import"))
    titles, row = (imported.splitlines()[line].split("  ") for line in (1, 2))
    found = dict(zip(*([cell.strip() for cell in line if cell.strip()] for line in (titles, row)), strict=True))
    assert float(found["40 Hz"]) == pytest.approx(float(by_hand), abs=0.01)
    assert f"{float(by_hand):.1f} dB at 40 Hz".replace("-", "−") in (DOCS / "comparison.md").read_text("utf-8")
    assert len([block for block in blocks("docs/comparison.md") if block.language == "matlab"]) == 2
