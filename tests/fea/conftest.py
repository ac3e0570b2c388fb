import numpy as np
import pytest

from stiffscope.fea.geometry import jacobian_range
from stiffscope.fea.run import run_experiment
from stiffscope.fea.settings import Settings
from stiffscope.fea.specimen import mesh_specimen
from tests.fea.shapes import box, cylinder

LINK, PLATE = cylinder(0.5, 0.0125), box(0.085, 0.32, 0.02)


@pytest.fixture(scope="session")
def link():
    return run_experiment(LINK, Settings())


@pytest.fixture(scope="session")
def plate():
    return run_experiment(PLATE, Settings())


@pytest.fixture(scope="session")
def stub():
    """A short thick bar with curved sides, and its mesh: small enough for everything, no element nearly flat."""
    specimen = cylinder(0.04, 0.0125)
    meshes = (mesh_specimen(specimen, size=0.012, layers=0) for _ in range(20))
    return specimen, next(
        mesh for mesh in meshes if jacobian_range(mesh.points[mesh.cells]).min() > 0.1
    )


@pytest.fixture
def rng():
    return np.random.default_rng(7)
