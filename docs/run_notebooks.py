"""Execute the notebooks of the documentation in place, each in an empty folder, so that their pages show results.

python docs/run_notebooks.py [NAME ...]
"""

import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import nbformat
from nbclient import NotebookClient

NOTEBOOKS = Path(__file__).parent / "notebooks"
CELL_TIMEOUT_S = 300
KEPT_OUTPUTS = ("execute_result", "display_data", "stream")
"""Kinds of output that pages show; an error ends the execution."""


def main() -> None:
    """Execute the named notebooks, by default all, and write their outputs."""
    names = sys.argv[1:] or sorted(path.stem for path in NOTEBOOKS.glob("*.ipynb"))
    for name in names:
        path, began = NOTEBOOKS / f"{name}.ipynb", time.perf_counter()
        notebook = execute(path)
        tidy(notebook)
        nbformat.write(notebook, path)
        print(f"{path}: {time.perf_counter() - began:.1f} s")


def execute(path: Path, more: str = "") -> Any:
    """Return a notebook with the outputs of its cells, executed in an empty folder; `more` is a last cell."""
    notebook = nbformat.read(path, as_version=4)
    if more:
        notebook.cells.append(nbformat.v4.new_code_cell(more))
    with TemporaryDirectory() as folder:
        (Path(folder) / "plugins").mkdir()
        resources = {"metadata": {"path": folder}}
        NotebookClient(notebook, timeout=CELL_TIMEOUT_S, kernel_name="python3", resources=resources).execute()
    return notebook


def tidy(notebook: Any) -> None:
    """Remove from a notebook what differs each time: times of execution, and messages on standard error."""
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
        if cell.cell_type == "code":
            cell.outputs = [of for of in cell.outputs if of.output_type in KEPT_OUTPUTS and of.get("name") != "stderr"]


if __name__ == "__main__":
    main()
