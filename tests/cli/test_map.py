"""`stiffscope map`: figures, and the same numbers in every form."""

import numpy as np
from scipy.io import netcdf_file

from stiffscope.cli.main import _guarded


def test_numbers_carry_names_and_units(tmp_path):
    out = tmp_path / "map"
    words = ["map", "biglide", "--out", str(out), "--components", "published", "--points", "21", "--quiet"]
    assert _guarded(words) == 0
    with np.load(out / "map.npz") as held, netcdf_file(out / "map.nc", mmap=False) as file:
        k = file.variables["K_rz_loaded"]
        assert (k.units, k.dimensions, file.variables["sag_z"].units) == (b"N m rad-1", ("z", "x"), b"m")
        assert np.array_equal(k[:], held["stiffness_loaded"][..., 5], equal_nan=True)
        assert np.array_equal(file.variables["z"][:], held["z"])
    table = np.genfromtxt(out / "map.csv", delimiter=",", names=True)
    assert len(table) == np.isfinite(k[:]).sum()
    for stem in ("map", "stiffness", "stiffness_with_gravity", "gravity_difference", "sag"):
        assert (out / f"{stem}.png").stat().st_size > 10_000
        assert (out / f"{stem}.svg").read_text().startswith("<?xml")
