"""The robot that a campaign names: a file beside it, or one of those that come along."""

import pytest

from stiffscope.errors import InputError
from stiffscope.jobs.campaigns import open_case
from stiffscope.robot.library import find_robot

READINGS = "x,y,z,fx,fy,fz,mx,my,mz,quantity,value,sigma\n0,0,0.4,100,0,0,0,0,0,dx,1e-5,1e-7\n"


def campaign(folder, robot):
    (folder / "campaign.toml").write_text(f'robot = "{robot}"\ncomponents = "published"\nreadings = "r.csv"\n')
    (folder / "r.csv").write_text(READINGS)
    return open_case(folder)


def test_a_robot_by_name_or_beside_the_campaign(tmp_path):
    assert campaign(tmp_path, "biglide").robot.path == find_robot("biglide")
    text = find_robot("biglide").read_text() + '\n[[effects]]\neffect = "gravity"\nplace = "robot"\n'
    (tmp_path / "mine.toml").write_text(text)
    case = campaign(tmp_path, "mine.toml")
    assert case.robot.path == tmp_path / "mine.toml"
    assert case.campaign.modelled == ("gravity",)
    with pytest.raises(InputError, match=r"campaign\.toml: robot: expected a robot file, .* biglide, delta, "):
        campaign(tmp_path, "nosuch")
