"""The robot that a campaign names: a file beside it, or one of those that come along."""

import re

import pytest

from stiffscope.errors import InputError
from stiffscope.gap.campaigns import assemble_nominal, configure_case, open_case
from stiffscope.robot.library import find_robot
from stiffscope.runtime.workshop import workshop

READINGS = (
    "x,y,z,fx,fy,fz,mx,my,mz,quantity,value,sigma\n0,0,0.4,100,0,0,0,0,0,dx,1e-5,1e-7\n"
)


def campaign(folder, robot):
    (folder / "campaign.toml").write_text(
        f'robot = "{robot}"\ncomponents = "published"\nreadings = "r.csv"\n'
    )
    (folder / "r.csv").write_text(READINGS)
    return open_case(folder)


def test_a_robot_by_name_or_beside_the_campaign(tmp_path):
    assert campaign(tmp_path, "biglide").robot.path == find_robot("biglide")
    text = (
        find_robot("biglide").read_text()
        + '\n[[effects]]\neffect = "gravity"\nplace = "robot"\n'
    )
    (tmp_path / "mine.toml").write_text(text)
    case = campaign(tmp_path, "mine.toml")
    assert case.robot.path == tmp_path / "mine.toml"
    assert case.campaign.modelled == ("gravity",)
    with pytest.raises(
        InputError,
        match=r"campaign\.toml:1: robot: expected a robot file, .* biglide, delta, ",
    ):
        campaign(tmp_path, "nosuch")


@pytest.mark.parametrize(
    ("header", "link"), [("", "beam"), ('components = "published"\n', "published")]
)
def test_parts_are_what_the_robot_file_says_unless_the_campaign_says_otherwise(
    tmp_path, header, link
):
    """A Biglide whose link is a beam and whose slider is published: what the campaign's header says replaces both."""
    text = find_robot("biglide").read_text()
    link_said, slider_said = re.findall(r'^compliance = "fea".*$', text, re.MULTILINE)
    text = text.replace(link_said, 'compliance = "beam"').replace(
        slider_said, 'compliance = "published"'
    )
    (tmp_path / "mine.toml").write_text(text)
    (tmp_path / "campaign.toml").write_text(
        f'robot = "mine.toml"\n{header}readings = "r.csv"\n'
    )
    (tmp_path / "r.csv").write_text(READINGS)
    with workshop() as shop:
        nominal = assemble_nominal(open_case(tmp_path), shop)
    assert nominal.sources == {"link": link, "slider": "published"}


@pytest.mark.parametrize(
    ("robot", "columns", "row", "expected"),
    [
        (
            "biglide",
            "x,y,z",
            "9.7,-131,345.6",
            "z: expected m, got 345.6: in mm, as `units = .*mm",
        ),
        ("delta", "x,y,z", "0,0,-450", "z: expected m, got -450: in mm"),
        (
            "delta",
            "q:leg1.motor,q:leg2.motor,q:leg3.motor",
            "40,0,0",
            "q:leg1.motor: expected rad, got 40: in deg",
        ),
        (
            "biglide",
            "x,y,z",
            "0,0,2",
            r"x, y, z: expected a pose that the robot reaches, got \(0, 0, 2000 mm\): out of reach",
        ),
    ],
)
def test_a_pose_out_of_reach_is_named_by_line_and_column(
    tmp_path, robot, columns, row, expected
):
    (tmp_path / "campaign.toml").write_text(f'robot = "{robot}"\nreadings = "r.csv"\n')
    (tmp_path / "r.csv").write_text(f"{columns},quantity,value,sigma\n{row},ez,1e-5,\n")
    with pytest.raises(InputError, match=f"r.csv:2: {expected}"):
        configure_case(open_case(tmp_path))
