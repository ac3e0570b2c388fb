"""File formats of result tables, one object a format; every command that writes a table asks it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping
    from pathlib import Path

    import pandas as pd
    import xarray as xr

    Columns = Mapping[str, Any]


@dataclass(frozen=True)
class TableFormat:
    """A format of tables.

    Attributes
    ----------
    write : writes columns (n,) by name to a path; with significant digits, or None for all.
    read : returns the table of a file.
    """

    write: Callable[[Columns, Path, int | None], None]
    read: Callable[[Path], pd.DataFrame]


def _write_csv(columns: Columns, path: Path, digits: int | None) -> None:
    import pandas as pd
    import pyarrow as pa
    import pyarrow.csv

    numbers = all(np.asarray(each).dtype == float for each in columns.values())
    if numbers and digits is None:  # 20 times as fast
        pyarrow.csv.write_csv(pa.table(dict(columns)), path)
        return
    form: dict[str, Any] = {}
    if digits is not None:
        form = {"float_format": f"%.{digits}g", "na_rep": "nan"}
    pd.DataFrame(columns).to_csv(path, index=False, lineterminator="\n", **form)


def _read_csv(path: Path) -> pd.DataFrame:
    import pandas as pd

    return pd.read_csv(path)


def _write_parquet(columns: Columns, path: Path, digits: int | None) -> None:
    import pandas as pd

    del digits  # all of them take no more space
    pd.DataFrame(columns).to_parquet(path, index=False)


def _read_parquet(path: Path) -> pd.DataFrame:
    import pandas as pd

    return pd.read_parquet(path)


TABLE_FORMATS = {
    ".csv": TableFormat(_write_csv, _read_csv),
    ".parquet": TableFormat(_write_parquet, _read_parquet),
}
"""By the suffix of their files."""


def write_table(
    columns: Columns,
    target: Path,
    suffixes: Iterable[str] = (".csv",),
    digits: int | None = None,
) -> None:
    """Write a table to a file of each format.

    Parameters
    ----------
    columns
        Columns (n,) by name, of numbers or text.
    target
        Path of the files without their suffix.
    suffixes
        Formats, of `TABLE_FORMATS`.
    digits
        Significant digits of numbers written as text; by default all.
    """
    for suffix in suffixes:
        path = target.with_name(target.name + suffix)
        TABLE_FORMATS[suffix].write(columns, path, digits)


def write_netcdf(dataset: xr.Dataset, path: Path) -> None:
    """Write a dataset as netCDF 3, which every reader knows."""
    dataset.to_netcdf(path, engine="scipy", format="NETCDF3_64BIT")
