"""Every registered shape says all that others ask of it; one without beam theory is as good a part."""

from dataclasses import MISSING, dataclass, fields, replace
from types import SimpleNamespace
from typing import Annotated

import numpy as np
import pytest

from stiffscope.cad.part import mass_properties, surface
from stiffscope.cad.shapes import SHAPES
from stiffscope.cad.solid import SolidParameters, build
from stiffscope.errors import InputError
from stiffscope.experiments.comparison import compare
from stiffscope.experiments.experiments import compliance_json
from stiffscope.files.keys import all_keys
from stiffscope.report.drawing.solids import _skin
from stiffscope.report.part_tables import show_comparison
from stiffscope.robot.file import part_sections
from stiffscope.robot.part_matrices import beam_compliance, known_mass, part_sources
from tests.experiments.one_part import one_part

SIZES = {"length": 0.3, "radius": 0.03, "wall": 0.004, "flange": 0.005, "web": 0.004}


def example(shape: str) -> SolidParameters:
    """A shape whose required dimensions have usual sizes."""
    needed = (field.name for field in fields(SHAPES[shape]) if field.default is MISSING)
    return SHAPES[shape](**{name: SIZES.get(name, 0.05) for name in needed})


@pytest.mark.parametrize("shape", SHAPES)
def test_a_shape_says_all_that_is_asked_of_it(shape):
    solid = example(shape)
    names = {field.name for field in fields(solid)}
    assert solid.shape == shape
    assert solid.__doc__
    assert "twist (v, omega) and wrench (f, m) at the" in solid.axes
    assert {*solid.required, *solid.along} <= names
    assert {*solid.whole_load, *solid.whole_clamp} <= names
    rows = all_keys()["robot"][f'[parts.NAME], shape = "{shape}"']
    described = part_sections.PARAMETRIC[shape].model_fields
    means = {row.key: row.means for row in rows}
    assert {name: described[name].description for name in names} == {
        name: means[name] for name in names
    }
    with pytest.raises(InputError, match="expected a length from"):
        replace(solid, **dict.fromkeys(solid.along, -1.0))


@pytest.mark.parametrize("shape", SHAPES)
def test_a_shape_is_as_large_as_its_solid(shape):
    solid = example(shape)
    part = build(solid)
    corners = surface(part).vertices
    (end,) = part.loaded
    size = np.array([solid.span, *solid.across])
    assert end.reference_point == pytest.approx([solid.span, 0.0, 0.0], abs=1e-9)
    assert np.ptp(corners, axis=0) == pytest.approx(size, rel=0.01)
    volume = mass_properties(part).volume
    assert solid.volume is None or solid.volume == pytest.approx(volume, rel=1e-9)
    segments = solid.segments(0.3)
    if segments is not None:
        assert sum(length for length, _ in segments) == pytest.approx(solid.span)
        assert (
            not solid.is_round or segments[0][1].bending_y == segments[0][1].bending_z
        )
    body = {
        "shape": solid.sketch(),
        "length": solid.span,
        "base": np.zeros(3),
        "axes": np.eye(3),
    }
    drawn = _skin(body, solid.span).points
    assert np.ptp(drawn, axis=0) == pytest.approx(size, rel=0.01)


@dataclass(frozen=True)
class Slab(SolidParameters):
    """A block of which only its solid is known."""

    shape = "slab"
    axes = "x along it"
    length: Annotated[float, "length"]
    width: Annotated[float, "width"]

    @property
    def across(self) -> tuple[float, float]:
        return self.width, self.width


SLAB = 'shape = "slab"\nlength = "60 mm"\nwidth = "20 mm"\nmaterial = "steel"\n'


def test_a_part_without_beam_theory_is_known_by_its_experiment(
    tmp_path, monkeypatch, capsys
):
    section = part_sections._read_shape(Slab)
    monkeypatch.setitem(part_sections.PARTS, "slab", section)
    robot = one_part(tmp_path, SLAB)
    part = robot.part("bar 1")
    assert part.sources == ("fea",)
    assert part_sources(robot, "beam") == {"bar 1": "fea"}
    assert known_mass(robot, "bar 1") is None
    result = SimpleNamespace(
        name="bar 1",
        own_shape=True,
        facts={},
        reused=False,
        compliance=np.diag(np.full(6, 1e-8)),
        error=np.full((6, 6), 1e-12),
    )
    assert compliance_json(robot, result)["beam"] is None
    compared = compare(robot, "bar 1", result)
    assert [entry.timoshenko for entry in compared.entries] == [None] * 6
    assert "no beam theory of a slab" in compared.findings[0]
    show_comparison(compared)
    assert "C66" in capsys.readouterr().out
    for wrong in (
        lambda: one_part(tmp_path, SLAB + 'compliance = "beam"'),
        lambda: part_sources(robot, {"bar 1": "beam"}),
        lambda: beam_compliance(robot, "bar 1"),
    ):
        with pytest.raises(InputError, match=r"fea|with beam theory"):
            wrong()
