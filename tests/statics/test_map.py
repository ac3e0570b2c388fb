"""`stiffscope map`: figures, and the same numbers in every form."""

import json
import re

import numpy as np
import pytest
import xarray as xr

from stiffscope.cli.main import _guarded

pytestmark = pytest.mark.slow


@pytest.mark.extended
def test_numbers_carry_names_and_units(tmp_path, capsys):
    out = tmp_path / "map"
    words = [
        "map",
        "biglide",
        "--out",
        str(out),
        "--components",
        "published",
        "--points",
        "11",
        "--json",
        "-",
    ]
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


def test_a_map_that_needs_too_much_memory_is_refused_before_it_begins(tmp_path, capsys):
    assert (
        _guarded(["map", "biglide", "--out", str(tmp_path / "map"), "--points", "3000"])
        == 2
    )
    assert re.fullmatch(
        r"stiffscope: points: expected at most \d{3} poses along each of x and z, which take 1.4 GB, got 3000\n",
        capsys.readouterr().err,
    )


@pytest.mark.extended
def test_a_volume_holds_what_maps_and_single_poses_hold(tmp_path, capsys):
    """Principal, directional and loaded compliance of one pose of the volume, from its stiffness matrix."""
    pv = pytest.importorskip("pyvista")
    out = tmp_path / "volume"
    words = [
        "map",
        "delta",
        "--out",
        str(out),
        "--components",
        "beam",
        "--points",
        "3",
        "--gravity",
        "none",
    ]
    words += [
        "--over",
        "x=-60 mm,60 mm",
        "--over",
        "y=-90 mm,90 mm",
        "--over",
        "z=-1080 mm,-1020 mm",
    ]
    words += [
        "--show",
        "worst",
        "--show",
        "best",
        "--show",
        "condition",
        "--direction",
        "1,2,-1",
    ]
    words += ["--wrench", "10 N,-20 N,5 N,0,0,0"]
    assert _guarded(words) == 0
    words = [
        "stiffness",
        "delta",
        "--at",
        "60 mm,0,-1050 mm",
        "--components",
        "beam",
        "--json",
        "-",
    ]
    capsys.readouterr()
    assert _guarded(words) == 0
    compliance = np.array(json.loads(capsys.readouterr().out)["compliance"])[0][:3, :3]
    values = np.linalg.eigvalsh(compliance)
    unit = np.array([1.0, 2.0, -1.0]) / np.sqrt(6.0)
    expected = {
        "worst": 1 / values[2],
        "best": 1 / values[0],
        "condition": values[2] / values[0],
        "along": 1 / (unit @ compliance @ unit),
        "error": np.linalg.norm(compliance @ [10.0, -20.0, 5.0]),
    }
    image = pv.read(out / "map.vti")
    with xr.open_dataset(out / "map.nc") as file:
        for name, value in expected.items():
            assert float(
                file[name].sel(x=0.06, y=0.0, z=-1.05, method="nearest")
            ) == pytest.approx(value, rel=1e-9)
            point = image.find_closest_point((0.06, 0.0, -1.05))
            assert image.point_data[name][point] == pytest.approx(value, rel=1e-9)
    table = np.genfromtxt(out / "map.csv", delimiter=",", names=True)
    (row,) = table[
        np.isclose(table["x"], 0.06)
        & np.isclose(table["y"], 0.0)
        & np.isclose(table["z"], -1.05)
    ]
    assert {name: row[name] for name in expected} == pytest.approx(expected, rel=1e-8)
    assert (out / "quantities_2.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--over", "x=-1,1"], "expected two or three coordinates, got 1"),
        (["--over", "q=-1,1"], "--over q=-1,1: expected each of x"),
        (["--over", "x=1 mm,-1 mm"], "expected the lower end first"),
        (["--over", "x=1 kg,2"], "--over x=1 kg,2: "),
        (["--direction", "0,0,0"], "expected a direction"),
        (["--wrench", "1,2"], "--wrench 1,2: expected 6 values"),
    ],
)
def test_what_no_map_is_made_of_is_refused(words, message, tmp_path, capsys):
    assert (
        _guarded(
            [
                "map",
                "delta",
                "--components",
                "beam",
                "--out",
                str(tmp_path / "m"),
                *words,
            ]
        )
        == 2
    )
    assert message in capsys.readouterr().err
