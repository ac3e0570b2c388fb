"""`stiffscope keys`: every key of every file that people write, in words."""

import json

import pytest

from stiffscope.cli.main import cli
from stiffscope.errors import InputError
from stiffscope.report.keys import all_keys, find_keys


def test_every_key_says_what_it_takes():
    every = all_keys()
    assert set(every) == {"robot", "study", "job", "campaign"}
    for titles in every.values():
        for title, rows in titles.items():
            assert rows, title
            assert all(takes and "any value" not in takes for _, takes, _ in rows if title != "[[effects]]"), title


def test_a_section_is_found_by_part_of_its_title(capsys):
    cli(["keys", "milling", "--json", "-"], standalone_mode=False)
    (titles,) = [each for kind, each in json.loads(capsys.readouterr().out).items() if kind == "job"]
    assert [row["key"] for row in titles["[process.milling]"]][:2] == ["material", "kc1"]
    with pytest.raises(InputError, match="did you mean"):
        find_keys("milking")
