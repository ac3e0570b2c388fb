"""`stiffscope map`: figures, and the same numbers in every form."""

import json

import numpy as np
import xarray as xr

from stiffscope.cli.main import _guarded


def test_numbers_carry_names_and_units(tmp_path, capsys):
    out = tmp_path / "map"
    words = ["map", "biglide", "--out", str(out), "--components", "published", "--points", "11", "--json", "-"]
    assert _guarded(words) == 0
    assert {"coords", "data_vars"} <= set(json.loads(capsys.readouterr().out))
    with np.load(out / "map.npz") as held, xr.open_dataset(out / "map.nc") as file:
        k = file["K_rz_loaded"]
        assert (k.units, k.dims, file["sag_z"].units) == ("N m rad-1", ("z", "x"), "m")
        assert np.array_equal(k, held["stiffness_loaded"][..., 5], equal_nan=True)
        assert np.array_equal(file["z"], held["z"])
        reachable = int(np.isfinite(k).sum())
    table = np.genfromtxt(out / "map.csv", delimiter=",", names=True)
    assert len(table) == reachable
    for stem in ("map", "gravity_difference", "sag"):
        assert (out / f"{stem}.png").stat().st_size > 10_000
        assert (out / f"{stem}.svg").read_text().startswith("<?xml")
