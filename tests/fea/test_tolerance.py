"""Required tolerances, elastic foundations, superelements."""

from functools import partial

import numpy as np
import pytest
from scipy.io import mmread

import stiffscope.fea.adapt
import stiffscope.fea.solution
from stiffscope.errors import InputError
from stiffscope.fea.cubic import solve_cubic
from stiffscope.fea.experiment import load_experiment
from stiffscope.fea.export import free_superelement, write_superelement
from stiffscope.fea.geometry import volume
from stiffscope.fea.mesh import MeshError
from stiffscope.fea.rigid import rigid_modes, rigid_twists
from stiffscope.fea.run import run_experiment
from stiffscope.fea.settings import Settings
from stiffscope.fea.singular import singular_edges
from tests.fea.conftest import PLATE
from tests.fea.shapes import CLAMPED, box, cylinder, isotropic
from tests.fea.test_experiment import REFERENCE, pick

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def tight():
    return run_experiment(PLATE, Settings(tolerance=1e-3), whole=False)


@pytest.mark.long
def test_refinement_meets_the_tolerance_and_tells_the_truth(tight, plate):
    assert plate.relative_bound > 1e-3 >= tight.relative_bound
    assert tight.note == ""
    off = np.abs(pick(tight.compliance) - REFERENCE["plate"])
    assert (off <= pick(tight.error) + 3e-5 * np.abs(REFERENCE["plate"])).all()


@pytest.mark.long
def test_refinement_is_local_and_keeps_the_shape(tight, plate):
    assert volume(tight.mesh.points, tight.mesh.cells) == pytest.approx(
        PLATE.volume, rel=1e-5
    )
    assert len(singular_edges(tight.mesh, [CLAMPED])[0]) >= 4
    assert len(tight.mesh.cells) < 10 * len(plate.mesh.cells)


@pytest.mark.extended
def test_what_cannot_be_met_is_said_and_saved(tmp_path):
    experiment = run_experiment(
        PLATE, Settings(tolerance=1e-4, most_unknowns=60_000), whole=False
    )
    assert "not met" in experiment.note
    assert "60000 unknowns" in experiment.note
    experiment.save(tmp_path / "plate.npz")
    assert load_experiment(tmp_path / "plate.npz").note == experiment.note


@pytest.mark.extended
def test_a_refined_mesh_that_cannot_be_solved_leaves_the_last_one(monkeypatch):
    def solve(specimen, mesh, *rest):
        if meshes:
            raise MeshError("solve: broken")
        meshes.append(mesh)
        return stiffscope.fea.solution.solve_specimen(specimen, mesh, *rest)

    meshes = []
    monkeypatch.setattr(stiffscope.fea.adapt, "solve_specimen", solve)
    experiment = run_experiment(PLATE, Settings(tolerance=1e-4), whole=False)
    assert experiment.mesh is meshes[0]
    assert experiment.note.endswith(
        "at the last mesh that could be solved; solve: broken"
    )


@pytest.mark.extended
def test_a_soft_foundation_adds_the_springs_of_statics():
    """Far softer than the bar, the foundation's traction is linear: 1 / kA, 1 / kJ and 1 / kI, carried to the tip."""
    k = 1e10
    radius = 0.0125
    length = 0.1
    bar = cylinder(length, radius)
    held, springy = (
        run_experiment(bar, Settings(size=0.01, foundation=value), whole=False)
        for value in (None, k)
    )
    area = np.pi * radius**2
    second = np.pi * radius**4 / 4
    expected = np.diag(1 / (k * np.array([area] * 3 + [2 * second, second, second])))
    carry = np.eye(6)
    carry[:3] = rigid_modes(np.array([[length, 0, 0]]), np.zeros(3))[0]
    springs = carry @ expected @ carry.T
    assert pick(springy.compliance - held.compliance) == pytest.approx(
        pick(springs), rel=5e-3
    )
    assert springy.imbalance < 1e-4


def test_a_stiff_foundation_is_a_clamp():
    bar = box(0.1, 0.03, 0.02)
    held, founded = (
        run_experiment(bar, Settings(size=0.015, foundation=value), whole=False)
        for value in (None, 1e18)
    )
    assert pick(founded.compliance) == pytest.approx(pick(held.compliance), rel=2e-3)


def test_a_foundation_too_soft_to_hold_is_refused():
    with pytest.raises(
        InputError,
        match=r"foundation: 50 N/m³ is too soft to hold box; expected at least 7\.\de\+08",
    ):
        run_experiment(
            box(0.1, 0.03, 0.02), Settings(size=0.015, foundation=50.0), whole=False
        )


@pytest.mark.long
def test_no_bound_without_convergence(monkeypatch):
    rubber = box(0.06, 0.03, 0.02, isotropic(3e6, 3e6 / 2 / (1 + 0.49999)))
    monkeypatch.setattr(
        stiffscope.fea.solution, "solve_cubic", partial(solve_cubic, limit=20)
    )
    with pytest.raises(MeshError, match="did not converge in 20 steps"):
        run_experiment(rubber, Settings(size=0.03), whole=False)


@pytest.mark.extended
def test_superelement_is_free_and_is_the_part_when_held(plate):
    found = free_superelement(plate)
    modes = np.zeros((len(found.stiffness), 6))
    modes[:12] = rigid_twists(found.nodes, np.zeros(3))
    assert np.abs(found.stiffness @ modes).max() < 1e-8 * np.abs(found.stiffness).max()
    assert np.allclose(
        np.linalg.inv(found.stiffness[6:12, 6:12]),
        plate.compliance,
        rtol=1e-7,
        atol=1e-18,
    )
    assert found.stiffness[12:, 12:] == pytest.approx(np.diag(plate.mode_squares))
    assert not found.stiffness[:12, 12:].any()


def test_superelement_is_read_by_others(plate, tmp_path):
    archive, bulk, *matrices = write_superelement(plate, tmp_path / "plate")
    found = free_superelement(plate)
    with np.load(archive, allow_pickle=False) as held:
        assert np.array_equal(held["stiffness"], found.stiffness)
        assert np.array_equal(held["mass"], found.mass)
        assert "ux, uy, uz" in str(held["help"])
    direct = direct_matrices(bulk.read_text())
    for name, path, matrix in zip(
        ("KPART", "MPART"), matrices, (found.stiffness, found.mass), strict=True
    ):
        assert np.allclose(mmread(path), matrix, rtol=1e-12)
        assert np.allclose(direct[name], matrix, rtol=1e-9, atol=0)
    assert (
        max(map(len, bulk.read_text().splitlines())) <= 130
    )  # comments; data lines have at most 72 columns


def direct_matrices(text):
    """The DMIG matrices of bulk data in large fields: 8 columns, then four of 16."""
    points = []
    matrices = {}
    column = None
    for line in text.splitlines():
        fields = [
            line[:8].strip(),
            *(line[k : k + 16].strip() for k in range(8, len(line), 16)),
        ]
        if fields[0] == "GRID*":
            points += [(int(fields[1]), component) for component in range(1, 7)]
        elif line.startswith("SPOINT"):
            points.append((int(line[8:16]), 0))
        elif fields[0] == "DMIG*":
            name = fields[1]
            column = points.index((int(fields[2]), int(fields[3])))
            matrix = matrices.setdefault(name, np.zeros((len(points), len(points))))
        elif fields[0] == "*" and column is not None:
            row = points.index((int(fields[1]), int(fields[2])))
            matrix[row, column] = matrix[column, row] = float(fields[3])
    return matrices


@pytest.mark.parametrize(
    ("name", "value"), [("tolerance", 0), ("tolerance", 2), ("foundation", -1.0)]
)
def test_settings_refuse_what_cannot_be(name, value):
    with pytest.raises(ValueError, match=name):
        Settings(**{name: value})
