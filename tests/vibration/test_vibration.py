"""`stiffscope modes`, `frf` and `map --frequencies`: fields, files with units, and what is refused."""

import json
import re

import numpy as np
import pytest
import xarray as xr
from PIL import Image

from stiffscope.cli.main import _guarded

pytestmark = pytest.mark.slow


def test_modes_has_the_fields_that_scripts_read(tmp_path):
    target = tmp_path / "modes.json"
    words = [
        "modes",
        "biglide",
        "--components",
        "published",
        "--at",
        "0,0,350 mm",
        "--at",
        "Q2",
        "--quiet",
    ]
    assert _guarded([*words, "--count", "4", "--json", str(target)]) == 0
    found = json.loads(target.read_text())
    hertz = np.array(found["frequencies"])
    assert hertz.shape == np.shape(found["error"]) == (2, 4)
    assert (np.diff(hertz, axis=1) > 0.0).all()
    assert (
        np.shape(found["shapes"]["tool"])
        == np.shape(found["shapes"]["platform"])
        == (2, 4, 6)
    )
    assert sum(np.array(share) for share in found["energy"].values()) == pytest.approx(
        np.ones((2, 4))
    )
    assert found["poses"][0] == [0.0, 0.0, 0.35]
    assert np.shape(found["tool"]) == (2, 6)
    assert _guarded([*words, "--drives", "free", "--json", str(target)]) == 0
    assert (
        np.array(json.loads(target.read_text())["frequencies"])[:, :4] == 0.0
    ).sum() == 6


@pytest.mark.extended
def test_shapes_are_drawn_and_move(tmp_path):
    out = tmp_path / "out"
    assert (
        _guarded(
            [
                "modes",
                "five-bar",
                "--at",
                "home",
                "--count",
                "1",
                "--out",
                str(out),
                "--quiet",
            ]
        )
        == 0
    )
    with Image.open(out / "mode_home_1.gif") as moving:
        assert moving.n_frames == 16
    assert (out / "mode_home_1.png").stat().st_size > 10_000
    assert json.loads((out / "modes.json").read_text())["frequencies"]


def test_frequency_response_has_units(tmp_path):
    out = tmp_path / "frf"
    words = [
        "frf",
        "biglide",
        "--components",
        "published",
        "--at",
        "Q1",
        "--out",
        str(out),
        "--points",
        "50",
        "--quiet",
    ]
    assert (
        _guarded(
            [
                *words,
                "--from",
                "platform:M:x",
                "--to",
                "limb1.link1.tip:limb1.link1.joint_b:-rz",
            ]
        )
        == 0
    )
    with xr.open_dataset(out / "frf.nc") as file:
        assert file["magnitude"].units == "rad N-1"
        assert (file["frequency"].units, file["magnitude"].dims) == (
            "Hz",
            ("pose", "frequency"),
        )
        magnitude = file["magnitude"].to_numpy()[0]
    table = np.genfromtxt(out / "frf.csv", delimiter=",", skip_header=1)
    assert table[:, 4] == pytest.approx(magnitude, rel=1e-8)
    chart = re.findall(
        r'<script type="application/json">(.*?)</script>',
        (out / "report.html").read_text("utf-8"),
    )[0]
    decibels = json.loads(chart)["series"][0]["columns"]["magnitude, dB re 1 rad/N"]
    assert 10.0 ** (np.array(decibels) / 20.0) == pytest.approx(magnitude, rel=1e-4)
    assert "rad/N" in (out / "frf.csv").read_text().splitlines()[0]
    assert (out / "frf.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("ends", "message"),
    [
        (
            ["--from", "platform:M", "--to", "tool:M:z"],
            "--from platform:M: expected BODY:POINT:DIRECTION",
        ),
        (
            ["--from", "plate:M:z", "--to", "tool:M:z"],
            "expected tool or one of rail, limb1.slider.base",
        ),
        (
            ["--from", "tool:M:z", "--to", "tool:M:q"],
            "expected a direction among x, y, z, rx, ry, rz, got 'q'",
        ),
        (
            ["--from", "tool:nowhere:z", "--to", "tool:M:z"],
            "expected a point: X,Y,Z such as",
        ),
        (
            ["--from", "tool:M:z", "--to", "tool:M:z", "--band", "5,1"],
            "--band 5,1: expected LOW,HIGH in Hz",
        ),
    ],
)
def test_what_is_no_port_is_refused(tmp_path, capsys, ends, message):
    words = [
        "frf",
        "biglide",
        "--components",
        "published",
        "--at",
        "Q1",
        "--out",
        str(tmp_path / "out"),
        *ends,
    ]
    assert _guarded(words) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.extended
def test_maps_have_frequencies(tmp_path):
    out = tmp_path / "map"
    words = [
        "map",
        "biglide",
        "--out",
        str(out),
        "--components",
        "published",
        "--gravity",
        "none",
        "--quiet",
    ]
    assert _guarded([*words, "--points", "9", "--frequencies", "2"]) == 0
    with xr.open_dataset(out / "map.nc") as file:
        first = file["f1"]
        second = file["f2"]
        assert (first.units, first.dims) == ("Hz", ("z", "x"))
        assert int((second > first).sum()) == int(np.isfinite(file["K_tx"]).sum()) > 0
    assert (out / "frequencies.png").stat().st_size > 10_000
    assert (out / "map.csv").read_text().splitlines()[0].endswith("f1,f2")


def test_a_robot_as_superelement(tmp_path):
    out = tmp_path / "out"
    target = tmp_path / "k.json"
    words = [
        "stiffness",
        "stewart",
        "--at",
        "tilted",
        "--at",
        "0,0,0.29,0,0,0",
        "--quiet",
        "--json",
        str(target),
    ]
    assert _guarded([*words, "--superelement", str(out)]) == 0
    stiffness = np.array(json.loads(target.read_text())["stiffness"])
    for k, name in enumerate(("tilted", "pose2")):
        with np.load(out / f"{name}.npz") as held:
            assert held["stiffness"][:6, :6] == pytest.approx(
                stiffness[k], abs=1e-9 * stiffness[k].max()
            )
            assert (held["stiffness"][6:, :6] == 0.0).all()
            assert (np.linalg.eigvalsh(held["mass"]) > 0.0).all()
            assert "standing on the ground" in str(held["help"])
        assert (out / f"{name}.bdf").exists()
