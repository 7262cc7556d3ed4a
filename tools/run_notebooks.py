"""Run the notebooks of `examples/`: ``python tools/run_notebooks.py`` stores what their cells print and draw.

A cell that raises ends the run. Files that the cells write go to a temporary folder.
"""

import shutil
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient

ROOT = Path(__file__).resolve().parent.parent


def run(path: Path) -> None:
    """Run a notebook in a copy of its folder beside the documents, and store its outputs in it."""
    book = nbformat.read(path, as_version=4)
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "docs").mkdir()
        shutil.copy(ROOT / "docs" / "points.csv", Path(folder) / "docs")
        (Path(folder) / "examples").mkdir()
        NotebookClient(book, timeout=600, resources={"metadata": {"path": f"{folder}/examples"}}).execute()
    for cell in book.cells:
        cell.metadata.pop("execution", None)  # times
    nbformat.write(book, path)


if __name__ == "__main__":
    for path in sorted((ROOT / "examples").glob("*.ipynb")):
        run(path)
