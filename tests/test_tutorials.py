"""The tutorials run from top to bottom, and what their cells show is what a notebook shows."""

from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

FOLDER = Path(__file__).parents[1] / "docs" / "tutorials"
SHOWN = {
    "part": ("Part slider", "Compliance of the slider, clamped at one end", "image/png"),
    "robot": ("degrees of freedom", "Stiffness at M", "<iframe srcdoc=", "Natural frequencies", "image/png"),
    "gauges": ("108 readings", "Identified: actuator stiffness (leg2.motor)", "image/png", "image/svg+xml"),
    "diagnosis": ("Identified: scale (all), factor 1.10", "gap 9.19 % -> 1.25 %", "image/svg+xml"),
}


@pytest.mark.parametrize("name", sorted(file.stem for file in FOLDER.glob("*.ipynb")))
def test_tutorials(name, tmp_path, monkeypatch):
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path))
    written = nbformat.read(FOLDER / f"{name}.ipynb", 4)
    assert not any(cell.get("outputs") for cell in written.cells)  # they are made where they are read
    done = NotebookClient(written, timeout=300, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}})
    shown = str(done.execute())
    for words in SHOWN[name]:
        assert words in shown
