"""File formats of result tables: one function a format, which every command that writes a table asks for."""

from __future__ import annotations

import csv
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    import pandas as pd
    import xarray as xr

    Columns = Mapping[str, Any]


def _write_csv(columns: Columns, path: Path, digits: int | None) -> None:
    import pyarrow as pa
    import pyarrow.csv

    numbers = all(np.asarray(column).dtype == float for column in columns.values())
    if numbers and digits is None:  # quick on long paths
        pyarrow.csv.write_csv(pa.table(dict(columns)), path)
        return

    def show(value: Any) -> Any:
        if not isinstance(value, float):
            return value
        if digits is None:
            return "" if np.isnan(value) else value
        return f"{value:.{digits}g}"

    listed = [np.asarray(column).tolist() for column in columns.values()]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(map(show, row) for row in zip(*listed, strict=True))


def _write_parquet(columns: Columns, path: Path, digits: int | None) -> None:
    import pyarrow as pa
    import pyarrow.parquet

    del digits  # all of them take no more space
    pyarrow.parquet.write_table(pa.table(dict(columns)), path)


def to_dataframe(columns: Columns) -> pd.DataFrame:
    """Return a table of columns (n,) for pandas."""
    import pyarrow as pa

    return pa.table(dict(columns)).to_pandas()


RESOLVED = 12
"""Decimal digits of the greatest number of a quantity; what is beyond is rounding noise."""


def round_off(*columns: Any, digits: int = RESOLVED) -> list[Any]:
    """Round columns (n,) of one quantity to so many digits of the greatest number of all of them.

    What is zero but for rounding becomes 0, and 0.017999999999999988 becomes 0.018.
    """
    sizes = (np.abs(each[np.isfinite(each)]).max(initial=0.0) for each in columns)
    most = max(sizes, default=0.0)
    if most < np.finfo(float).tiny * 10.0**digits:  # NumPy scales by 10^places
        return list(columns)
    places = digits - 1 - int(np.floor(np.log10(most)))
    return [np.round(each, places) + 0.0 for each in columns]  # a table has no -0


TABLE_FORMATS = {".csv": _write_csv, ".parquet": _write_parquet}
"""By the suffix of its files, the function of each format that writes columns to a path, with so
many significant digits, or all if None."""


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
        TABLE_FORMATS[suffix](columns, path, digits)


def write_netcdf(dataset: xr.Dataset, path: Path) -> None:
    """Write a dataset as netCDF 3, which every reader knows."""
    dataset.to_netcdf(path, engine="scipy", format="NETCDF3_64BIT")
