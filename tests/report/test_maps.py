"""Workspace maps as files and pictures."""

import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.report.maps import as_dataset, robot_maps, write_map
from stiffscope.report.notebook import stiffness_map
from stiffscope.vjm.analysis import stiffness
from tests.robots import published_robot


@pytest.fixture(scope="module")
def found():
    return robot_maps(published_robot(), {}, 9, "exact", 9.81)


def test_netcdf_is_what_the_robot_says(found, tmp_path):
    xr = pytest.importorskip("xarray")
    write_map(found, tmp_path, "the title")
    with xr.open_dataset(tmp_path / "map.nc") as file:
        assert (file.title, set(file.coords)) == ("the title", {"x", "y", "z"})
        assert all(variable.attrs["units"] for variable in file.variables.values())
        assert all(variable.attrs["long_name"] for variable in file.variables.values())
        units = {name: file[name].units for name in ("x", "K_tz", "K_rz_loaded", "sag_z", "sag_rx")}
        assert units == {"x": "m", "K_tz": "N m-1", "K_rz_loaded": "N m rad-1", "sag_z": "m", "sag_rx": "rad"}
        here = file.isel(x=4, z=5)
        matrix = stiffness(published_robot(), [[float(here.x), float(here.y), float(here.z)]])[0]
        names = ("K_tx", "K_ty", "K_tz", "K_rx", "K_ry", "K_rz")
        assert [float(here[name]) for name in names] == pytest.approx(np.diag(matrix), rel=1e-12)
        assert xr.Dataset.identical(file.load(), as_dataset(found, "the title"))


def test_another_robot_is_refused_in_one_line():
    class Hexapod:
        pass

    with pytest.raises(InputError, match="expected a Biglide, whose workspace is known, got Hexapod"):
        stiffness_map(Hexapod())
