"""The table of tests that the default run leaves out names tests that there are."""

from pathlib import Path

import pytest

from tests.extended import EXTENDED


@pytest.mark.parametrize("file", EXTENDED)
def test_every_name_is_a_tests(file):
    text = (Path(__file__).parent / file).read_text(encoding="utf-8")
    assert [
        name for name in EXTENDED[file] if f"def {name.partition('[')[0]}(" not in text
    ] == []
