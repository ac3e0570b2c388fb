"""Fixtures shared by all tests."""

import os
import re
from contextlib import contextmanager

if "PYTEST_XDIST_WORKER" in os.environ:  # before NumPy: its threads would only spin
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest

from stiffscope.runtime.executor import Processes
from tests.robots import published_robot

_SLOW = re.compile(
    r"^pytestmark = [^=]*?pytest\.mark\.(slow|benchmark)\b", re.MULTILINE
)


def pytest_ignore_collect(collection_path, config):
    """Skip slow files for the fast half, since importing their libraries takes seconds."""
    if (
        not config.getoption("markexpr").startswith("not slow")
        or collection_path.suffix != ".py"
    ):
        return None
    return True if _SLOW.search(collection_path.read_text(encoding="utf-8")) else None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Mark the cases that `extended_for` names as extended, and all outside the default run as slow."""
    for item in items:
        cases = item.get_closest_marker("extended_for")
        if cases is not None and item.callspec.id in cases.args:
            item.add_marker(pytest.mark.extended)
        marked = any(item.get_closest_marker(name) for name in ("long", "benchmark"))
        if marked or item.get_closest_marker("extended"):
            item.add_marker(pytest.mark.slow)
        if marked and not item.get_closest_marker("timeout"):
            item.add_marker(pytest.mark.timeout(7200))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Give each worker a contiguous block of tests, to share fixtures, with work stealing."""
    from xdist.scheduler import WorkStealingScheduling

    return (
        WorkStealingScheduling(config, log)
        if config.getvalue("dist") == "load"
        else None
    )


@pytest.fixture(scope="session", autouse=True)
def _cache(tmp_path_factory):
    """Use one cache for all tests and processes of a session, never the user's."""
    folder = tmp_path_factory.getbasetemp()
    shared = folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("STIFFSCOPE_CACHE", str(shared / "cache"))
        yield


@pytest.fixture(scope="session", autouse=True)
def _drawing():
    """Share drawing processes among all tests of a session, since each needs seconds to start."""

    @contextmanager
    def lend(_width):
        yield executor

    with Processes(2) as executor, pytest.MonkeyPatch.context() as patch:
        patch.setattr("stiffscope.report.pictures.Processes", lend)
        patch.setattr(executor, "end", lambda: None)
        yield


@pytest.fixture
def drawn_anew(monkeypatch):
    """Give a test of the drawing processes its own ones."""
    monkeypatch.setattr("stiffscope.report.pictures.Processes", Processes)


@pytest.fixture
def rng():
    return np.random.default_rng(20)


@pytest.fixture(scope="session")
def robot():
    """Return the paper's robot with Eqs. (28) and (29)."""
    return published_robot()
