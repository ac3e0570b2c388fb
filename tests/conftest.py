"""Fixtures that every room's tests may use."""

import os

if "PYTEST_XDIST_WORKER" in os.environ:  # before NumPy is imported: beside other workers its threads only spin
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest

from tests.robots import published_robot


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Half of the tests in their order for each of two workers, so that few fixtures are made twice; then steal."""
    from xdist.scheduler import WorkStealingScheduling

    return WorkStealingScheduling(config, log) if config.getvalue("dist") == "load" else None


@pytest.fixture(scope="session", autouse=True)
def _cache(tmp_path_factory):
    """One cache for all tests of a session, whatever process runs them, and never the user's."""
    folder = tmp_path_factory.getbasetemp()
    shared = folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("STIFFSCOPE_CACHE", str(shared / "cache"))
        yield


@pytest.fixture
def rng():
    return np.random.default_rng(20)


@pytest.fixture(scope="session")
def robot():
    """The paper's robot with Eqs. (28) and (29)."""
    return published_robot()
