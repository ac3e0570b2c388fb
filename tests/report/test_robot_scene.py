"""Pictures of robots: what is given to the drawing process, and what it draws."""

import time
from dataclasses import replace
from itertools import combinations
from types import SimpleNamespace

import numpy as np
import psutil
import pytest
import pyvista as pv
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from examples.delta import delta as hanging_delta
from stiffscope.gap.inference.diagnosis import Where
from stiffscope.gap.show.text import shares
from stiffscope.report.drawing.robot import ABOVE, _put_labels, frame_picture, key_of
from stiffscope.report.drawing.solids import solids_of
from stiffscope.report.pictures import PictureError, draw, open_drawing
from stiffscope.report.robot_scene import place_robot, scene
from stiffscope.robot.mechanism_of import rigid_mechanism
from stiffscope.robot.reader import load_robot, read_robot
from stiffscope.vjm.kinematics.configurations import configure
from tests.report.test_terminal import diagnosed

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def delta():
    robot = load_robot("delta")
    mechanism = rigid_mechanism(robot)
    return robot, mechanism, configure(mechanism, robot.poses["side"])


def test_nodes_move_as_the_configuration_says(delta):
    _, mechanism, there = delta
    moved = place_robot(there).moves
    for body in mechanism.bodies:
        if body.elastic is not None:
            for node, home in zip(
                body.nodes, (body.elastic.base, body.elastic.tip), strict=True
            ):
                rotation, position = moved[node]
                axes, place = (each[0] for each in there.frame(node))
                assert np.allclose(rotation @ home + position, place, atol=1e-12)
                assert np.allclose(rotation @ body.elastic.axes, axes, atol=1e-12)
    for joint in mechanism.joints:  # every joint here is held together at its point
        ends = [
            moved[n][0] @ joint.at + moved[n][1]
            for n in (joint.first, joint.second)
            if n in moved
        ]
        assert np.ptp(ends, axis=0).max() < 1e-11


@pytest.mark.parametrize("length", [60, 94, 95, 160])
def test_a_title_is_within_its_picture(length):
    """However many coordinates a pose has."""
    title = ("Share of the gap, rx = 4.257 deg, " * 5)[:length]
    figure = frame_picture(
        np.ones((80, 1200, 3)), SimpleNamespace(size=(1200, 80)), title
    )
    drawn = FigureCanvasAgg(figure).get_renderer()
    assert figure.texts[0].get_window_extent(drawn).x1 < figure.bbox.width


def test_the_pixels_of_a_picture_are_the_cameras(rng):
    image = rng.integers(0, 256, (80, 1200, 3), dtype=np.uint8)
    figure = frame_picture(image, SimpleNamespace(size=(1200, 80)), "")
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    assert (np.asarray(canvas.buffer_rgba())[ABOVE : ABOVE + 80, :, :3] == image).all()


def test_a_robot_made_in_python_stands_upright():
    assert scene(None, hanging_delta())["up"].tolist() == [0.0, 0.0, -1.0]


def test_base_and_tool_have_their_shares(delta):
    """The ground's solids show what the base has of the gap, the tool's body what the tool has."""
    robot, mechanism, _ = delta
    found = shares(
        robot, replace(diagnosed(), where=Where({}, {"base": 0.9, "tool": 0.1}))
    )
    assert found == {"ground": 0.9, "platform": 0.1}
    drawn = scene(robot, mechanism)
    solids = solids_of(drawn["bodies"], drawn["joints"], drawn["tool"], drawn["up"])
    assert set(found) <= {solid.element for solid in solids}


def test_deformed_nodes(delta):
    """Twists of one rigid motion keep distances to first order; the tool goes where its own twist says."""
    _, mechanism, there = delta
    here = place_robot(there)
    moved = here.moves
    at = there.tool[0, :3]
    twist = np.array([1e-3, 2e-3, -1e-3, 4e-3, -2e-3, 1e-3])
    twists = dict.fromkeys(moved, twist)
    factor = here.exaggeration(twists)
    bent = here.deform(twists, factor)
    for node, (rotation, position) in bent.items():
        x = moved[node][0] @ mechanism.tool.at + moved[node][1]
        wanted = x + factor * (twist[:3] + np.cross(twist[3:], x - at))
        assert np.allclose(rotation @ mechanism.tool.at + position, wanted, atol=1e-12)
    assert f"{factor:g}"[0] in "125"
    assert here.deform({}, factor)["platform"][1] == pytest.approx(moved["platform"][1])


@pytest.mark.parametrize(
    "name", ["biglide", "delta", "five-bar", "orthoglide", "serial-arm", "stewart"]
)
def test_solids_stand_where_their_bodies_are(name):
    """Rods from base to tip, a driven joint in red, one solid at least for each body and joint."""
    robot = load_robot(name)
    mechanism = rigid_mechanism(robot)
    plain = scene(robot, mechanism)
    solids = solids_of(plain["bodies"], plain["joints"], plain["tool"], plain["up"])
    drawn = {solid.element for solid in solids}
    assert {b.name for b in mechanism.bodies} <= drawn
    assert {j.name for j in mechanism.joints if j.kind != "fixed"} <= drawn
    red = {solid.element for solid in solids if solid.colour == "#c0392b"}
    assert red == {j.name for j in mechanism.drives}
    for solid in solids:
        body = next(
            (
                b
                for b in mechanism.bodies
                if b.name == solid.element and b.elastic is not None
            ),
            None,
        )
        if body is not None:
            along = (
                np.asarray(solid.surface.points) - body.elastic.base
            ) @ body.elastic.axes[:, 0]
            assert along.min() == pytest.approx(0.0, abs=1e-6)
            assert along.max() == pytest.approx(
                np.linalg.norm(body.elastic.tip - body.elastic.base), rel=1e-3
            )


def test_rigid_bodies_have_colours_and_names_and_hide_no_other():
    """A frame whose feet stand around the platform and whose drives hang above it is no hull about it."""
    at = [[1, 0, 0], [-1, 1, 0], [-1, -1, 0], [0, 0, 1]]
    joints = [
        {
            "name": f"j{k}",
            "kind": "revolute",
            "first": "ground" if k < 3 else "frame",
            "at": np.array(p, float),
            "second": "frame" if k < 3 else "platform",
            "axis": np.eye(3)[2],
            "driven": k == 3,
            "low": None,
            "high": None,
        }
        for k, p in enumerate(at)
    ]
    bodies = [{"name": name, "nodes": (name,)} for name in ("frame", "platform")]
    tool = {"node": "platform", "at": np.array([0, 0, 0.3])}
    colours = {
        each.element: each.colour
        for each in solids_of(bodies, joints, tool, np.eye(3)[2])
    }
    named = key_of(bodies)
    assert [named[name] for name in ("frame", "platform")] == [
        colours[name] for name in ("frame", "platform")
    ]
    assert colours["frame"] != colours["platform"]
    frame = pv.merge(
        [
            s.surface
            for s in solids_of(bodies, joints, tool, np.eye(3)[2])
            if s.element == "frame"
        ]
    )
    assert frame.volume < 0.1  # m³; the pyramid of its joints has 2/3
    assert "rigid" in key_of(bodies[:1])


@pytest.mark.extended
def test_picture_of_a_deformed_robot_with_the_users_own_surface(delta, tmp_path):
    robot = delta[0]
    pv.Cube(center=(0, 0, -1.06), x_length=0.2, y_length=0.2, z_length=0.02).save(
        tmp_path / "plate.stl"
    )
    text = robot.path.read_text().replace(
        "[bodies.platform]", '[bodies.platform]\nmesh = "plate.stl"'
    )
    robot = read_robot(tmp_path / "delta.toml", text)
    mechanism = rigid_mechanism(robot)
    home = place_robot(configure(mechanism, mechanism.tool.home))
    bent = home.deform({"platform": np.array([0, 0.2, 0, 0, 0, 0])}, 1.0)
    shown = {"file": "a.png", "title": "Delta", "moves": bent, "before": home.moves}
    plain = scene(robot, mechanism) | {"shares": {"leg1.arm": 0.7, "leg2.arm": 0.3}}
    draw("robot", tmp_path, pictures=[shown], scale="share of energy", **plain)
    image = pv.read(tmp_path / "a.png")
    assert image.dimensions[0] == 1200
    colours = np.unique(np.asarray(image.point_data.active_scalars)[:, :3], axis=0)
    assert len(colours) > 1000
    assert 20_000 < (tmp_path / "a.png").stat().st_size < 400_000


@pytest.mark.extended
@pytest.mark.usefixtures("drawn_anew")
def test_a_process_that_is_ready_ahead_draws_the_same_picture(delta, tmp_path):
    robot, mechanism, there = delta
    plain = scene(robot, mechanism)
    shown = {"title": "Delta", "moves": place_robot(there).moves}
    with open_drawing(ahead=True) as draw_now:
        draw_now("robot", tmp_path, pictures=[shown | {"file": "ahead.png"}], **plain)
    draw("robot", tmp_path, pictures=[shown | {"file": "now.png"}], **plain)
    assert (tmp_path / "ahead.png").read_bytes() == (tmp_path / "now.png").read_bytes()


@pytest.mark.extended
@pytest.mark.usefixtures("drawn_anew")
def test_a_process_that_fails_says_why_and_one_that_is_not_asked_ends(tmp_path):
    with (
        open_drawing(ahead=True) as draw_now,
        pytest.raises(PictureError, match="KeyError: 'nothing'"),
    ):
        draw_now("nothing", tmp_path)
    others = psutil.Process().children()
    with open_drawing(ahead=True):
        pass
    assert psutil.Process().children() == others


@pytest.mark.extended
@pytest.mark.usefixtures("drawn_anew")
def test_a_process_that_is_killed_is_not_taken_for_missing_graphics(delta, tmp_path):
    robot, mechanism, there = delta
    others = psutil.Process().children()
    with open_drawing(ahead=True) as draw_now:
        while not (
            started := [
                each for each in psutil.Process().children() if each not in others
            ]
        ):
            time.sleep(0.01)
        started[0].kill()
        again = {
            "file": "again.png",
            "title": "Delta",
            "moves": place_robot(there).moves,
        }
        draw_now("robot", tmp_path, pictures=[again], **scene(robot, mechanism))
    assert (tmp_path / "again.png").exists()


@pytest.mark.usefixtures("drawn_anew")
@pytest.mark.long
def test_a_process_without_a_home_leaves_nothing_when_it_is_killed(
    tmp_path, monkeypatch
):
    """Matplotlib then makes a temporary folder for what it keeps."""
    monkeypatch.delenv("MPLCONFIGDIR", raising=False)
    for name in ("HOME", "XDG_CONFIG_HOME", "XDG_CACHE_HOME"):
        monkeypatch.setenv(name, "/dev/null")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    ends = time.monotonic() + 60
    with open_drawing(ahead=True):
        while not list(tmp_path.rglob("matplotlib-*")) and time.monotonic() < ends:
            time.sleep(0.05)
        assert time.monotonic() < ends
    assert not list(tmp_path.iterdir())


def test_labels_of_crowded_joints_stand_beside_each_other_and_near():
    """As in an imported machine: 60 joints on a few centimetres, each of six universal ones twice in one place."""
    points = np.random.default_rng(3).uniform(300, 600, (60, 2))
    view = SimpleNamespace(size=(1200, 960), pixel=lambda point: point)
    labels = [
        (point, "cylindrical" if n % 3 else f"rod{n}?", "black")
        for n, point in enumerate(points)
    ]
    labels += [
        (np.array([40.0, 100.0 * n]), "revolute", "black") for n in range(1, 7)
    ] * 2
    figure = Figure(figsize=(12, 10.36), dpi=100)
    _put_labels(figure, view, labels, raised=30.0)
    FigureCanvasAgg(figure).draw()
    boxes = [text.get_window_extent() for text in figure.texts]
    assert sum(text.get_text() == "2 x revolute" for text in figure.texts) == 6
    assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))
    ends = [
        np.diff(line.get_xydata() * (1200, 1036), axis=0)
        for line in figure.findobj(Line2D)
    ]
    assert len(ends) >= 60
    assert max(np.linalg.norm(end) for end in ends) < 250
