"""Workers elsewhere: what is told when they go."""

import logging
import os
import signal
import subprocess
import sys
import threading
import time

import pytest
from distributed import Client, Future, LocalCluster

from stiffscope.errors import InputError, StiffscopeError
from stiffscope.runtime.executor import WorkerError, work_through
from stiffscope.runtime.scheduler import Scheduler

pytestmark = pytest.mark.slow

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
        [sys.executable, "-c", SCHEDULER],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        with (
            pytest.raises(
                StiffscopeError,
                match=r"the scheduler has gone; what is finished is kept",
            ),
            Scheduler(elsewhere.stdout.readline().strip()) as executor,
        ):
            for name, future in work_through(
                executor, time.sleep, [("one", (0,)), ("two", (60,))]
            ):
                assert (name, future.result()) == ("one", None)
                threading.Timer(0.2, elsewhere.kill).start()
    finally:
        elsewhere.kill()
        elsewhere.communicate()
    assert not caplog.records


def test_an_answer_that_is_lost_with_its_worker_is_asked_for_again(monkeypatch):
    """Dask's future of an answer that a killed worker had holds no answer, and no error either: a TypeError."""
    asked = []

    async def lose(future, *given, whole=Future._result, **more):
        asked.append(future.key)
        if len(asked) == 1:
            raise TypeError("cannot unpack non-iterable NoneType object")
        return await whole(future, *given, **more)

    monkeypatch.setattr(Future, "_result", lose)
    with (
        LocalCluster(
            n_workers=1, processes=False, protocol="tcp://", dashboard_address=None
        ) as local,
        Scheduler(local.scheduler_address) as executor,
    ):
        assert executor.submit(abs, -3, name="one").result(30) == 3
        assert len(set(asked)) == 2
        with pytest.raises(InputError, match="no such thing"):
            executor.submit(refuse, name="two").result(30)
        with pytest.raises(WorkerError, match="three: ZeroDivisionError"):
            executor.submit(divmod, 1, 0, name="three").result(30)


@pytest.mark.extended
@pytest.mark.skipif(sys.platform == "win32", reason="kills")
def test_jobs_survive_the_kills_of_their_workers_and_one_that_kills_them_is_named():
    with (
        LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None
        ) as local,
        Client(local) as client,
        Scheduler(local.scheduler_address) as executor,
    ):
        jobs = ((n, (n,)) for n in range(400))
        done = list[int]()
        for _, future in work_through(executor, square, jobs):
            done.append(future.result(60))
            if len(done) in {100, 200, 300}:  # fewer than Dask forgives one job
                worker = next(iter(local.workers.values()))
                os.kill(worker.pid, signal.SIGKILL)
        assert sorted(done) == [n * n for n in range(400)]
        with pytest.raises(WorkerError, match="mine: 4 workers ended at it"):
            executor.submit(os._exit, 1, name="mine").result(60)
        client.wait_for_workers(
            2, timeout=60
        )  # Dask cannot close a cluster whose worker is being started again


def square(number):
    time.sleep(0.01)
    return number * number


def refuse():
    raise InputError("no such thing")


def test_a_scheduler_without_workers_is_told(caplog):
    with (
        LocalCluster(n_workers=0, protocol="tcp://", dashboard_address=None) as local,
        Scheduler(local.scheduler_address),
    ):
        assert f"{local.scheduler_address} has no workers yet" in caplog.text


def test_an_encrypted_address_needs_certificates():
    with pytest.raises(InputError, match="--scheduler: expected certificates"):
        Scheduler("tls://127.0.0.1:1")
