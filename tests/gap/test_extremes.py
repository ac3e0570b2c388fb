"""Places, wrenches and readings that no robot has are doubted, and end no diagnosis with an unexpected error."""

import re
import shutil
from pathlib import Path

import pytest

from stiffscope.errors import InputError
from stiffscope.gap.campaigns import configure_case, diagnose, inspect_case, open_case

GAUGES = Path(__file__).parents[2] / "data" / "campaigns" / "gauges"


def changed(folder, file, old, new):
    """The bundled campaign of a Delta with a text replaced once."""
    shutil.copytree(GAUGES, folder, dirs_exist_ok=True)
    text = (folder / file).read_text(encoding="utf-8")
    assert old in text
    (folder / file).write_text(text.replace(old, new, 1), encoding="utf-8")
    return folder


def remarks(folder):
    case = open_case(folder, planned=True)
    return {
        remark.doubt: remark.text for remark in inspect_case(case, configure_case(case))
    }


@pytest.mark.parametrize(
    ("file", "old", "new", "doubt", "text"),
    [
        (
            "campaign.toml",
            '"60 mm", "20 mm", "-1054 mm"',
            "60, 20, -1054",
            "place",
            r"campaign.toml:\d+: sensors.gauge_x.at: expected a place near the robot, got one \d+ m away, \d+ times",
        ),
        (
            "campaign.toml",
            '[0, 0, "-1124 mm"]',
            "[0, 0, -1124]",
            "place",
            r"campaign.toml:\d+: loads.hook.at:",
        ),
        (
            "readings.csv",
            ";-49;",
            ";-1e12;",
            "wrench",
            r"readings.csv:2: fz: expected a load of the size of the others, got -1e\+12 N, \S+ times as large: wrong",
        ),
    ],
)
def test_what_is_far_too_large_is_doubted_and_refused(
    tmp_path, file, old, new, doubt, text
):
    folder = changed(tmp_path, file, old, new)
    assert re.match(text, remarks(folder)[doubt])
    with pytest.raises(InputError, match=text):
        diagnose(folder)


@pytest.mark.extended
def test_a_place_too_far_for_a_robot_is_doubted_and_said(tmp_path):
    """The gauge is moved along its own direction, which changes none of its readings."""
    folder = changed(tmp_path, "campaign.toml", '["60 mm", "20 mm"', '["60 m", "20 mm"')
    text = remarks(folder)["place"]
    assert diagnose(folder).remarks[0] == text


def test_a_sound_campaign_has_no_doubts():
    assert remarks(GAUGES) == {}


TILTED = """robot = "delta"
modelled = ["gravity"]
components = "beam"
readings = "readings.csv"
[sensors.gauge]
measures = "displacement"
body = "platform"
at = ["60 mm", "20 mm", "-1054 mm"]
direction = [0, 0, 1]
[sensors.level]
measures = "displacement"
body = "platform"
at = ["-60 mm", "20 mm", "-1054 mm"]
direction = [0, 0, 1]
zero = "session"
[loads.hook]
body = "platform"
at = [0, 0, "-1124 mm"]
"""


def written(folder, columns, rows):
    (folder / "campaign.toml").write_text(TILTED)
    (folder / "readings.csv").write_text("\n".join([columns, *rows]))
    return folder


@pytest.mark.extended
def test_a_deflection_under_no_load_is_named_and_left_out(tmp_path):
    """Unless it is zero within its noise, or its zero is unknown."""
    loaded = [
        f"0,{k}e-2,-1.064,hook,{f},{s},deflection,{-f}e-6,1"
        for k in range(4)
        for f in (20, 40)
        for s in ("gauge", "level")
    ]
    still = [
        f"0,{k}e-2,-1.064,hook,0,{s},deflection,{v}e-6,1e-7"
        for k, s, v in (
            (0, "gauge", -30),
            (1, "gauge", 0.3),
            (2, "level", 50),
            (3, "gauge", 20),
        )
    ]
    folder = written(
        tmp_path, "x,y,z,load,fx,sensor,kind,value,sigma", [*still, *loaded]
    )
    text = "gauge is deflected by no force or moment at readings.csv:2, readings.csv:5: is a load missing?"
    assert remarks(folder)["no-load"] == f"{text} A diagnosis leaves these out"
    found = diagnose(folder)
    assert f"{text} A diagnosis leaves these out" in found.remarks
    assert "18 readings" in " ".join(found.remarks)


def test_a_stiffness_below_that_of_a_push_is_a_contradiction(tmp_path):
    """K_ii is at least 1/C_ii: holding other motions cannot soften."""
    rows = [
        "0,0,-1.064,kx,1e5,1e3",
        "0,0,-1.064,px,5e6,5e4",
        "0,0,-1.064,ky,1e6,1e3",
        "0,0,-1.064,py,1.002e6,1e3",
        "0.1,0,-1.064,px,5e6,5e4",
    ]
    folder = written(tmp_path, "x,y,z,quantity,value,sigma", rows)
    text = r"kx is 1e\+05 at readings.csv:2, below px of 5e\+06 at readings.csv:3 and one pose: .* exchanged\?"
    assert re.fullmatch(text, remarks(folder)["contradiction"])
    twice = ["0,0,-1.064,kx,1e5,1e3", "0,0,-1.064,kx,5e6,5e4"]
    assert "contradiction" in remarks(
        written(tmp_path, "x,y,z,quantity,value,sigma", [*rows[2:], *twice])
    )
