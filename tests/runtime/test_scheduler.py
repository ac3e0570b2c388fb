"""Workers elsewhere: what is told when they go."""

import logging
import subprocess
import sys
import threading
import time

import pytest

from stiffscope.errors import StiffscopeError
from stiffscope.runtime.executor import Scheduler, work_through

SCHEDULER = """\
from distributed import LocalCluster
if __name__ == "__main__":
    with LocalCluster(n_workers=1, processes=False, protocol="tcp://", dashboard_address=None) as local:
        print(local.scheduler_address, flush=True)
        input()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="kills")
def test_a_scheduler_that_goes_is_told_in_one_line(caplog):
    caplog.set_level(logging.WARNING)
    elsewhere = subprocess.Popen(
        [sys.executable, "-c", SCHEDULER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    try:
        with (
            pytest.raises(StiffscopeError, match=r"the scheduler has gone; what is finished is kept"),
            Scheduler(elsewhere.stdout.readline().strip()) as executor,
        ):
            for name, future in work_through(executor, time.sleep, [("one", (0,)), ("two", (60,))]):
                assert (name, future.result()) == ("one", None)
                threading.Timer(0.2, elsewhere.kill).start()
    finally:
        elsewhere.kill()
        elsewhere.communicate()
    assert not caplog.records
