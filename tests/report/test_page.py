"""Reports in a browser: the robot turns and bends, nothing is asked of the network, none is kept out."""

import re
import time
from pathlib import Path

import numpy as np
import pytest
import pyvista as pv

from stiffscope.cli.main import _guarded
from stiffscope.experiments.assembly import assemble
from stiffscope.report import page
from stiffscope.report.drawing.geometry import pack_solids
from stiffscope.report.drawing.solids import Solid, solids_of
from stiffscope.report.page import Chart, RobotView, Section, Series
from stiffscope.report.robot_scene import place_robot, scene
from stiffscope.report.robot_view import Case, robot_view, unit_wrenches
from stiffscope.report.terminal import Shown, record_shown, show_line, show_table
from stiffscope.robot.mechanism_of import rigid_mechanism
from stiffscope.robot.reader import load_robot
from stiffscope.vjm.kinematics.configurations import configure
from stiffscope.vjm.statics.yielding import deflection
from tests.gap.test_diagnosis_report import write
from tests.report.browser import CHROMIUM, browser
from tests.report.test_terminal import diagnosed

pytestmark = pytest.mark.slow

AXE = Path(__file__).parent / "axe" / "node_modules" / "axe-core" / "axe.min.js"
DRAWN = "document.querySelector('.robot-view').dataset.drawn === 'yes'"
SET = """(name, value, event) => {
    const control = document.querySelector(`[data-is=${name}]`);
    if (control.type === 'checkbox') control.checked = value; else control.value = value;
    control.dispatchEvent(new Event(event, { bubbles: true }));
}"""

needs_chromium = pytest.mark.skipif(
    CHROMIUM is None, reason="Chromium is missing: apt-get install chromium"
)


@pytest.fixture(scope="module")
def tab():
    with browser() as opened:
        yield opened


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """The report of a run on published matrices."""
    folder = tmp_path_factory.mktemp("report")
    assert (
        _guarded(
            [
                "run",
                "biglide",
                "--components",
                "published",
                "--out",
                str(folder / "out"),
                "--quiet",
            ]
        )
        == 0
    )
    return folder / "out" / "report.html"


def opened(tab, report, **more):
    tab.events.clear()
    tab.open(report, **more)
    tab.wait(DRAWN)
    tab.settled()


def put(tab, name, value, event="input"):
    tab.run(
        f"({SET})({name!r}, {value!r}, {event!r})".replace("True", "true").replace(
            "False", "false"
        )
    )
    tab.settled()


def changed(one, other):
    return float(np.mean(np.abs(one.astype(int) - other).max(axis=2) > 24))


@needs_chromium
def test_the_robot_turns_bends_and_is_coloured(tab, report):
    opened(tab, report)
    first = tab.shot("canvas")
    assert len(np.unique(first.reshape(-1, 3), axis=0)) > 500
    assert changed(first, tab.shot("canvas")) == 0.0
    tab.run("document.querySelector('[data-is=right]').click()")
    tab.settled()
    assert changed(first, tab.shot("canvas")) > 0.02
    tab.run("document.querySelector('[data-is=reset]').click()")
    tab.settled()
    assert changed(first, tab.shot("canvas")) == 0.0
    put(tab, "before", False)
    bent = tab.shot("canvas")
    put(tab, "slider", 0)
    assert changed(bent, tab.shot("canvas")) > 0.01
    assert tab.run("document.querySelector('[data-is=amount]').textContent") == "× 0"
    put(tab, "colour", False)
    plain = tab.shot("canvas")
    red = (plain[..., 0] > 130) & (plain[..., 1] < 80) & (plain[..., 2] < 70)
    assert red.mean() > 0.002  # drives
    put(tab, "pose", "1", "change")
    assert changed(plain, tab.shot("canvas")) > 0.02
    assert "505.54 mm" in tab.run(
        "document.querySelector('[data-is=note]').textContent"
    )
    assert [
        e
        for e in tab.complaints()
        if e["params"].get("entry", {}).get("source") != "rendering"
    ] == []
    assert tab.requests() == [report.absolute().as_uri()]


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """A page of one pose and one of sixty."""
    folder = tmp_path_factory.mktemp("pages")
    robot = load_robot("biglide")
    mechanism = assemble(robot, "published")
    heights = np.linspace(0.33, 0.5, 60)
    found = configure(mechanism, [(0.0, 0.0, z) for z in heights]).require_valid()
    plain = scene(robot, mechanism)
    solids = solids_of(plain["bodies"], plain["joints"], plain["tool"], plain["up"])
    at_tool = {
        "node": plain["tool"]["node"],
        "at": np.asarray(plain["tool"]["at"]).tolist(),
    }
    colours = {
        "shades": ["#ffffff", "#000000"],
        "no_share": "#ffffff",
        "key": {},
        "tool": at_tool,
    }
    geometry = {**pack_solids(solids, plain["up"], 0.5), **colours}
    for count in (1, 60):
        some = found[np.arange(count)]
        names = [f"z = {z:.4f}" for z in heights[:count]]
        data = robot_view(
            geometry, some, names, unit_wrenches(mechanism, some), choice="load"
        )
        page.write_page(
            folder / f"{count}.html",
            "T",
            [],
            [Section("V", view=RobotView(data, "c", "w"))],
        )
    return folder / "1.html", folder / "60.html"


def test_sixty_poses_cost_little(pages):
    """One geometry for all of them: a pose adds numbers alone."""
    one, sixty = (file.stat().st_size for file in pages)
    assert sixty - one < 59 * 12_000


@needs_chromium
def test_sixty_poses_are_drawn(tab, pages):
    opened(tab, pages[1])
    assert tab.run("document.querySelectorAll('[data-is=pose] option').length") == 60


@pytest.mark.long
@needs_chromium
def test_time_to_open(report, pages):
    """Of a browser that has just been started: printed (-s)."""
    for file in (report, *pages):
        with browser() as cold:
            begun = time.perf_counter()
            cold.open(file)
            loaded = time.perf_counter() - begun
            cold.wait(DRAWN)
            drawn = time.perf_counter() - begun
        size = file.stat().st_size / 1e6
        times = f"{loaded:.2f} s to load, {drawn:.2f} s until drawn"
        print(f"{file.name}: {size:.2f} MB, {times}")  # noqa: T201


@needs_chromium
def test_drag_keys_and_choice_of_a_load(tab, report):
    opened(tab, report)
    first = tab.shot("canvas")
    x, y = tab.run(
        "(b => [b.x + b.width / 2, b.y + 40])(document.querySelector('canvas').getBoundingClientRect())"
    )
    mouse = {"button": "left", "buttons": 1, "clickCount": 1}
    tab.call("Input.dispatchMouseEvent", type="mousePressed", x=x, y=y, **mouse)
    for k in range(1, 5):
        tab.call(
            "Input.dispatchMouseEvent", type="mouseMoved", x=x + 25 * k, y=y, **mouse
        )
    tab.call("Input.dispatchMouseEvent", type="mouseReleased", x=x + 100, y=y, **mouse)
    tab.settled()
    dragged = tab.shot("canvas")
    assert changed(first, dragged) > 0.02
    tab.run("document.querySelector('canvas').focus()")
    tab.call("Input.dispatchKeyEvent", type="keyDown", key="ArrowUp")
    tab.settled()
    assert changed(dragged, tab.shot("canvas")) > 0.02
    tab.call(
        "Input.dispatchKeyEvent", type="keyDown", key="ArrowLeft", modifiers=8
    )  # Shift
    tab.settled()
    panned = tab.shot("canvas")
    tab.run("document.querySelector('[data-is=reset]').click()")
    tab.settled()
    assert changed(panned, tab.shot("canvas")) > 0.02
    inside = np.s_[4:-4, 4:-4]  # of the outline of what has the focus
    assert changed(first[inside], tab.shot("canvas")[inside]) == 0.0
    put(tab, "case", "2", "change")
    red, green, blue = np.moveaxis(tab.shot("canvas")[..., :3].astype(int), -1, 0)
    assert (
        (red > 200) & (abs(green - 115) < 35) & (blue < 40)
    ).sum() > 100  # the arrow of the force
    words = tab.run("document.querySelector('[data-is=note]').textContent")
    assert "tool moves 0.08066 µm" in words  # 1 N over 12.4 N/µm along z at Q1


@needs_chromium
def test_paper_shows_each_picture_once_and_every_table(tab, report):
    opened(tab, report)
    tab.run("dispatchEvent(new Event('beforeprint'))")
    tab.call("Emulation.setEmulatedMedia", media="print")
    seen = "[...document.querySelectorAll('img')].filter(e => e.offsetParent !== null).map(e => e.src)"
    pictures = tab.run(seen)
    assert len(pictures) == len(set(pictures)) >= 3
    hidden = tab.run(
        "[...document.querySelectorAll('table')].filter(e => e.offsetHeight < 20).length"
    )
    assert hidden == 0
    tab.call("Emulation.setEmulatedMedia", media="")


@needs_chromium
def test_the_part_under_the_pointer_is_named(tab, report):
    opened(tab, report)
    tab.run("document.querySelector('canvas').scrollIntoView()")
    left, top, wide, high = tab.run(
        "(b => [b.x, b.y, b.width, b.height])(document.querySelector('canvas').getBoundingClientRect())"
    )
    said = set()
    for x, y in np.random.default_rng(1).uniform(0.2, 0.8, (60, 2)):
        tab.call(
            "Input.dispatchMouseEvent",
            type="mouseMoved",
            x=left + x * wide,
            y=top + y * high,
        )
        said.add(
            tab.run(
                "(t => t.hidden ? '' : t.textContent)(document.querySelector('[data-is=tip]'))"
            )
        )
    assert "" in said  # the ground behind the robot
    shares = {
        words.partition(": ")[0]: float(words.partition(": ")[2].split(" %")[0])
        for words in said
        if ": " in words
    }
    assert {"limb1.link2", "limb2.link1"} & shares.keys()
    assert all(0.0 <= share <= 100.0 for share in shares.values())


@needs_chromium
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_every_series_of_a_chart_is_seen_on_its_page(tab, tmp_path, scheme):
    """A dark series on a dark page has a contrast of 4.5; on a light page colours are those of the figures."""
    columns = {"mass": [1.0, 2.0], "stiffness": [3.0, 4.0]}
    colours = ["#4a555f", "#2f7d6b", "#101010"]
    series = [Series(each, each, columns) for each in colours]
    chart = Chart(series, ["mass"], ["stiffness"], "All.", joined=True)
    file = tmp_path / "chart.html"
    page.write_page(file, "T", [], [Section("Designs", charts=[chart])])
    tab.open(file, **{"prefers-color-scheme": scheme})
    tab.wait("document.querySelector('.chart [data-is=plot]').clientHeight > 300")
    drawn = tab.run(
        "Bokeh.documents.flatMap(d => [...d._all_models.values()])"
        ".filter(m => m.type === 'Line').map(m => m.line_color.value || m.line_color)"
    )
    shown = {each for each in drawn if str(each).startswith("rgb")}
    wanted = [tuple(bytes.fromhex(each[1:])) for each in colours]
    found = [tuple(map(int, re.findall(r"\d+", each))) for each in shown]
    if scheme == "light":
        assert set(found) >= set(wanted)
        return

    def luminance(colour):
        linear = [
            v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4
            for v in (each / 255 for each in colour)
        ]
        return 0.05 + np.dot(linear, [0.2126, 0.7152, 0.0722])

    ground = luminance(bytes.fromhex("171b1f"))
    assert len(found) == 3
    assert min(luminance(each) for each in found) >= 4.4 * ground


@needs_chromium
def test_a_chart_says_what_a_point_is_and_finds_its_row(tab, tmp_path):
    columns = {
        "design": ["1", "2", "3"],
        "mass, kg": [1.0, 2.0, 3.0],
        "stiffness, N/µm": [10.0, 40.0, 20.0],
    }
    names = list(columns)[1:]
    chart = Chart(
        [Series("feasible", "#2f7d6b", columns, size=30)],
        names,
        names[::-1],
        "Every design.",
        joined=True,
        log=True,
    )
    rows = tuple(
        (str(k), f"{m} kg") for k, m in zip(columns["design"], (1, 2, 3), strict=True)
    )
    table = Shown("All designs", ("design", "mass"), rows * 3, folded=True)
    page.write_page(
        tmp_path / "chart.html", "T", [], [Section("Designs", [table], charts=[chart])]
    )
    tab.events.clear()
    tab.open(tmp_path / "chart.html")
    tab.wait("document.querySelector('.chart [data-is=plot]').clientHeight > 300")
    tab.settled()
    shot = tab.shot(".chart [data-is=plot]")
    left, top = tab.run(
        "(b => [b.x, b.y])(document.querySelector('.chart [data-is=plot]').getBoundingClientRect())"
    )
    red, green, blue = np.moveaxis(shot[..., :3].astype(int), -1, 0)
    heights, places = np.nonzero((green - red > 40) & (green > blue))
    third = places > places.max() - 30
    at = {
        "x": left + places[third].mean(),
        "y": top + heights[third].mean(),
        "button": "left",
        "clickCount": 1,
    }
    tab.call("Input.dispatchMouseEvent", type="mouseMoved", x=at["x"], y=at["y"])
    for kind in ("mousePressed", "mouseReleased"):
        tab.call("Input.dispatchMouseEvent", type=kind, **at)
    tab.wait("document.querySelector('tr.found') !== null")
    assert tab.run("document.querySelector('tr.found').textContent") == "33 kg"
    assert tab.run("document.querySelector('details').open")
    heads = (
        "[...document.querySelectorAll('tbody th')].map(e => e.textContent).join('')"
    )
    tab.run("document.querySelector('thead button').click()")
    assert tab.run(heads) == "111222333"
    tab.run("document.querySelector('thead button').click()")
    assert tab.run(heads) == "333222111"
    assert tab.complaints() == []
    assert tab.requests() == [(tmp_path / "chart.html").absolute().as_uri()]


@needs_chromium
@pytest.mark.parametrize("width", [390, 1200])
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("of", ["run", "diagnosis"])
def test_fits_its_width_and_axe_finds_nothing(tab, report, tmp_path, of, width, scheme):
    if of == "run":
        opened(tab, report, width=width, prefers_color_scheme=scheme)
    else:
        write(tmp_path, diagnosed())
        tab.open(tmp_path / "report.html", width=width, prefers_color_scheme=scheme)
    assert tab.run("document.documentElement.scrollWidth") <= width
    tools = tab.run(
        "[...document.querySelector('.tools').children].map(b => b.textContent)"
    )
    assert tools == ["Copy", "Save CSV"]
    if not AXE.exists():
        pytest.skip("axe-core is missing: npm ci --prefix tests/report/axe")
    tab.run(AXE.read_text() + ";0")
    found = tab.run(
        "axe.run().then(r => r.violations.map(v => [v.id, v.nodes.map(n => n.html.slice(0, 120))]))"
    )
    assert found == []


@pytest.mark.extended
@needs_chromium
def test_without_webgl_a_picture_stands_in_its_place(report):
    with browser("--disable-webgl", "--disable-3d-apis") as tab:
        tab.open(report)
        shown = "e => e.offsetParent !== null"
        assert tab.run(f"({shown})(document.querySelector('.robot-view .still img'))")
        assert not tab.run(f"({shown})(document.querySelector('canvas'))")
        caption = tab.run("document.querySelector('.robot-view figcaption').innerText")
        assert caption.startswith("The robot at ")
        assert "coloured" not in caption
        tab.call("Emulation.setScriptExecutionDisabled", value=True)
        tab.open(report)
        whole = tab.shot(whole=True)
        assert changed(whole, np.full_like(whole, 255)) > 0.05


@needs_chromium
def test_the_viewer_bends_bodies_as_the_pictures_do(tab, tmp_path):
    """Outlines: bent by the viewer from two twists a body, and of surfaces that Python's drawing has bent."""
    robot = load_robot("biglide")
    mechanism = rigid_mechanism(robot)
    found = configure(mechanism, [robot.poses["Q1"]])
    here = place_robot(found)
    spread = np.random.default_rng(3)
    twists = {node: spread.normal(scale=[0.02] * 3 + [0.15] * 3) for node in here.moves}
    bent = {"ground": (np.eye(3), np.zeros(3)), **here.deform(twists, 1.0)}
    plain = scene(robot, mechanism)
    solids = solids_of(plain["bodies"], plain["joints"], plain["tool"], plain["up"])
    far = pv.PolyData.from_regular_faces(
        np.array([[-1, -1, -1], [-1, -1, -1], [1, 1, 1]], float), [[0, 1, 2]]
    )
    frame = Solid(
        "frame", far, "#ffffff", ("ground",)
    )  # no area: it fixes what the camera sees
    given = [
        Solid(solid.element, solid.move(bent), solid.colour, ("ground",))
        for solid in solids
    ]
    tool = plain["tool"]
    (turn, shift) = bent[plain["tool"]["node"]]
    seen = {}
    for name, shapes, point, case in (
        ("bent", solids, tool, [Case("c", "", twists, {})]),
        (
            "given",
            given,
            {"node": "ground", "at": (turn @ tool["at"] + shift).tolist()},
            [],
        ),
    ):
        geometry = pack_solids([*shapes, frame], plain["up"], 0.5)
        at_tool = {**point, "at": np.asarray(point["at"]).tolist()}
        colours = {
            "shades": ["#ffffff"] * 2,
            "no_share": "#ffffff",
            "key": {},
            "tool": at_tool,
        }
        data = robot_view({**geometry, **colours}, found, ["Q1"], [case], choice="load")
        for each in data["poses"][0]["cases"]:
            each["factor"] = 1.0
        page.write_page(
            tmp_path / f"{name}.html",
            name,
            [],
            [Section("V", view=RobotView(data, "c", "w"))],
        )
        opened(tab, tmp_path / f"{name}.html")
        put(tab, "before", False)
        seen[name] = tab.shot("canvas").min(axis=2) < 225
        if case:
            put(tab, "slider", 0)
            seen["straight"] = tab.shot("canvas").min(axis=2) < 225
    size = seen["given"].sum()
    assert size > 5_000
    assert (seen["bent"] ^ seen["given"]).sum() < 0.02 * size
    assert (seen["straight"] ^ seen["given"]).sum() > 0.3 * size


def test_unit_wrenches_yield_what_the_deflection_says():
    """Shares of energy and tool displacement beside those of the deflection under each wrench."""
    robot = load_robot("biglide")
    mechanism = assemble(robot, "published")
    found = configure(mechanism, list(robot.poses.values()))
    for k, cases in enumerate(unit_wrenches(mechanism, found)):
        assert len(cases) == 6
        for i, case in enumerate(cases):
            wanted = deflection(mechanism, found, np.eye(6)[i])
            assert case.twists[mechanism.tool.body] == pytest.approx(
                wanted.twist[k], rel=1e-9
            )
            assert case.shares == pytest.approx(
                {name: share[k] for name, share in wanted.shares.items()}, abs=1e-12
            )


def test_a_page_shows_what_the_terminal_shows(tmp_path, capsys):
    with record_shown() as shown:
        show_table(
            "T <b>",
            (("pose", ""), ("K", "why")),
            [("Q<1>", "", "1.5", "words")],
            prose=("why",),
        )
        show_line("  a note")
    assert capsys.readouterr().out == ""
    assert shown == [
        Shown(
            "T <b>",
            ("pose", "K", "why"),
            (("Q<1>", "1.5", "words"),),
            frozenset({"why"}),
        ),
        Shown("a note"),
    ]
    page.write_page(
        tmp_path / "page.html", "a <script>", ["f & g"], [Section("H", shown)]
    )
    text = (tmp_path / "page.html").read_text()
    assert "a <script>" not in text
    for words in (
        "a &lt;script&gt;",
        "Q&lt;1&gt;",
        "T &lt;b&gt;",
        "f &amp; g",
        "a note",
    ):
        assert words in text
    show_line("again on the terminal")
    assert capsys.readouterr().out
