"""The notebooks of the documentation run from the top, and are kept without outputs."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat")
for library in ("nbclient", "ipykernel", "mkdocs"):
    pytest.importorskip(library)

from docs.hooks import run_notebook  # noqa: E402 - needs the libraries above

NOTEBOOKS = sorted((Path(__file__).parents[1] / "docs" / "notebooks").glob("*.ipynb"))

QUICK = "own_effect.ipynb"
"""The one that runs with every test; the others diagnose and train."""


def printed(name: str, folder: Path) -> str:
    """All text that a notebook prints when it is run in a folder."""
    notebook = next(path for path in NOTEBOOKS if path.name == name)
    cells = run_notebook(notebook, folder).cells
    outputs = (output for cell in cells for output in cell.get("outputs", ()))
    return "".join(output.get("text", "") for output in outputs)


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.name)
def test_is_kept_without_outputs(notebook: Path):
    cells = nbformat.read(notebook, as_version=4).cells
    for cell in cells:
        if cell.cell_type == "code":
            assert not cell.outputs and cell.execution_count is None
    assert cells[0].source.startswith("# ")


def test_import_and_an_own_effect(tmp_path: Path):
    out = printed(QUICK, tmp_path)
    base, better = (float(error) for error in re.findall(r"'force_error': '([\d.]+)%'", out))
    assert better < 3.0 < 1.5 * better < base


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("misfit.ipynb", "The model lacks floor tilt"),
        ("controller.ipynb", "mine: "),
    ],
)
def test_the_longer_ones(name: str, says: str, tmp_path: Path):
    if name == "controller.ipynb":
        pytest.importorskip("stable_baselines3")
    assert says in printed(name, tmp_path)


def test_each_is_tried():
    assert {path.name for path in NOTEBOOKS} == {QUICK, "misfit.ipynb", "controller.ipynb"}
