"""STEP files as parts: round trip, units, selectors, and files made bad in every way that is known."""

import re
import subprocess
import sys
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from build123d import Align, Box, Cylinder, Polyline, Pos, extrude, make_face

from stiffscope.cad import kernel, kernel_files
from stiffscope.cad import step as cad_step
from stiffscope.cad.faces import FaceSelector, describe, face_geometries, select
from stiffscope.cad.link import LinkParameters
from stiffscope.cad.part import Part, mass_properties
from stiffscope.cad.slider import SliderParameters
from stiffscope.cad.solid import Placement, build, part_of
from stiffscope.cad.step import read_solid, read_step, write_step, write_stl
from stiffscope.cad.validity import count_turns, valid_solid
from stiffscope.errors import InputError
from stiffscope.runtime.executor import WorkerError

pytestmark = pytest.mark.slow

HOLED = SliderParameters(rib_count=2, fillet=0.003, hole_count=3)


@pytest.fixture(scope="module")
def holed() -> Part:
    return build(HOLED)


@pytest.fixture(scope="module")
def step(holed: Part, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("step") / "holed.step"
    write_step(holed, path)
    return path


def test_round_trip_keeps_the_part(holed: Part, step: Path) -> None:
    part = read_step(step)
    assert part.name == "holed"
    assert mass_properties(part).volume == pytest.approx(
        mass_properties(holed).volume, rel=1e-9
    )
    assert part.loaded[0].reference_point == pytest.approx([0.085, 0, 0], abs=1e-9)
    assert [face.kind for face in part.faces].count("torus") == 2
    again = read_step(step, name="again")
    assert [face.area for face in again.faces] == [face.area for face in part.faces]


def test_units_of_the_file_count(holed: Part, step: Path, tmp_path: Path) -> None:
    metres = tmp_path / "m.step"
    centimetres = tmp_path / "cm.step"
    centimetres.write_text(
        step.read_text().replace("SI_UNIT(.MILLI.,.METRE.)", "SI_UNIT(.CENTI.,.METRE.)")
    )
    volume = kernel.volume_properties(kernel_files.read_step(centimetres)).Mass()
    assert volume == pytest.approx(
        1e3 * kernel.volume_properties(holed.solid).Mass(), rel=1e-6
    )
    metres.write_text(
        step.read_text().replace("SI_UNIT(.MILLI.,.METRE.)", "SI_UNIT($,.METRE.)")
    )
    with pytest.raises(
        InputError, match=r"m.step: expected a solid 1 to 40000 mm large"
    ):
        read_solid(metres)


def test_placement_gives_the_axes(holed: Part) -> None:
    turned = part_of(
        holed.solid, placement=Placement(origin=(0, 0, 0.01), x=(0, 1, 0), z=(0, 0, 1))
    )  # its y is -x
    x, y, z = mass_properties(holed).centre
    assert mass_properties(turned).centre == pytest.approx([y, -x, z - 0.01], abs=1e-12)
    assert turned.loaded[0].reference_point == pytest.approx(
        [0, -0.085, -0.01], abs=1e-9
    )
    (held,) = turned.clamped
    assert turned.faces[held].axis == pytest.approx([0, 1, 0])
    with pytest.raises(InputError, match="right angles"):
        Placement(x=(1, 0, 0), z=(1, 0, 1))
    for unusable in ((1e300, 0, 0), (1e-200, 0, 0), (0, 0, 0), (1, 0)):
        with pytest.raises(InputError, match=r"placement\.x: expected a direction"):
            Placement(x=unusable)


def test_selectors_choose_by_geometry(holed: Part) -> None:
    def chosen(**conditions: object) -> list[str]:
        faces = select(holed.solid, [FaceSelector(**conditions)])  # type: ignore[arg-type]
        return [holed.faces[i].kind for i in faces]

    assert chosen(kind="cylinder", radius=0.0045) == ["cylinder"] * 3
    assert chosen(kind="cylinder", radius=0.0045, position="max y") == ["cylinder"]
    assert chosen(normal=(0, 0, -2), kind="plane") == ["plane"]
    assert chosen(position=(0.085, 0.1, 0.0)) == ["plane"]
    assert chosen(index=(0, 1)) == [holed.faces[0].kind, holed.faces[1].kind]
    rows = describe(holed.solid)
    assert sorted({row["radius_mm"] for row in rows if row["kind"] == "torus"}) == [3.0]
    assert sum(row["area_mm2"] for row in rows) == pytest.approx(
        kernel.area_properties(holed.solid).Mass()
    )


def test_a_point_on_a_face_does_not_choose_the_face_around_it() -> None:
    """Disc and rim of a grooved cylinder lie in one plane, about one centroid, which is on the disc alone."""
    solid = (
        Cylinder(20, 10) - Pos(0, 0, 5) * (Cylinder(12, 4) - Cylinder(8, 4))
    ).wrapped
    (disc,) = select(solid, [FaceSelector(position=(0, 0, 0.005))])
    assert face_geometries(solid)[disc].area == pytest.approx(np.pi * 0.008**2)
    (side,) = select(solid, [FaceSelector(position=(0, 0, 0), kind="cylinder")])
    assert face_geometries(solid)[side].radius == pytest.approx(0.02)


def test_a_reference_point_is_near_the_solid(holed: Part) -> None:
    assert part_of(holed.solid, reference_point=(30, 0, 0)).loaded[
        0
    ].reference_point == pytest.approx([30, 0, 0])
    for far in ((40, 0, 0), (1e300, 0, 0), (np.nan, 0, 0), (1, 2), "here"):
        with pytest.raises(
            InputError,
            match=r"slider.reference_point: expected a point .*within (3|1000)",
        ):
            part_of(holed.solid, name="slider", reference_point=far)


def test_selectors_that_choose_nothing_or_everything_say_what_exists(
    holed: Part,
) -> None:
    with pytest.raises(
        InputError,
        match=r"slider.clamped: no face has radius = 7 mm; there are .*3, 4.5, 5 mm",
    ):
        select(holed.solid, [FaceSelector(radius=0.007)], "slider.clamped")
    with pytest.raises(InputError, match=r"expected some of the faces, got all"):
        select(holed.solid, [FaceSelector(index=range(len(holed.faces)))])
    nonsense = (
        {"kind": "flat"},
        {"position": "left"},
        {"normal": (0, 0, 0)},
        {"radius": -1.0},
        {"radius": "7 mm"},
    )
    for bad in ({}, *nonsense):
        with pytest.raises(InputError, match=r"^selector"):
            FaceSelector(**bad)  # type: ignore[arg-type]


def test_held_and_loaded_faces_are_apart(holed: Part) -> None:
    with pytest.raises(InputError, match="no other interface uses"):
        part_of(holed.solid, loaded=[FaceSelector(position="min x", kind="plane")])


def box(low: float, high: float) -> kernel.Shape:
    return (Pos(low, low, low) * Box(*[high - low] * 3, align=(Align.MIN,) * 3)).wrapped


def crossing(deep: float = 5.0) -> kernel.Shape:
    """Two cubes that overlap, mm, their faces in one shell."""
    return one_shell(
        *kernel.faces(box(0, 10)), *kernel.faces(box(10 - deep, 20 - deep))
    )


def one_shell(*faces: kernel.Face) -> kernel.Shape:
    """A solid whose faces are these, whether they fit or not."""
    from OCP.BRep import BRep_Builder
    from OCP.TopoDS import TopoDS_Shell, TopoDS_Solid

    builder = BRep_Builder()
    shell = TopoDS_Shell()
    solid = TopoDS_Solid()
    builder.MakeShell(shell)
    builder.MakeSolid(solid)
    for face in faces:
        builder.Add(shell, face)
    builder.Add(solid, shell)
    return solid


BAD = {
    "assembly": (
        lambda: kernel.compound(box(0, 1), box(2, 3)),
        r"2: 1 from \(0, 0, 0\) mm to \(1, 1, 1\) mm, 1 mm3; 2 from \(2, 2, 2\)",
    ),
    "sheet": (lambda: kernel.faces(box(0, 10))[0], "a surface without volume"),
    "loose": (
        lambda: kernel.compound(box(0, 10), kernel.faces(box(20, 30))[0]),
        r"1 loose face beside the solid, at \(20, 25, 25\) mm",
    ),
    "far": (lambda: box(1e9, 1e9 + 10), "1e.09 mm"),
    "not a number": (lambda: box(0, float("nan")), "nan mm"),
    "crossing": (crossing, r"a self-intersecting solid at \(.*\) mm"),
    "open": (
        lambda: one_shell(*kernel.faces(box(0, 10))[:5]),
        r"4 open edges, one at \((0|5|10), (0|5|10), 10\) mm",
    ),
    "tiny": (lambda: box(0, 0.01), "0.0173 mm"),
    "foil": (lambda: Box(100, 100, 1e-4).wrapped, "0.0001 mm"),
}


def test_a_solid_is_chosen_by_its_number_or_all_are_fused(tmp_path: Path) -> None:
    """Blocks of 10 mm: two share a face, the third is 5 mm beside them."""
    blocks = [Pos(x, 0, 0) * Box(10, 10, 10) for x in (0, 10, 25)]
    three = kernel.compound(*(each.wrapped for each in blocks))
    chosen = valid_solid(three, "x.step", 3)
    assert kernel.bounds(chosen)[0] == pytest.approx([20, -5, -5], abs=1e-6)
    with pytest.raises(InputError, match="solid from 1 to 3, got 4"):
        valid_solid(three, "x.step", 4)
    apart = r"2 pieces, 5 mm apart at \(17.5, .*\) mm; take one of 1 from"
    with pytest.raises(InputError, match=apart):
        valid_solid(three, "x.step", "all")
    two = kernel.compound(*(each.wrapped for each in blocks[:2]))
    kernel_files.write_step(two, tmp_path / "two.step")
    fused = read_solid(tmp_path / "two.step", chosen="all")
    assert kernel.volume_properties(fused).Mass() == pytest.approx(2000.0)
    assert len(kernel.faces(fused)) == 6


def test_solids_that_overlap_are_fused_with_a_warning(
    caplog: pytest.LogCaptureFixture,
) -> None:
    both = kernel.compound(box(0, 10), box(5, 15))
    fused = valid_solid(both, "x.step", "all")
    assert kernel.volume_properties(fused).Mass() == pytest.approx(1875.0)
    assert "overlap by 6.2 %" in caplog.text


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_solid_is_refused(name: str) -> None:
    make, found = BAD[name]
    with pytest.raises(InputError, match=rf"x.step: expected .* found .*{found}"):
        valid_solid(make(), "x.step")


def test_neighbours_within_their_tolerances_are_no_overlap(tmp_path: Path) -> None:
    """An edge of 4.2 um, one end 3 um beside its curves, as files of other programs have them."""
    outline = [(0, 0), (60, 0), (60, 39.997), (59.997, 40), (0, 40)]
    plate = extrude(make_face(Polyline(*outline, close=True)), 10)
    kernel_files.write_step(plate.solid().wrapped, tmp_path / "plate.step")
    text = (tmp_path / "plate.step").read_text()
    ends = re.findall(r"VERTEX_POINT\('',(#\d+)\)", text)
    moved = 0
    for end in ends:
        old = f"{end} = CARTESIAN_POINT('',(59.997,40.,10.));"
        moved += old in text
        text = text.replace(old, old.replace("59.997,", "60.,"))
    assert moved == 1
    (tmp_path / "plate.step").write_text(text)
    shape = kernel_files.read_step(tmp_path / "plate.step")
    assert kernel.find_interferences(shape)
    solid = valid_solid(shape, "plate.step")
    assert kernel.volume_properties(solid).Mass() == pytest.approx(24000.0, rel=1e-4)


@pytest.mark.parametrize("deep", [0.1, 0.5, 5.0])
def test_an_overlap_is_refused_with_its_place(deep: float) -> None:
    with pytest.raises(InputError, match=r"self-intersecting solid at \(") as refused:
        valid_solid(crossing(deep), "two.step")
    place = re.search(r"at \((.*)\) mm", str(refused.value))
    assert place
    at = np.array([float(each) for each in place[1].split(",")])
    assert (at > 10 - deep - 0.1).all()
    assert (at < 10.1).all()


@pytest.mark.parametrize("count", [1, 4])
def test_the_winding_number_is_one_inside_and_zero_outside(count: int) -> None:
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
    sides = corners[[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]]
    points = np.array(
        [[0.1, 0.1, 0.1], [0.34, 0.34, 0.34], [5, 5, 5], [0.1, 0.1, -1e-6]]
    )
    several = np.concatenate([sides] * count)
    assert count_turns(points, several) == pytest.approx([count, 0, 0, 0], abs=1e-9)


def test_what_is_no_solid_is_refused_in_a_file(tmp_path: Path) -> None:
    path = tmp_path / "two.step"
    kernel_files.write_step(crossing(), path)
    with pytest.raises(InputError) as refused:
        read_solid(path)
    assert str(refused.value).startswith(
        f"{path}: expected a solid whose faces meet only at their edges, found"
    )


@pytest.mark.extended
def test_rubbish_is_refused(step: Path, tmp_path: Path) -> None:
    text = step.read_text()
    bodies = {
        "empty": ("", "a truncated one (0 bytes, no END-ISO-10303-21; at its end)"),
        "begun": (text[:6], "a truncated one (6 bytes"),
        "marked": (
            "\ufeff" + text,
            "begins with ISO-10303-21; found a byte order mark",
        ),
        "other": ("solid cube\nendsolid", "another format"),
        "torn": (text[: len(text) // 2], "a truncated one"),
        "hollow": (
            "ISO-10303-21;\nHEADER;\nENDSEC;\nDATA;\nENDSEC;\nEND-ISO-10303-21;\n",
            "no solid and no face",
        ),
        "scrambled": (
            text.replace("CARTESIAN_POINT('',(", "CARTESIAN_POINT('',(1E400,#7,"),
            "expected",
        ),
    }
    for name, (body, found) in bodies.items():
        path = tmp_path / f"{name}.step"
        path.write_text(body)
        with pytest.raises(InputError) as refused:
            read_solid(path)
        assert str(path) in str(refused.value)
        assert found in str(refused.value)
        assert "\n" not in str(refused.value)
    (tmp_path / "padded.step").write_text(text + 5000 * "\n")
    assert read_solid(tmp_path / "padded.step")
    with pytest.raises(InputError, match="got no file"):
        read_solid(tmp_path / "missing.step")
    with pytest.raises(InputError, match=r"within 0.01 s"):
        read_solid(step, time_limit=0.01)


@pytest.mark.parametrize(
    "said",
    [
        ("failed (exit code 1)", "MemoryError"),
        ("cannot allocate memory for thread", ""),
    ],
)
def test_a_lack_of_memory_is_no_fault_of_the_file(
    step: Path, monkeypatch: pytest.MonkeyPatch, said
) -> None:
    monkeypatch.setattr(
        cad_step, "do_alone", Mock(side_effect=WorkerError(said[0], 1, said[1]))
    )
    with pytest.raises(WorkerError):
        read_solid(step)


def test_stl_is_closed_and_has_the_volume(tmp_path: Path) -> None:
    part = build(LinkParameters())
    path = tmp_path / "link.stl"
    write_stl(part, path)
    facets = np.frombuffer(
        path.read_bytes()[84:],
        dtype=[("n", "<f4", 3), ("v", "<f4", (3, 3)), ("end", "<u2")],
    )
    a, b, c = np.moveaxis(facets["v"].astype(float), 1, 0)
    volume = np.einsum("ij,ij", a, np.cross(b, c)) / 6 * 1e-9
    assert volume == pytest.approx(mass_properties(part).volume, rel=0.01)


@pytest.mark.extended
def test_a_build123d_solid_is_a_part() -> None:
    build123d = pytest.importorskip("build123d")
    solid = build123d.Box(50, 20, 10) - build123d.Cylinder(3, 10)
    part = part_of(solid, name="block")
    assert part.loaded[0].reference_point == pytest.approx([0.025, 0, 0], abs=1e-12)
    again = build123d.Solid(part.solid)
    assert [face.area for face in again.faces()] == pytest.approx(
        [face.area * 1e6 for face in part.faces]
    )
    bent = build123d.Spline([(0, 0, 0), (0, 0, 20), (2, 0, 22), (4, 0, 20), (4, 0, 0)])
    with pytest.raises(InputError, match="a self-intersecting solid"):
        part_of(build123d.sweep((bent ^ 0) * build123d.Circle(3), bent).solid())


@pytest.mark.extended
def test_building_writes_nothing_to_standard_output() -> None:
    code = (
        "from stiffscope.cad.slider import SliderParameters as P\nfrom stiffscope.cad.solid import build\n"
        "build(P(rib_count=2, fillet=0.003))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert not done.stdout


@pytest.mark.parametrize("gone", ["LENGTH_UNIT", "GLOBAL_UNIT_ASSIGNED_CONTEXT"])
def test_a_file_without_a_unit_of_length_is_refused(tmp_path, gone):
    path = tmp_path / "box.step"
    write_step(part_of(Box(20, 10, 5), name="box"), path)
    text = path.read_text()
    path.write_text(text.replace(gone, "X" * len(gone)))
    with pytest.raises(
        InputError,
        match=r"box\.step: expected a STEP file with a unit of length, found no",
    ):
        read_solid(path)
