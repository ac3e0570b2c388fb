"""Kinds of cases that failed in the field, on arms drawn at random: nothing false is certain."""

import pytest

from tests.benchmarks.field_kinds import KINDS, answer

MINUTES = {"03 curve at one posture", "14 second order"}


def _mark(kind):
    marks = pytest.mark.long if kind.name in MINUTES else pytest.mark.extended
    return pytest.param(kind, marks=marks, id=kind.name)


@pytest.mark.parametrize("kind", [_mark(kind) for kind in KINDS])
def test_nothing_false_is_certain(kind):
    """By mechanics of their own; one variant, stated and empty sigma."""
    for stated in kind.stated:
        score, words = answer(kind, 0, stated)
        assert score != "false", words
