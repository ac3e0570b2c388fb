"""The live view: what sliders give is what the robot file with these values gives; only who has the token is served."""

import asyncio
import contextlib
import json
import re
import shutil
import threading
import time
from concurrent.futures import Future
from pathlib import Path

import numpy as np
import pytest
from tornado.httpclient import AsyncHTTPClient, HTTPClientError, HTTPRequest
from tornado.websocket import websocket_connect

import stiffscope as ss
from stiffscope.data import FOLDER
from stiffscope.errors import InputError
from stiffscope.experiments.assembly import assemble_robots
from stiffscope.live.page import (
    Setting,
    answer,
    find_choices,
    find_sliders,
    read_setting,
)
from stiffscope.live.server import LiveRobot, open_server
from stiffscope.robot.reader import read_robot
from stiffscope.runtime.workshop import workshop
from tests.report.browser import CHROMIUM, browser
from tests.robot.test_bearings import SLIDE

pytestmark = pytest.mark.slow

HOME = [0.0, 0.0, -1.0643]
STILL = {"values": {}, "pose": HOME, "load": [0.0] * 6}


async def follow(server, *orders):
    """What the socket says after each order, until the key that is waited for."""
    socket = await websocket_connect(
        HTTPRequest(
            server.address.replace("http", "ws").replace("/?", "/socket?"),
            headers={"Origin": origin(server)},
        )
    )
    said = []
    for order, key in orders:
        await socket.write_message(
            order if isinstance(order, str) else json.dumps(order)
        )
        while True:
            message = json.loads(await asyncio.wait_for(socket.read_message(), 60))
            if message.get(key) and not message.get("stale"):
                said.append(message[key])
                break
    socket.close()
    return said


def origin(server):
    return server.address.split("/?")[0]


def run(robot, work):
    async def main():
        server = open_server(robot)
        try:
            return await work(server)
        finally:
            server.http.stop()

    return asyncio.run(main())


def shown_stiffness(html):
    cells = re.findall(r"<td>([^<]*)</td>", html.split("<tbody>")[1].split("</tr>")[0])
    return [float(cell) for cell in cells[1:7]]


@pytest.fixture
def delta():
    return LiveRobot(ss.load_robot("delta"), "beam")


def test_sliders_give_what_the_robot_file_with_their_values_gives(delta):
    motor = "leg1.motor.drive.stiffness"
    slider = next(each for each in find_sliders(delta.robot) if each.name == motor)
    asked = STILL | {"values": {motor: 0.5 * slider.value}}
    before, now = run(
        delta, lambda server: follow(server, (STILL, "tables"), (asked, "tables"))
    )
    for html, values in (
        (before, []),
        (now, [f"joints.{motor}={0.5 * slider.value!r}"]),
    ):
        machine = ss.assemble(ss.load_robot("delta", values), "beam")
        expected = np.diag(ss.stiffness(machine, [HOME])[0])
        assert np.allclose(1e3 * np.array(shown_stiffness(html)), expected, rtol=1e-3)
    assert shown_stiffness(now)[2] < shown_stiffness(before)[2]


def test_a_robot_without_masses_has_no_frequencies():
    robot = read_robot(Path("robot.toml"), SLIDE, ["tool.at=[0, 0, 0.1]"])
    asked = Setting(
        {each.name: each.value for each in find_sliders(robot) if "." in each.name},
        (0.0,),
        (0.0,) * 6,
    )
    with workshop() as shop:
        made = assemble_robots({"": robot}, None, shop)[""]
    tables = str(answer(made, asked)["tables"])
    assert "K_tx" in tables
    assert "Hz" not in tables


def test_load_and_next_words_follow_and_nonsense_is_one_line(delta):
    loaded = STILL | {"load": [0.0, 0.0, -100.0, 0.0, 0.0, 0.0]}
    away = STILL | {"pose": [5.0, 0.0, -1.0]}
    orders = (
        (STILL, "tables"),
        (loaded, "view"),
        (away, "problem"),
        ("{", "problem"),
        ("[1]", "problem"),
    )
    _, view, *problems = run(delta, lambda server: follow(server, *orders))
    assert view["poses"][0]["cases"][0]["label"] == "slider load"
    assert "loop" in problems[0]
    assert all("\n" not in problem for problem in problems)
    for wrong in (
        {},
        STILL | {"pose": [1.0]},
        STILL | {"load": [np.nan] * 6},
        STILL | {"values": {"x": "a"}},
    ):
        with pytest.raises(InputError):
            read_setting(delta.robot, wrong)


def test_only_the_token_opens_page_and_socket(delta):
    async def knock(server):
        base = origin(server)
        client = AsyncHTTPClient()
        page = (await client.fetch(server.address)).body.decode()
        refused = []
        for address, headers in (
            (f"{base}/", {}),
            (f"{base}/?token=wrong", {}),
            (f"{base}/socket?token=wrong", {}),
            (server.address, {"Host": "example.org"}),
        ):
            with pytest.raises(HTTPClientError) as error:
                await client.fetch(address, headers=headers)
            refused.append(error.value.code)
        address = server.address.replace("http", "ws").replace("/?", "/socket?")
        with pytest.raises(HTTPClientError):
            await websocket_connect(
                HTTPRequest(address, headers={"Origin": "http://example.org"})
            )
        return page, refused

    page, refused = run(delta, knock)
    assert refused == [403] * 4
    assert 'data-name="leg1.motor.drive.stiffness"' in page


def test_keep_writes_a_robot_file_once(delta, tmp_path):
    target = tmp_path / "mine.toml"
    asked = STILL | {"values": {"leg1.motor.drive.stiffness": 12345.0}}
    orders = (
        (asked, "tables"),
        ({"keep": str(target)}, "kept"),
        ({"keep": str(target)}, "problem"),
    )
    *_, problem = run(delta, lambda server: follow(server, *orders))
    assert ss.load_robot(str(target)).joints["leg1.motor"].drive.stiffness == 12345.0
    assert "new file" in problem


def test_counts_and_materials_are_chosen_beside_the_sliders():
    robot = LiveRobot(ss.load_robot("biglide"))
    choices = {each.name: each for each in find_choices(robot.robot)}
    assert choices["slider.rib_count"].value in choices["slider.rib_count"].values
    assert "titanium" in choices["link.material"].values
    asked = {"values": {"slider.rib_count": 3, "link.material": "titanium"}}
    setting = read_setting(robot.robot, {**asked, "pose": [0.0] * 3, "load": [0.0] * 6})
    changed = robot.changed(setting.values)
    assert changed.parts["slider"].rib_count == 3
    assert changed.parts["link"].material == "titanium"


def test_the_robot_of_the_file_stands_before_its_parts_are_known(delta):
    shown = []
    delta.tell = shown.append
    delta.ahead = Future()
    delta.start()
    delta.ahead.set_result("<p>robot</p>")
    delta.end()
    assert shown == [{"solids": "<p>robot</p>"}]


@pytest.mark.extended
def test_new_rows_of_a_campaign_appear(delta, tmp_path):
    shutil.copytree(FOLDER / "campaigns" / "gauges", tmp_path / "gauges")
    delta.campaign = tmp_path / "gauges"
    table = delta.campaign / "readings.csv"
    lines = table.read_text().splitlines(keepends=True)
    table.write_text("".join(lines[:13]))

    async def work(server):
        socket = await websocket_connect(
            HTTPRequest(
                server.address.replace("http", "ws").replace("/?", "/socket?"),
                headers={"Origin": origin(server)},
            )
        )
        await socket.write_message(json.dumps(STILL))
        for count in (12, 15):
            table.write_text("".join(lines[: count + 1]))
            said: dict = {}
            while f"{count} readings" not in said.get("readings", ""):
                said = json.loads(await asyncio.wait_for(socket.read_message(), 60))
            words = [mark["words"] for mark in said["marks"]]
            assert (
                sum(int(re.search(r": (\d+) readings", each)[1]) for each in words)
                == count
            )
        socket.close()

    run(delta, work)


@pytest.mark.extended
@pytest.mark.skipif(
    CHROMIUM is None, reason="Chromium is missing: apt-get install chromium"
)
def test_a_page_follows_a_slider_five_times_a_second():
    robot, ready, over = (
        LiveRobot(ss.load_robot("biglide"), "published"),
        threading.Event(),
        threading.Event(),
    )
    address = []

    async def serve():
        server = open_server(robot)
        address.append(server.address)
        ready.set()
        while not over.is_set():
            await asyncio.sleep(0.05)
        server.http.stop()

    thread = threading.Thread(target=lambda: asyncio.run(serve()))
    thread.start()
    try:
        assert ready.wait(20)
        with browser() as tab:
            tab.call("Page.navigate", url=address[0])
            tab.wait(
                "!!document.querySelector('#tables table') && !!document.querySelector('.maps img')"
            )
            with contextlib.suppress(
                AssertionError
            ):  # where this machine draws no solids
                tab.wait("!!document.querySelector('.robot-view[data-drawn]')")
            watched = "document.querySelector('#tables'), {childList: true}"
            tab.run(
                f"window.t = 0, new MutationObserver(() => window.t++).observe({watched})"
            )
            for value in range(500, 520):
                moved = f"i.value = {value}; i.dispatchEvent(new Event('input'))"
                tab.run(
                    f"(i => {{ {moved} }})(document.querySelector('[data-name=fz]'))"
                )
                time.sleep(0.1)
            assert tab.run("window.t") >= 10
            errors = [
                event
                for event in tab.complaints()
                if event["params"].get("entry", {}).get("level") != "warning"
            ]
            assert not errors
    finally:
        over.set()
        thread.join()


def test_two_pages_do_not_mix(delta, tmp_path):
    motor = "leg1.motor.drive.stiffness"
    first = STILL | {"values": {motor: 11111.0}}
    second = STILL | {"values": {motor: 22222.0}}
    kept = [tmp_path / "first.toml", tmp_path / "second.toml"]

    async def work(server):
        address = server.address.replace("http", "ws").replace("/?", "/socket?")
        sockets = [
            await websocket_connect(
                HTTPRequest(address, headers={"Origin": origin(server)})
            )
            for _ in kept
        ]
        for socket, setting in zip(sockets, (first, second), strict=True):
            await socket.write_message(json.dumps(setting))
        for socket, target in zip(sockets, kept, strict=True):
            await socket.write_message(json.dumps({"keep": str(target)}))
            while True:
                said = json.loads(await asyncio.wait_for(socket.read_message(), 60))
                if "kept" in said:
                    break
            assert target.name in said["kept"]
            socket.close()

    run(delta, work)
    stiffness = [
        ss.load_robot(str(target)).joints["leg1.motor"].drive.stiffness
        for target in kept
    ]
    assert stiffness == [11111.0, 22222.0]


def test_what_no_page_sends_is_answered_in_one_line(delta, tmp_path):
    link = tmp_path / "link.toml"
    link.symlink_to(tmp_path / "nowhere")
    orders = (("[" * 200_000, "problem"), ({"keep": str(link)}, "problem"))
    nested, dangling = run(delta, lambda server: follow(server, *orders))
    assert nested == "expected a setting of the page, got nested lists"
    assert "new file" in dangling

    async def knock(server):
        with pytest.raises(HTTPClientError) as error:
            await AsyncHTTPClient().fetch(f"{origin(server)}/?token=%C3%A9")
        return error.value.code

    assert run(delta, knock) == 403
