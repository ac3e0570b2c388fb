"""The shipped Biglide beside the numbers of the former assembler, a tree of springs in series and parallel."""

from pathlib import Path

import numpy as np
import pytest

from stiffscope.vjm.statics.analysis import stiffness
from tests.robots import robot_of

FORMER = np.load(Path(__file__).parent / "former_assembler.npz")


@pytest.mark.parametrize("matrices", ["published", "random"])
def test_stiffness_is_that_of_the_former_assembler(matrices):
    """20 poses all over the workspace; published matrices, and arbitrary full ones."""
    ours = stiffness(
        robot_of(FORMER[f"{matrices}_link"], FORMER[f"{matrices}_slider"]),
        FORMER["poses"],
    )
    theirs = FORMER[f"{matrices}_K"]
    size = np.sqrt(np.einsum("nii,njj->nij", theirs, theirs))
    assert np.abs((ours - theirs) / size).max() < 1e-10
