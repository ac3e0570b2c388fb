"""Local server of the live view: a page with a token in its address, and a web socket.

Each socket, which is each open page, has its own robot: settings and answers of two pages do not mix.
Only the newest setting is evaluated. Virtual experiments run in the background and report progress;
until they finish, the page shows the previous robot.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import secrets
import threading
import time
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tomlkit
from tornado.httpserver import HTTPServer
from tornado.netutil import bind_sockets
from tornado.web import Application, HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from stiffscope.errors import InputError, StiffscopeError
from stiffscope.experiments.assembly import assemble_robots
from stiffscope.experiments.robot_files import robot_document
from stiffscope.experiments.watching import changes, keep_meshed
from stiffscope.gap.campaigns import diagnose_case, open_case
from stiffscope.gap.show import tables as gap_tables
from stiffscope.live import page as live
from stiffscope.lobes.chatter import check_cut
from stiffscope.path.job import load_job
from stiffscope.report.pictures import open_drawing
from stiffscope.report.terminal import record_shown
from stiffscope.robot.file.override import write_override
from stiffscope.robot.reader import load_robot
from stiffscope.runtime.json_text import to_json
from stiffscope.runtime.output import write_new
from stiffscope.runtime.workshop import workshop

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from stiffscope.experiments.assembly import Assembled
    from stiffscope.experiments.experiments import PartResult
    from stiffscope.live.page import Setting
    from stiffscope.path.job import Job
    from stiffscope.robot.file.description import RobotFile

HOST = "127.0.0.1"


class Newest:
    """A thread that processes the newest order and skips older pending ones."""

    def __init__(self, work: Callable[[Any], None]) -> None:
        self._changed = threading.Condition()
        self._order = None
        self._ended = False
        self._work = work
        threading.Thread(target=self._run, daemon=True).start()

    def put(self, order: Any) -> None:
        """Submit an order, which must not be None."""
        with self._changed:
            self._order = order
            self._changed.notify()

    def end(self) -> None:
        """End the thread after the order that it processes."""
        with self._changed:
            self._ended = True
            self._changed.notify()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._ended or self._order is not None)
                if self._ended:
                    return
                order = self._order
                self._order = None
            self._work(order)


@dataclass
class LiveRobot:
    """A robot controlled by sliders.

    Attributes
    ----------
    robot : robot file.
    components : source of the parts' matrices, as in `assemble`.
    campaign : folder of the campaign to compare with the robot, or None.
    job : job whose stable depth of cut is shown, or None.
    ahead : the robot of the file as HTML, shown until the first one is built.
    tell : sends a message to the page; thread-safe.
    built : assembled robot and the slider values used for it.
    asked : newest setting.
    """

    robot: RobotFile
    components: Any = None
    campaign: Path | None = None
    tell: Callable[[Mapping[str, Any]], None] = print
    built: tuple[Assembled, Mapping[str, float | str]] | None = None
    asked: Setting | None = None
    job: Job | None = None
    ahead: Future[str] | None = None
    _meshed: dict[str, PartResult] = field(default_factory=dict, init=False)
    _workers: list[Newest] = field(default_factory=list, init=False)
    _ended: bool = field(default=False, init=False)
    _drawn: bool = field(default=False, init=False)

    def start(self) -> None:
        """Start the worker threads."""
        self._build, self._follow = Newest(self.build), Newest(self.follow)
        self._draw, self._compare = Newest(self.draw), Newest(self.compare)
        if self.campaign:
            threading.Thread(target=self._watch, daemon=True).start()
        self._workers = [self._build, self._follow, self._draw, self._compare]
        if self.ahead is not None:
            self.ahead.add_done_callback(self._show_first)

    def _show_first(self, drawn: Future[str]) -> None:
        """Send the robot of the file, unless a built one was drawn before."""
        if not drawn.exception() and drawn.result() and not self._drawn:
            self.tell({"solids": drawn.result()})

    def end(self) -> None:
        """End the worker threads, as the page is closed."""
        self._ended = True
        for worker in self._workers:
            worker.end()

    def ask(self, setting: Setting) -> None:
        """Evaluate slider values; results are sent with `tell`."""
        former = self.asked
        self.asked = setting
        if former is None or former.values != setting.values:
            self._build.put(setting)
        if self.built is not None:
            self._follow.put(setting)

    def changed(self, values: Mapping[str, float | str]) -> RobotFile:
        """Return the robot file with changed values."""
        source = self.robot.source
        given = [write_override(name, value) for name, value in values.items()]
        return load_robot(str(source.path), [*source.overrides, *given])

    def build(self, setting: Setting) -> None:
        """Assemble the robot for a setting, run the experiments needed, then evaluate it."""
        try:
            with workshop(self._open_line) as shop:
                robots = {"live": self.changed(setting.values)}
                near = self._meshed
                assembled = assemble_robots(
                    robots, self.components, shop, whole=False, near=near
                )["live"]
        except (StiffscopeError, OSError, RuntimeError) as error:
            self.tell({"problem": str(error)})
            return
        keep_meshed(self._meshed, assembled.results)
        self.built = assembled, setting.values
        asked = self.asked or setting
        for work in (
            self._follow,
            self._draw,
            *([self._compare] if self.campaign else []),
        ):
            work.put(asked)

    def _open_line(self, name: str) -> Callable[[str, float], None]:
        def report(stage: str, fraction: float) -> None:
            done = fraction >= 1.0
            self.tell(
                {"progress": "" if done else f"{name}: {stage}, {100 * fraction:.0f} %"}
            )

        return report

    def follow(self, setting: Setting) -> None:
        """Send the results of a setting for the currently assembled robot."""
        if self.built is None:
            return
        start = time.perf_counter()
        (assembled, values) = self.built
        try:
            answer = live.answer(assembled, setting, self.job)
        except StiffscopeError as error:
            self.tell({"problem": str(error)})
            return
        seconds = time.perf_counter() - start
        self.tell(
            {
                "problem": "",
                **answer,
                "seconds": seconds,
                "stale": setting.values != values,
            }
        )

    def draw(self, setting: Setting) -> None:
        """Draw the maps and solids of the assembled robot."""
        if self.built is None:
            return
        assembled, _ = self.built
        with contextlib.suppress(StiffscopeError), open_drawing() as draw_now:
            solids = live.view_html(assembled, setting, draw_now)
            self._drawn = True
            self.tell({"solids": solids})
        with contextlib.suppress(StiffscopeError):
            self.tell({"maps": live.draw_maps(assembled)})

    def compare(self, _setting: Setting) -> None:
        """Compare the campaign's readings with the assembled robot and send the diagnosis."""
        if self.campaign is None or self.built is None:
            return
        assembled, _ = self.built
        try:
            case = open_case(self.campaign, instead=str(self.robot.source.path))
            self.tell(live.compare_readings(case, assembled))
            with workshop() as shop, record_shown() as shown:
                gap_tables.show_diagnosis(diagnose_case(case, assembled, shop))
            self.tell({"diagnosis": live.as_html(shown)})
        except (StiffscopeError, OSError) as error:
            self.tell({"problem": str(error)})

    def _watch(self) -> None:
        """Repeat the comparison whenever a file of the campaign is saved."""
        folder = self.campaign or Path()
        for _ in changes([path for path in folder.iterdir() if path.is_file()]):
            if self._ended:
                return
            if self.asked is not None:
                self._compare.put(self.asked)

    def keep(self, name: str) -> str:
        """Write the robot with the sliders' values as a robot file; return a message."""
        target = Path(name)
        expected = f"{name}: expected the name of a new file that ends in .toml"
        if target.suffix != ".toml" or os.path.lexists(target):
            raise InputError(expected)
        robot = self.changed(self.asked.values if self.asked else {})
        write_new(target, tomlkit.dumps(robot_document(robot, target)).encode())
        self.tell({"free": live.free_name(robot)})
        return f"kept as {target.resolve()}"


class _Guarded:
    """Refuses requests with a wrong token or another host name."""

    def check(self: Any) -> None:
        given = self.get_query_argument("token", "")
        host = self.request.host.rpartition(":")[0]
        token = self.application.settings["token"]
        # as bytes: texts beyond ASCII are not compared
        known = secrets.compare_digest(given.encode(), token.encode())
        if host != HOST or not known:
            raise HTTPError(403)


class _Page(_Guarded, RequestHandler):
    def get(self) -> None:
        self.check()
        self.set_header("Content-Type", "text/html; charset=utf-8")
        self.set_header("Referrer-Policy", "no-referrer")
        self.finish(self.application.settings["page"])


class _Socket(_Guarded, WebSocketHandler):
    def check_origin(self, origin: str) -> bool:
        return origin == f"http://{self.request.host}"

    def prepare(self) -> None:
        self.check()

    robot: LiveRobot | None = None

    def open(self, *_args: str, **_more: str) -> None:
        shown: LiveRobot = self.application.settings["robot"]
        loop = asyncio.get_running_loop()

        def tell(message: Mapping[str, Any]) -> None:
            with contextlib.suppress(RuntimeError):  # the server has ended
                loop.call_soon_threadsafe(self._send, to_json(message))

        self.robot = replace(shown, tell=tell)
        self.robot.start()

    def _send(self, text: str) -> None:
        with contextlib.suppress(WebSocketClosedError):
            self.write_message(text)

    def on_close(self) -> None:
        if self.robot is not None:
            self.robot.end()

    def on_message(self, message: str | bytes) -> None:
        robot = self.robot
        if robot is None:
            return
        try:
            asked = json.loads(message)
            if "keep" in asked:
                robot.tell({"kept": robot.keep(str(asked["keep"]))})
            else:
                robot.ask(live.read_setting(robot.robot, asked))
        except RecursionError:
            robot.tell({"problem": "expected a setting of the page, got nested lists"})
        except (InputError, OSError, ValueError, TypeError) as error:
            robot.tell({"problem": str(error)})


@dataclass(frozen=True)
class Server:
    """A listening server: the page's address and the HTTP server."""

    address: str
    http: HTTPServer


def _draw_ahead(robot: RobotFile) -> Future[str]:
    """Begin to draw the robot of the file."""
    drawn: Future[str] = Future()

    def draw() -> None:
        try:
            drawn.set_result(live.first_view_html(robot))
        except (StiffscopeError, OSError, RuntimeError) as error:
            drawn.set_exception(error)

    threading.Thread(target=draw, daemon=True).start()
    return drawn


def open_server(robot: LiveRobot, port: int = 0) -> Server:
    """Start listening on this machine; needs a running event loop.

    Parameters
    ----------
    robot
        Robot shown by the page; each page that is opened has a copy of it.
    port
        Port; 0 for any free port.

    Raises
    ------
    InputError
        The port is taken.
    """
    token = secrets.token_urlsafe(16)
    page = live.render_page(robot.robot, live.find_sliders(robot.robot), robot.campaign)
    try:
        bound = bind_sockets(port, HOST)
    except OSError as error:
        raise InputError(
            f"--port {port}: expected a port that is free, got one in use"
        ) from error
    settings: dict[str, Any] = {
        "token": token,
        "page": page,
        "robot": robot,
    }
    http = HTTPServer(Application([("/", _Page), ("/socket", _Socket)], **settings))
    http.add_sockets(bound)
    return Server(f"http://{HOST}:{bound[0].getsockname()[1]}/?token={token}", http)


def serve(robot: LiveRobot, port: int, announce: Callable[[str], None]) -> None:
    """Serve the page until Ctrl-C; ``announce`` is called with its address."""

    async def forever() -> None:
        robot.ahead = _draw_ahead(robot.robot)
        server = open_server(robot, port)
        announce(server.address)
        await asyncio.Event().wait()

    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(forever())


def open_robot(
    name: str,
    overrides: Sequence[str],
    components: Any,
    campaign: Path | None,
    job: Path | None = None,
) -> LiveRobot:
    """Open the robot of a command line. Raise InputError if robot, campaign or job is invalid."""
    robot = load_robot(name, overrides)
    cut = None if job is None else load_job(job, robot)
    if cut is not None:
        check_cut(cut)
    if campaign is not None:
        open_case(campaign, instead=str(robot.source.path))
    return LiveRobot(robot, components, campaign, job=cut)
