"""`stiffscope keys`: every key of every file that people write, in words."""

import json

import pytest

from stiffscope.cli.main import cli
from stiffscope.errors import InputError
from stiffscope.files.keys import all_keys, find_keys
from stiffscope.gap.campaign.kinds import KINDS
from stiffscope.gap.campaign.quantities import names_of

pytestmark = pytest.mark.slow


def test_every_key_says_what_it_means_and_takes():
    every = all_keys()
    assert set(every) == {"robot", "study", "job", "campaign"}
    for titles in every.values():
        for title, rows in titles.items():
            assert rows, title
            assert all(row.means for row in rows), title
            if title not in {"[[effects]]", "quantities at M", "effects"}:
                assert all(
                    row.takes and "any value" not in row.takes for row in rows
                ), title


def test_quantities_are_those_of_the_kinds_of_readings():
    rows = all_keys()["campaign"]["quantities at M"]
    firsts = [names_of(kind)[0] for kind in KINDS if names_of(kind)]
    assert [row.key.split()[0] for row in rows] == firsts


def test_a_key_of_two_meanings_has_that_of_its_section():
    robot = all_keys()["robot"]
    lengths = {
        title: next((row.means for row in rows if row.key == "length"), "")
        for title, rows in robot.items()
    }
    assert lengths['[parts.NAME], shape = "rod"'].startswith("length along x")
    assert "shaft" in lengths["bearing of a joint, kind = ball-screw"]
    assert (
        "roller"
        in lengths["bearing of a joint, kind = cylindrical-roller or crossed-roller"]
    )


def test_defaults_are_as_a_file_would_have_them():
    rows = [
        row
        for titles in all_keys().values()
        for each in titles.values()
        for row in each
    ]
    defaults = {row.key: row.default for row in rows}
    assert defaults["hole_diameter"] == "`9 mm`"
    assert defaults["point"] == "`118 deg`"
    assert defaults["climb"] == "`true`"
    assert defaults["source"] == "–"
    assert not any(
        word in row.default for row in rows for word in ("True", "False", "(")
    )


def test_a_section_is_found_by_part_of_its_title(capsys):
    cli(["keys", "milling", "--json", "-"], standalone_mode=False)
    (titles,) = [
        each
        for kind, each in json.loads(capsys.readouterr().out).items()
        if kind == "job"
    ]
    assert [row["key"] for row in titles["[process.milling]"]][:2] == [
        "material",
        "kc1",
    ]
    with pytest.raises(InputError, match="did you mean"):
        find_keys("milking")
