"""Jobs in processes of their own: what comes back of them, and that none outlives its parent."""

import logging
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from stiffscope.errors import InputError
from stiffscope.runtime.executor import (
    Here,
    LateError,
    Processes,
    WorkerError,
    work_through,
)
from stiffscope.runtime.signals import defer_signals

pytestmark = pytest.mark.slow


def work(executor, function, jobs, reports=None, limits=None):
    with executor:
        report = (
            (lambda name: reports[name]) if reports else (lambda _name: lambda *_: None)
        )
        return {
            name: done.result()
            for name, done in work_through(
                executor, function, jobs.items(), report, limits
            )
        }


def job(kind, report):
    report(kind, 0.5)
    if kind == "refuse":
        raise InputError("link.bore: expected a diameter")
    if kind == "fail":
        raise ZeroDivisionError("1 / 0")
    if kind == "crash":
        os._exit(3)
    logging.getLogger("job").warning("%s is done", kind)
    return kind.upper()


def wait_long(folder, _report):
    (Path(folder) / str(os.getpid())).touch()
    time.sleep(60)


@pytest.mark.parametrize("executor", [Here, Processes])
def test_answers_progress_and_warnings_come_back(executor, caplog):
    told = []
    jobs = {"one": ("a",), "two": ("b",)}
    reports = {
        name: lambda stage, fraction, name=name: told.append((name, stage, fraction))
        for name in jobs
    }
    assert work(executor(), job, jobs, reports) == {"one": "A", "two": "B"}
    assert sorted(told) == [("one", "a", 0.5), ("two", "b", 0.5)]
    assert sorted(caplog.messages) == ["a is done", "b is done"]


def process_of(_job, _report):
    time.sleep(0.2)
    return os.getpid()


def test_many_jobs_share_a_few_processes():
    found = work(Processes(), process_of, {k: (k,) for k in range(12)})
    assert set(found) == set(range(12))
    assert 2 <= len(set(found.values())) <= max(os.cpu_count(), 2)


@pytest.mark.parametrize(
    ("kind", "error", "message"),
    [
        ("refuse", InputError, "^link.bore: expected a diameter$"),
        ("fail", WorkerError, "^one: ZeroDivisionError: 1 / 0$"),
        (
            "crash",
            WorkerError,
            r"^one: its process ended without an answer \(exit code 3\)$",
        ),
    ],
)
def test_what_goes_wrong_is_told_in_a_line(kind, error, message):
    with pytest.raises(error, match=message):
        work(Processes(), job, {"one": (kind,)})


def stages(report):
    for stage in ("mesh", "solve", "solve", "modes"):
        report(stage, 0.5)
        time.sleep(0.4 if stage != "modes" else 60)


def test_a_job_that_takes_too_long_is_ended():
    told = []
    begun = time.monotonic()
    with pytest.raises(
        LateError,
        match=r"^one: expected its end within 2\.5 s, got no further than its stage modes$",
    ):
        work(
            Processes(),
            stages,
            {"one": ()},
            {"one": lambda stage, _: told.append(stage)},
            {"one": 2.5},
        )
    assert told == ["mesh", "solve", "solve", "modes"]
    assert time.monotonic() - begun < 30


def test_a_killed_parent_takes_its_children_along(tmp_path):
    code = "from tests.runtime.test_executor import wait_long, work, Processes; "
    code += f"work(Processes(), wait_long, {{'one': ({str(tmp_path)!r},)}})"
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(p for p in sys.path if p),
    }
    parent = subprocess.Popen(
        [sys.executable, "-c", code], env=environment, cwd=Path(__file__).parents[2]
    )
    begun = time.monotonic()
    while not os.listdir(tmp_path):
        assert time.monotonic() - begun < 30
        time.sleep(0.05)
    child = int(os.listdir(tmp_path)[0])
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    while (
        Path(f"/proc/{child}").exists()
        and "Z (zombie)" not in Path(f"/proc/{child}/status").read_text()
    ):
        assert time.monotonic() - begun < 60
        time.sleep(0.05)


def die_once(mark, how):
    if not Path(mark).exists():
        Path(mark).touch()
        os.kill(os.getpid(), how)
    return "done"


@pytest.mark.skipif(sys.platform == "win32", reason="kills")
def test_a_job_whose_process_is_killed_is_done_again_once(tmp_path):
    with Processes(1) as executor:
        again = executor.submit(
            die_once, str(tmp_path / "one"), signal.SIGKILL, name="one"
        )
        crashed = executor.submit(
            die_once, str(tmp_path / "two"), signal.SIGSEGV, name="two"
        )
        assert again.result() == "done"
        with pytest.raises(
            WorkerError,
            match=r"^two: its process was ended by SIGSEGV, in a library that it uses$",
        ):
            crashed.result()


def test_all_processes_can_be_ended_at_once():
    import psutil

    others = psutil.Process().children()
    with Processes(2) as executor:
        held = executor.submit(time.sleep, 600)
        while psutil.Process().children() == others:
            time.sleep(0.01)
        begun = time.monotonic()
        executor.end()
        with pytest.raises(WorkerError):
            held.result()
    assert (
        time.monotonic() - begun < 60
    )  # far less than the ten minutes that it would sleep
    assert psutil.Process().children() == others


def test_jobs_are_drawn_as_they_are_needed():
    drawn = []

    def jobs():
        for k in range(10**9):
            drawn.append(k)
            yield k, (k,)

    with Here() as executor:
        for number, (name, future) in enumerate(work_through(executor, abs, jobs())):
            assert name == future.result()
            if number == 10:
                break
    assert len(drawn) < 20


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="masks signals")
def test_a_signal_waits_though_another_thread_takes_it():
    done = threading.Event()
    other = threading.Thread(target=done.wait)
    other.start()
    passed = False
    try:
        with pytest.raises(KeyboardInterrupt), defer_signals("SIGINT", "SIGTERM"):
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.1)
            passed = True
    finally:
        done.set()
        other.join()
    assert passed
    assert signal.getsignal(signal.SIGINT) is not signal.SIG_DFL
