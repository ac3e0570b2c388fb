"""Compliances of parts with known answers: entry, exact value, ours, bound, and whether the bound held (``-s``)."""

import numpy as np
import pytest
from build123d import Cylinder, export_step

from stiffscope.cad.faces import FaceSelector
from stiffscope.cad.link import LinkParameters
from stiffscope.cad.materials import STEEL
from stiffscope.cad.part import mass_properties
from stiffscope.cad.solid import build
from stiffscope.cad.step import read_step, write_step
from stiffscope.fea.mesh import default_size
from stiffscope.fea.run import run_experiment
from stiffscope.fea.settings import Settings
from tests.validation import parts
from tests.validation.axisymmetric import press, stretch

pytestmark = pytest.mark.slow

ROUNDING = 1e-9  # of the entry; exact solutions that the quadratic elements hold are found to rounding


def table(name, experiment, exact, verdict="theory"):
    """Print the rows, return (entries,) relative errors and bounds; "theory" where exact is not exact enough."""
    off = []
    bounds = []
    for (i, j), value in exact.items():
        ours = experiment.compliance[i, j]
        bound = experiment.error[i, j] / abs(value)
        off.append(ours / value - 1)
        bounds.append(bound)
        held = verdict or ("held" if abs(off[-1]) <= bound + ROUNDING else "not held")
        row = f"| {name} | C{i + 1}{j + 1} | {value:.6e} | {ours:.6e} | {off[-1]:+.1e} | {bound:.1e} | {held} |"
        print(row)  # noqa: T201
    return np.array(off), np.array(bounds)


EXACT = {
    "solid bar, no Poisson effect": parts.bar,
    "thick-walled tube, no Poisson effect": lambda: parts.bar(bore=0.015, length=0.1),
    "steel bar": lambda: parts.bar(material=parts.STEEL),
    "wide plate in bending, no Poisson effect": parts.plate,
}


def all_but(kept, names):
    """All names, as slow ones but for one."""
    return [
        name if name == kept else pytest.param(name, marks=pytest.mark.long)
        for name in names
    ]


@pytest.mark.extended_for("solid bar, no Poisson effect")
@pytest.mark.parametrize("name", all_but("solid bar, no Poisson effect", EXACT))
def test_exact_solutions_are_within_the_bounds(name):
    part, exact = EXACT[name]()
    off, bounds = table(name, run_experiment(part, Settings(), whole=False), exact, "")
    assert (np.abs(off) <= bounds + ROUNDING).all()
    assert np.abs(off).max() < 5e-4


# What theory leaves out: the step's own give, the corner's size, and the clamp that keeps a curved beam's section.
THEORY = {
    "stepped bar": (parts.stepped, 0.0, 0.05),
    "elbow": (parts.elbow, -0.02, 0.02),
    "curved beam": (parts.curved, -0.003, 0.003),
    "slender curved beam": (lambda: parts.curved(0.097, 0.103, 0.006), -0.002, 0.002),
}


@pytest.mark.parametrize("name", all_but("slender curved beam", THEORY))
def test_theory_is_met_as_far_as_it_reaches(name):
    make, low, high = THEORY[name]
    part, exact = make()
    off, _ = table(name, run_experiment(part, Settings(), whole=False), exact)
    assert ((low <= off) & (off <= high)).all()


@pytest.mark.extended
def test_a_carbon_fibre_tube_twists_exactly_and_stretches_as_its_fibres():
    part, exact = parts.cfrp_tube()
    experiment = run_experiment(part, Settings(), whole=False)
    off, bounds = table("CFRP tube, fibres along x", experiment, exact)
    assert abs(off[0]) <= bounds[0]
    assert (np.abs(off[1:]) < 4e-3).all()


@pytest.mark.extended
def test_a_part_from_a_step_file_is_the_part(tmp_path):
    original = build(LinkParameters(0.12, 0.0125))
    write_step(original, tmp_path / "bar.step")
    exact = {(3, 3): parts.bar(0.0125, 0.0, 0.12, parts.STEEL)[1][3, 3]}
    ours = run_experiment(read_step(tmp_path / "bar.step"), Settings(), whole=False)
    off, bounds = table("steel bar from STEP", ours, exact, "")
    assert abs(off[0]) <= bounds[0]
    assert np.allclose(
        ours.compliance.diagonal(),
        run_experiment(original, Settings(), whole=False).compliance.diagonal(),
        rtol=1e-3,
    )


@pytest.mark.extended
@pytest.mark.parametrize(
    "flange", all_but((0.025, 0.005), [(0.025, 0.005), (0.03, 0.003)])
)
def test_a_flanged_bar_stretches_as_its_half_section(flange):
    part = build(LinkParameters(0.1, 0.0125, 0.0, *flange))
    exact = {
        (0, 0): stretch(0.1, 0.0125, *flange, STEEL.youngs_modulus, STEEL.shear_modulus)
    }
    off, bounds = table(
        f"bar with flanges of {flange} m",
        run_experiment(part, Settings(), whole=False),
        exact,
        "",
    )
    assert abs(off[0]) <= bounds[0] + 2e-5
    assert bounds[0] < 1e-3


@pytest.mark.extended
def test_a_washer_presses_a_disc_as_its_half_section_says(tmp_path):
    """Of 80 mm diameter and 10 mm thick, held at its rim; a rigid washer of 20 mm around a hole of 10 mm."""
    export_step(Cylinder(40, 10) - Cylinder(5, 20), tmp_path / "disc.step")
    rim = FaceSelector(kind="cylinder", radius=0.04)
    washer = FaceSelector(washer=0.02, normal=(0, 0, 1))
    part = read_step(tmp_path / "disc.step", clamped=[rim], loaded=[washer])
    exact = {
        (2, 2): press(
            0.01, 0.005, 0.01, 0.04, STEEL.youngs_modulus, STEEL.shear_modulus
        )
    }
    off, bounds = table(
        "disc under a washer", run_experiment(part, Settings(), whole=False), exact, ""
    )
    assert abs(off[0]) <= bounds[0] + 2e-5
    assert bounds[0] < 4e-3


FINER = {
    "notched bar": parts.notched,
    "strip with a hole": parts.perforated,
    "stepped bar": lambda: parts.stepped()[0],
}


@pytest.mark.long
@pytest.mark.parametrize("name", FINER)
def test_bounds_hold_against_a_much_finer_solution(name):
    part = FINER[name]()
    size = 0.5 * default_size(
        mass_properties(part).volume, sum(face.area for face in part.faces)
    )
    finer = run_experiment(
        part, Settings(size=size, layers=3, time_limit=300), whole=False
    ).compliance
    exact = {(i, i): finer[i, i] for i in range(6)} | {
        (1, 5): finer[1, 5],
        (2, 4): finer[2, 4],
    }
    off, bounds = table(name, run_experiment(part, Settings(), whole=False), exact, "")
    assert (np.abs(off) <= bounds).mean() >= 0.95
