# SPDX-License-Identifier: Apache-2.0
"""The notebooks of the examples, executed from their first cell to their last."""

from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

from .rig import REPOSITORY

pytestmark = pytest.mark.system

NOTEBOOKS = sorted((REPOSITORY / "examples" / "notebooks").glob("*.ipynb"))


def outputs(cell: Any) -> list[Any]:
    return list(cell.get("outputs", ()))


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of the kernel's client
@pytest.mark.parametrize(
    "notebook",
    [
        pytest.param(
            file, id=file.stem, marks=[] if file.stem == "first_look" else [pytest.mark.nightly]
        )
        for file in NOTEBOOKS
    ],
)
def test_notebook(notebook: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, files = tmp_path / "folder", tmp_path / "files"
    for name, used in (("TMPDIR", files), ("IPYTHONDIR", tmp_path / "ipython")):
        used.mkdir()
        monkeypatch.setenv(name, str(used))
    folder.mkdir()
    content = nbformat.read(notebook, as_version=4)
    assert not [cell for cell in content.cells if outputs(cell)], "outputs are committed"
    NotebookClient(content, timeout=100, resources={"metadata": {"path": folder}}).execute()
    shown = [output for cell in content.cells for output in outputs(cell)]
    assert [one for one in shown if "image/png" in one.get("data", {})], "no picture"
    assert not [one.text for one in shown if one.get("name") == "stderr"]
    assert [*folder.iterdir()] == []


def test_there_are_three() -> None:
    assert len(NOTEBOOKS) == 3
