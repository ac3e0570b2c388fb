"""Maps over three coordinates as netCDF, and as a VTK image for ParaView."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pathlib import Path

    import xarray as xr


def write_volume(found: xr.Dataset, folder: Path) -> None:
    """Write map.nc and map.vti with point data by variable; m and rad, NaN if out of reach."""
    import pyvista as pv

    found.to_netcdf(folder / "map.nc", engine="scipy", format="NETCDF3_64BIT")
    order = next(iter(found.data_vars.values())).dims[::-1]
    places = [found[name].to_numpy() for name in order]
    image = pv.ImageData(
        dimensions=tuple(map(len, places)),
        spacing=tuple(float(each[1] - each[0]) for each in places),
        origin=tuple(float(each[0]) for each in places),
    )
    for name, values in found.data_vars.items():
        image.point_data[str(name)] = np.ascontiguousarray(values.to_numpy()).ravel()
    image.save(folder / "map.vti")
