"""Every format of result tables keeps what is written."""

import numpy as np
import pandas as pd
import pytest

from stiffscope.runtime.formats import TABLE_FORMATS, write_table

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
