"""A report as PDF: its page, printed by a browser without a window."""

import os
import shutil
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

from fraexp.data.atomic_file import atomic_file
from fraexp.errors import FraexpError

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge")
"""Names of programs that print a page to PDF."""
PRINT_TIMEOUT_S = 120.0
"""Time after which a browser that does not print is ended."""


def find_browser() -> str:
    """Return the path of a browser that can print; FraexpError without one."""
    found = next((path for path in map(shutil.which, BROWSERS) if path), None)
    if found is None:
        raise FraexpError(
            "report: a PDF needs Chromium, Chrome or Edge to print it, and none of them is installed; "
            "install one, or write an .html file and print it from any browser"
        )
    return found


def print_page(html: str, path: Path) -> None:
    """Print a page to a PDF file, which appears complete or not at all; FraexpError if the browser fails."""
    browser = find_browser()
    with TemporaryDirectory() as folder, atomic_file(path) as draft:
        page, printed = Path(folder) / "report.html", Path(folder) / "report.pdf"
        page.write_text(html, encoding="utf-8")
        _run_browser(browser, page, printed)
        shutil.copyfile(printed, draft)


def _run_browser(browser: str, page: Path, printed: Path) -> None:
    # As root, as in a container, Chromium runs only without its sandbox; the page is ours and has no scripts.
    alone = ["--no-sandbox"] if getattr(os, "geteuid", lambda: 1)() == 0 else []
    options = ["--headless", "--disable-gpu", *alone, f"--user-data-dir={page.parent / 'profile'}"]
    command = [browser, *options, "--no-pdf-header-footer", f"--print-to-pdf={printed}", page.as_uri()]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=PRINT_TIMEOUT_S, check=False)
    except subprocess.TimeoutExpired:
        raise FraexpError(f"report: {browser} printed nothing within {PRINT_TIMEOUT_S:g} s") from None
    if not printed.is_file():
        last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        raise FraexpError(f"report: {browser} could not print the PDF: {last}")
