"""The withheld campaigns that come along, opened and scored."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from stiffscope.gap.blind import run_blind
from stiffscope.gap.blind_cases import draw, unseal
from stiffscope.gap.diagnose import diagnose
from stiffscope.gap.readings import load_campaign
from tests.robots import nominal_robot

ROBOT = nominal_robot()
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


def test_cases_repeat_with_their_seed():
    assert draw(3, 9) == draw(3, 9)
    assert draw(3, 9) != draw(3, 10)


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_no_worker_outlives_a_killed_parent(tmp_path):
    script = tmp_path / "parent.py"
    script.write_text(
        "import multiprocessing, os, time\n"
        "from concurrent.futures import ProcessPoolExecutor\n"
        "from stiffscope.gap.blind import _start_worker\n"
        "if __name__ == '__main__':\n"
        "    context = multiprocessing.get_context('spawn')\n"
        "    pool = ProcessPoolExecutor(1, mp_context=context, initializer=_start_worker)\n"
        "    print(pool.submit(os.getpid).result(), flush=True)\n"
        "    pool.submit(time.sleep, 600)\n"
        "    time.sleep(600)\n"
    )
    with subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True) as parent:
        worker = int(parent.stdout.readline())
        parent.send_signal(signal.SIGKILL)
    for _ in range(100):
        try:
            os.kill(worker, 0)
        except ProcessLookupError:
            return
        if Path(f"/proc/{worker}/stat").exists() and Path(f"/proc/{worker}/stat").read_text().split()[2] == "Z":
            return  # ended; nobody has asked for its exit code
        time.sleep(0.1)
    os.kill(worker, signal.SIGKILL)
    pytest.fail("the worker outlived its parent")
