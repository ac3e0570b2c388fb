"""Fixtures shared by all tests."""

import os
from contextlib import contextmanager
from pathlib import Path

if "PYTEST_XDIST_WORKER" in os.environ:  # before NumPy: its threads would only spin
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest

from stiffscope.runtime.executor import Processes
from tests.extended import EXTENDED
from tests.robots import published_robot

SLOW = (
    "benchmarks",
    "cad",
    "cli",
    "design/test_sensitivity_command.py",
    "design/test_studies.py",
    "experiments",
    "exports",
    "fea/test_beam.py",
    "fea/test_elasticity.py",
    "fea/test_experiment.py",
    "fea/test_extrusion.py",
    "fea/test_interfaces.py",
    "fea/test_laws.py",
    "fea/test_mass.py",
    "fea/test_mesh.py",
    "fea/test_sections.py",
    "fea/test_sensitivity.py",
    "fea/test_tolerance.py",
    "files/test_keys.py",
    "files/test_store.py",
    "gap/test_any_robot.py",
    "gap/test_campaign_command.py",
    "gap/test_diagnose.py",
    "gap/test_diagnosis_command.py",
    "gap/test_diagnosis_report.py",
    "gap/test_doubted_instruments.py",
    "gap/test_effects_command.py",
    "gap/test_exudyn_lab.py",
    "gap/test_geometry.py",
    "gap/test_hostile_tables.py",
    "gap/test_inference.py",
    "gap/test_planning.py",
    "gap/test_predictions.py",
    "gap/test_robot_model.py",
    "gap/test_sanity.py",
    "imports/test_assembly.py",
    "lab/test_blind.py",
    "lab/test_lab.py",
    "live/test_live.py",
    "lobes",
    "notebook/test_notebook.py",
    "parts/test_experiment_options.py",
    "parts/test_interfaces.py",
    "path/test_path.py",
    "report/test_page.py",
    "report/test_robot_scene.py",
    "robot/test_sensitivity.py",
    "runtime/test_executor.py",
    "runtime/test_scheduler.py",
    "statics/test_check.py",
    "statics/test_comparison.py",
    "statics/test_map.py",
    "statics/test_run.py",
    "statics/test_watch.py",
    "test_bad_day.py",
    "test_readme.py",
    "test_tutorials.py",
    "test_wheel.py",
    "validation/test_parts.py",
    "vibration/test_vibration.py",
)
"""Folders and files with slow tests: meshing, CAD, processes or long diagnoses."""


def _is_slow(path):
    of = path.relative_to(Path(__file__).parent).as_posix()
    return any(of == each or of.startswith(f"{each}/") for each in SLOW)


def pytest_ignore_collect(collection_path, config):
    """Skip slow files for the fast half, since importing their libraries takes seconds."""
    return (
        True
        if config.getoption("markexpr").startswith("not slow")
        and _is_slow(collection_path)
        else None
    )


def pytest_collection_modifyitems(items):
    """Mark tests outside the default run as extended, and those outside the fast half as slow."""
    for item in items:
        further = EXTENDED.get(
            item.path.relative_to(Path(__file__).parent).as_posix(), ()
        )
        if item.name in further or item.originalname in further:
            item.add_marker(pytest.mark.extended)
        marked = any(item.get_closest_marker(name) for name in ("long", "benchmark"))
        if marked or item.get_closest_marker("extended") or _is_slow(item.path):
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
