"""The tutorials run from top to bottom, and what their cells show is what a notebook shows."""

from pathlib import Path

import nbformat
import pytest
from jupyter_client import KernelManager
from nbclient import NotebookClient

pytestmark = pytest.mark.slow

FOLDER = Path(__file__).parents[1] / "docs" / "tutorials"
SHOWN = {
    "part": (
        "Part slider",
        "Compliance of the slider, clamped at one end",
        "image/png",
    ),
    "robot": (
        "degrees of freedom",
        "Stiffness at M",
        "<iframe srcdoc=",
        "Natural frequencies",
        "image/png",
    ),
    "gauges": (
        "108 readings",
        "Identified: actuator stiffness (leg2.motor)",
        "image/png",
        "image/svg+xml",
    ),
    "diagnosis": (
        "Identified: scale (all), factor 1.10",
        "gap 9.19 % -> 1.25 %",
        "image/svg+xml",
    ),
}


@pytest.fixture(scope="module")
def kernel(tmp_path_factory):
    """One kernel for all, so that libraries are imported once; each tutorial begins without names."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("IPYTHONDIR", str(tmp_path_factory.mktemp("ipython")))
        manager = KernelManager(kernel_name="python3")
        manager.start_kernel()
        yield manager
        manager.shutdown_kernel(now=True)


@pytest.mark.extended_for("gauges", "part", "robot", "diagnosis")
@pytest.mark.parametrize("name", sorted(file.stem for file in FOLDER.glob("*.ipynb")))
def test_tutorials(name, kernel, tmp_path):
    written = nbformat.read(FOLDER / f"{name}.ipynb", 4)
    assert not any(
        cell.get("outputs") for cell in written.cells
    )  # they are made where they are read
    written.cells.insert(0, nbformat.v4.new_code_cell(f"%reset -f\n%cd -q {tmp_path}"))
    shown = str(NotebookClient(written, km=kernel, timeout=300).execute())
    for words in SHOWN[name]:
        assert words in shown
