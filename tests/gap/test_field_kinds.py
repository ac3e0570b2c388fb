"""Kinds of cases that failed in the field, on arms drawn at random: nothing false is certain."""

import pytest

from tests.benchmarks.field_kinds import KINDS, answer


@pytest.mark.extended
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_nothing_false_is_certain(kind):
    """By mechanics of their own; one variant, stated and empty sigma."""
    for stated in kind.stated:
        score, words = answer(kind, 0, stated)
        assert score != "false", words
