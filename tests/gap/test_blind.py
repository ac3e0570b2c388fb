"""The withheld campaigns that come along, opened and scored."""

from pathlib import Path

from stiffscope.gap.blind import run_blind
from stiffscope.gap.blind_cases import draw, unseal
from stiffscope.gap.diagnose import diagnose
from stiffscope.gap.readings import load_campaign
from stiffscope.robot.effects import NominalRobot
from tests.robots import published_robot

ROBOT = NominalRobot(published_robot(), acceleration=9.81, expansion=11.7e-6)
WITHHELD = Path(__file__).parents[2] / "data" / "withheld"


def test_the_withheld_campaigns_get_right_answers():
    cases = unseal(WITHHELD)
    right = 0
    for number, case in enumerate(cases):
        diagnosis = diagnose(load_campaign(WITHHELD / f"campaign-{number:03d}"), ROBOT)
        truth = {p.name for p in case.faults}
        if case.kind == "none":
            right += diagnosis.verdict == "no-gap"
        elif case.kind == "outside":
            right += diagnosis.verdict != "identified"
        else:
            known = {n for e in diagnosis.effects for n in (f"{e.effect} @ {e.place}", *e.confused_with)}
            right += truth <= known
    assert len(cases) == 8
    assert right >= 7


def test_a_short_blind_check_scores_itself(tmp_path):
    scores = run_blind(tmp_path, ROBOT, 2, seed=3, workers=1)
    assert [o.kind for o in scores.outcomes if not o.left_out] == ["single", "single"]
    assert (tmp_path / "campaign-001" / "diagnosis.json").is_file()
    rows, columns, table = scores.confusion()
    assert sum(map(sum, table)) == 2
    assert len(rows) == len(table)
    assert len(columns) == len(table[0])


def test_lots_repeat_with_their_seed():
    assert draw(3, 9) == draw(3, 9)
    assert draw(3, 9) != draw(3, 10)
