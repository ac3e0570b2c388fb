"""Workers elsewhere: what is told when they go."""

import logging
import subprocess
import sys
import threading
import time

import pytest

from stiffscope.errors import StiffscopeError
from stiffscope.runtime.cluster import cluster, finished

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
            pytest.raises(StiffscopeError, match=r"the scheduler has gone .*; what is finished is kept"),
            cluster(elsewhere.stdout.readline().strip()) as client,
        ):
            futures = {client.submit(time.sleep, wait, pure=False): wait for wait in (0, 60)}
            for wait, future in finished(client, futures):
                assert (wait, future.result()) == (0, None)
                threading.Timer(0.2, elsewhere.kill).start()
    finally:
        elsewhere.kill()
        elsewhere.communicate()
    assert not caplog.records
