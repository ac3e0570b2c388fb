"""Files that hold no superelement are refused before they take memory."""

import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.fea.superelement_files import read_superelement


@pytest.mark.parametrize(
    ("name", "stiffness", "message"),
    [
        (
            "large.npz",
            np.zeros((4000, 4000), dtype=np.float32),
            "at most 3000 rows, got 4000 x 4000",
        ),
        ("flat.npz", np.zeros((6, 12)), "got 6 x 12"),
        (
            "complex.npz",
            np.eye(12) * 1j,
            "expected a matrix of real numbers, got complex",
        ),
    ],
)
def test_an_npz_of_another_matrix_is_refused(name, stiffness, message, tmp_path):
    np.savez_compressed(tmp_path / name, stiffness=stiffness)
    with pytest.raises(InputError, match=message):
        read_superelement(tmp_path / name)


def test_an_npz_whose_modes_are_not_in_its_stiffness_is_refused(tmp_path):
    stiffness = np.diag([*np.ones(12), 4.0, 9.0])
    np.savez(tmp_path / "k.npz", stiffness=stiffness, mode_squares=[4.0, 9.0])
    assert np.array_equal(read_superelement(tmp_path / "k.npz").stiffness, stiffness)
    np.savez(tmp_path / "k.npz", stiffness=np.eye(12), mode_squares=[4.0, 9.0])
    with pytest.raises(
        InputError,
        match="expected mode_squares to be the last of the stiffness's diagonal",
    ):
        read_superelement(tmp_path / "k.npz")


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("empty.npz", "", "cannot be read as one"),
        (
            "k.stiffness.mtx",
            "%%MatrixMarket matrix coordinate real general\n1000000 1000000 1\n1 1 1\n",
            "at most 3000",
        ),
        (
            "k.stiffness.mtx",
            "%%MatrixMarket matrix coordinate complex general\n6 6 1\n1 1 1 1\n",
            "real numbers",
        ),
        ("k.stiffness.mtx", "nothing\n", "cannot be read as one"),
    ],
)
def test_a_text_of_another_matrix_is_refused(name, text, message, tmp_path):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=message):
        read_superelement(tmp_path / name)
