"""What determines a part's experiment, for parts of every shape and name."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from stiffscope.cad.link import LinkParameters
from stiffscope.errors import InputError
from stiffscope.experiments.experiments import compliance_json, solve_parts
from stiffscope.experiments.orders import build_part, order_part
from stiffscope.experiments.watching import keep_meshed
from stiffscope.robot.part_matrices import beam_compliance
from stiffscope.robot.reader import load_robot
from stiffscope.runtime.workshop import workshop
from tests.experiments.one_part import MATRIX, PLATE, ROD, STEP, one_part, write_bar

pytestmark = pytest.mark.slow

NAME = "bar 1"


def test_the_shape_of_a_part_decides_its_solid_whatever_its_name(tmp_path):
    rod, plate = (order_part(one_part(tmp_path, part), NAME) for part in (ROD, PLATE))
    assert (rod.shape, plate.shape) == ("rod", "plate")
    assert rod.solid == LinkParameters(length=0.06, radius=0.006)
    assert (
        len({rod.key(), plate.key(), dataclasses.replace(rod, name="other").key()}) == 3
    )
    part = build_part(one_part(tmp_path, ROD), NAME)
    assert (part.name, len(part.clamped)) == (NAME, 1)
    np.testing.assert_allclose(part.loaded[0].reference_point, [0.06, 0, 0], atol=1e-12)


def test_numbers_of_absent_features_ask_for_no_new_experiment():
    plain, *others = (
        order_part(load_robot("biglide", overrides), "slider")
        for overrides in ([], ["slider.rib_height=20mm"], ["slider.pad_width=40mm"])
    )
    assert all(each == plain and each.key() == plain.key() for each in others)
    assert (
        order_part(
            load_robot("biglide", ["slider.foundation=50 N/mm^3"]), "slider"
        ).key()
        != plain.key()
    )


def test_a_step_file_is_known_by_its_content_faces_and_axes(tmp_path):
    for name in ("bar.step", "same.step"):
        (tmp_path / name).write_text("solid")
    (tmp_path / "other.step").write_text("another")
    keys = {
        order_part(
            one_part(tmp_path, STEP.replace("bar.step", file) + more), NAME
        ).key()
        for file, more in [
            ("bar.step", ""),
            ("same.step", ""),
            ("other.step", ""),
            ("bar.step", "\nz = [0, 1, 0]"),
            ("bar.step", "\nclamped = [{index = 1}]"),
            ("bar.step", '\nreference_point = ["60 mm", 0, 0]'),
        ]
    }
    assert len(keys) == 5
    with pytest.raises(
        InputError,
        match=r'robot\.toml:6: parts\."bar 1"\.file: expected a STEP file, got no file',
    ):
        order_part(one_part(tmp_path, STEP.replace("bar.step", "none.step")), NAME)


def test_a_step_file_is_named_as_it_was_given(tmp_path, monkeypatch):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "bar.step").write_text("ISO-10303-21 cut")
    monkeypatch.chdir(tmp_path)
    robot = one_part(Path("parts"), STEP)
    for build in (
        lambda: order_part(robot, NAME).build(),
        lambda: order_part(robot, NAME, "parts/bar.step").build(),
    ):
        with pytest.raises(
            InputError,
            match=r"^parts/bar\.step: expected a whole STEP file, found a truncated one",
        ):
            build()


def test_a_given_step_file_takes_the_place_of_any_part(tmp_path):
    (tmp_path / "given.step").write_text("solid")
    given = tmp_path / "given.step"
    for part in (ROD, PLATE, STEP, f'{MATRIX}\nmaterial = "steel"'):
        order = order_part(one_part(tmp_path, part), NAME, given)
        assert (order.shape, order.step.path) == ("step", given)
    faces = order_part(
        one_part(tmp_path, f"{STEP}\nclamped = [{{index = 1}}]"), NAME, given
    ).step.clamped
    assert faces[0].index == (1,)
    with pytest.raises(
        InputError,
        match=r'parts\."bar 1"\.material: expected the material of the solid, got none',
    ):
        order_part(one_part(tmp_path, MATRIX), NAME, given)


def test_parts_that_have_no_experiment_are_refused(tmp_path):
    robot = one_part(tmp_path, MATRIX)
    with pytest.raises(
        InputError,
        match=r'robot\.toml:5: parts\."bar 1"\.shape: expected a shape that is a solid, .*, got "matrix"',
    ):
        order_part(robot, NAME)
    with pytest.raises(InputError, match="expected one of bar 1, got 'link'"):
        build_part(robot, "link")


@pytest.mark.parametrize("name", ["../up", "a/b", "..", r"a\\b"])
def test_a_part_names_a_folder_of_results(tmp_path, name):
    text = one_part(tmp_path, ROD).path.read_text().replace('"bar 1"', f'"{name}"')
    (tmp_path / "robot.toml").write_text(text)
    with pytest.raises(
        InputError, match=r"robot\.toml:4: parts\..*: expected a name that a file"
    ):
        load_robot(tmp_path / "robot.toml")


@pytest.mark.extended
def test_the_mesh_of_a_former_part_is_moved_along_where_it_can_be(
    tmp_path, monkeypatch
):
    monkeypatch.setenv("STIFFSCOPE_CACHE", str(tmp_path / "cache"))
    plate = (
        PLATE + '\nmesh = { size = "20 mm" }'
    )  # a rod's mesh may have an element so flat that it must be made anew
    thicker = plate.replace("10 mm", "10.2 mm")
    texts = (
        plate,
        thicker,
        thicker.replace("20 mm", "21 mm"),
    )  # which asks for other elements
    orders = [order_part(one_part(tmp_path, text), NAME) for text in texts]
    with workshop() as shop:
        held = {}
        meshes = []
        for order in orders:
            (part,) = solve_parts([order], shop, whole=False, near=held)
            keep_meshed(held, {NAME: part})
            meshes.append(part.experiment.mesh)
    same = [np.array_equal(mesh.cells, meshes[0].cells) for mesh in meshes]
    assert same == [True, True, False]
    assert held[NAME].order == orders[2]


@pytest.mark.extended
def test_what_scripts_read_of_a_rod_and_of_a_step_file_in_its_place(
    tmp_path, monkeypatch
):
    monkeypatch.setenv("STIFFSCOPE_CACHE", str(tmp_path / "cache"))
    robot = one_part(tmp_path, ROD)
    write_bar(tmp_path / "given.step", shift=-0.03)
    orders = [
        order_part(robot, NAME),
        order_part(robot, NAME, tmp_path / "given.step", label="given"),
    ]
    with workshop() as shop:
        with monkeypatch.context() as patch:
            patch.setattr("stiffscope.fea.run.compute_dynamics", None)
            (condensed,) = solve_parts(orders[:1], shop, whole=False)
        rod, bar = solve_parts(orders, shop)
        again = solve_parts(orders[:1], shop)[0]
        held = solve_parts(orders, shop, whole=False)
    same = rod.experiment  # on the mesh of the condensed one
    np.testing.assert_allclose(condensed.compliance, same.compliance, rtol=1e-10)
    np.testing.assert_allclose(condensed.error, same.error, rtol=1e-10)
    np.testing.assert_allclose(
        condensed.experiment.condensed_mass, same.condensed_mass[:12, :12], atol=1e-12
    )
    assert [each.reused for each in (condensed, *held)] == [False, True, True]
    assert condensed.solid == rod.solid
    assert {each.name for each in condensed.folder.iterdir()} == {
        "entry.json",
        "experiment.npz",
        "solid.json",
    }
    told = compliance_json(robot, rod)
    given = compliance_json(robot, bar)
    assert (told["part"], told["solid"], given["solid"]) == (
        NAME,
        "parametric",
        "given.step",
    )
    assert told["axes"].startswith("x along the rod")
    np.testing.assert_array_equal(told["beam"], beam_compliance(robot, NAME))
    assert given["beam"] is None
    assert (rod.reused, again.reused) == (False, True)
    assert (rod.length, bar.length) == pytest.approx((0.06, 0.06))
    assert (rod.folder / f"{NAME}.step").is_file()
    assert json.loads((rod.folder / "solid.json").read_text())[
        "clamped_centre"
    ] == pytest.approx([0, 0, 0], abs=1e-9)
    np.testing.assert_allclose(
        np.diag(rod.compliance), np.diag(told["beam"]), rtol=0.06
    )
