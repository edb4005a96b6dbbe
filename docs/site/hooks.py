"""What the site has beyond the folder docs: pages from the top of the repository, the generated reference and
gallery, and folders in the navigation.
"""

import importlib.util
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from fraexp.components.registry import discover

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files
    from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[2]
MOVED = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "docs/README.md": "all-pages.md",
}
"""Path in the repository and path in the site, of pages for which they differ by more than the folder docs."""
REFERENCE = "reference/README.md"
"""Page of the site that lists the generated pages beside it."""
LINK = re.compile(r"(?P<text>\[[^\]]*\])\((?P<target>[^)#\s]+)(?P<anchor>#[^)]*)?\)")
SCRIPT = re.compile(r"<script\b.*?</script>", re.DOTALL)
PAGE_LINK = re.compile(r'(?<= href=")(?!https?:)([^"#]+)\.(?:md|ipynb)(?=["#])')


def on_config(config: "MkDocsConfig") -> "MkDocsConfig":
    """Replace folders in the navigation by their pages."""
    assert config.nav is not None
    config.nav = list(_expanded(config.nav, Path(config.docs_dir)))
    return config


def _expanded(entries: list[Any], docs: Path) -> Iterator[Any]:
    """Yield the entries of a navigation; a folder without pages is left out."""
    for entry in entries:
        ((title, target),) = entry.items() if isinstance(entry, dict) else [(None, entry)]
        if isinstance(target, list):
            yield {title: list(_expanded(target, docs))}
        elif target.endswith("/"):
            pages = [path for path in (docs / target).glob("*") if path.suffix in {".md", ".ipynb"}]
            pages.sort(key=lambda path: (path.name != "README.md", path.name))  # the page about the folder first
            if pages:
                yield {title: [path.relative_to(docs).as_posix() for path in pages]}
        else:
            yield entry


def on_files(files: "Files", config: "MkDocsConfig") -> "Files":
    """Add the pages that lie elsewhere in the repository, and those that are generated."""
    from mkdocs.structure.files import File  # tests of links need no MkDocs

    found = files.get_file_from_path("README.md")
    assert found is not None
    files.remove(found)
    for source, target in MOVED.items():
        files.append(File.generated(config, target, content=(ROOT / source).read_text("utf-8")))
    for name, text in _script("make_reference").pages(discover()).items():
        files.append(File.generated(config, f"reference/{name}", content=text))
    files.append(File.generated(config, "gallery.md", content=_script("make_gallery").page()))
    return files


def _script(name: str) -> ModuleType:
    """Return a script of the folder docs as a module."""
    spec = importlib.util.spec_from_file_location(name, ROOT / f"docs/{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look it up
    spec.loader.exec_module(module)
    return module


def on_page_markdown(markdown: str, page: "Page", config: "MkDocsConfig", files: "Files") -> str:
    """Let the links of a page, which are right in the repository, be right in the site."""
    path = page.file.src_uri
    if path == REFERENCE:
        markdown += _script("make_reference").contents(discover())
    source = next((key for key, value in MOVED.items() if value == path), f"docs/{path}")
    return LINK.sub(lambda link: _moved_link(link, source, path), markdown)


def _moved_link(link: re.Match[str], source: str, path: str) -> str:
    """Return a link of a page, given by its path in the repository and in the site."""
    target = os.path.normpath(Path(source).parent / link["target"]).replace(os.sep, "/")
    if "://" in link["target"] or not (ROOT / target).exists():
        return link[0]
    if target not in MOVED and not target.startswith("docs/"):
        return link["text"][1:-1]  # a file of the repository that the site does not have
    place = os.path.relpath(MOVED.get(target, target.removeprefix("docs/")), Path(path).parent)
    return f"{link['text']}({Path(place).as_posix()}{link['anchor'] or ''})"


def on_page_content(html: str, page: "Page", config: "MkDocsConfig", files: "Files") -> str:
    """Mend what nbconvert makes of a notebook: MathJax and Mermaid from another host, and links to sources of pages."""
    if not page.file.src_uri.endswith(".ipynb"):
        return html
    html = SCRIPT.sub(lambda script: "" if "https://cdn" in script[0] else script[0], html)
    return PAGE_LINK.sub(r"\1.html", html)
