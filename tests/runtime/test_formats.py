"""Every format of result tables keeps what is written."""

import numpy as np
import pandas as pd
import pytest

from stiffscope.runtime.formats import TABLE_FORMATS, round_off, write_table

READERS = {".csv": pd.read_csv, ".parquet": pd.read_parquet}
TABLES = (
    {"x [m]": np.array([0.1, -1e-12, np.nan]), "K_tx": np.array([1.0, 2e9, 1 / 3])},
    {"state": ["feasible", "a, b"], "design": [1, 2], "mass [kg]": [0.5, 1 / 3]},
)


@pytest.mark.parametrize("suffix", TABLE_FORMATS)
@pytest.mark.parametrize("columns", TABLES)
def test_a_table_comes_back_as_it_was_written(suffix, columns, tmp_path):
    write_table(columns, tmp_path / "a.b", [suffix])
    (file,) = tmp_path.iterdir()
    assert file.name == f"a.b{suffix}"
    pd.testing.assert_frame_equal(
        READERS[suffix](file), pd.DataFrame(columns), rtol=0.0, atol=0.0
    )


def test_digits_are_as_asked_and_missing_values_are_named(tmp_path):
    write_table({"a": np.array([1 / 3, np.nan, 2.0])}, tmp_path / "t", digits=3)
    assert (tmp_path / "t.csv").read_text() == "a\n0.333\nnan\n2\n"


def test_what_is_zero_but_for_rounding_is_zero_in_a_table():
    fall, across = round_off(np.array([3.2e-5, np.nan]), np.array([-4.3e-20, 1e-9]))
    assert fall[0] == 3.2e-5
    assert np.isnan(fall[1])
    assert across.tolist() == [0.0, 1e-9]
    assert not np.signbit(across[0])
    (length,) = round_off(np.array([0.017999999999999988, 0.8]))
    assert length[0] == 0.018
    (still,) = round_off(np.zeros(3))
    assert still.tolist() == [0.0] * 3


@pytest.mark.parametrize("size", [1e-300, 1e-12, 1.0, 1e12, 1e300])
def test_rounding_keeps_eleven_digits_of_the_greatest_number(size):
    values = size * np.random.default_rng(3).uniform(-1.0, 1.0, 50)
    (rounded,) = round_off(values)
    assert np.abs(rounded - values).max() <= 1e-11 * np.abs(values).max()
