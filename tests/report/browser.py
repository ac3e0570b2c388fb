"""Debian's Chromium without a window, driven over the pipe of its DevTools protocol; software WebGL."""

import base64
import contextlib
import io
import itertools
import json
import os
import select
import shutil
import subprocess
import tempfile
import time

import numpy as np
from PIL import Image

CHROMIUM = (
    shutil.which("chromium")
    or shutil.which("chromium-browser")
    or shutil.which("google-chrome")
)
FLAGS = (
    *(
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--enable-unsafe-swiftshader",
        "--hide-scrollbars",
    ),
    *(
        "--no-first-run",
        "--disable-extensions",
        "--disable-background-networking",
        "--remote-debugging-pipe",
    ),
)
TIME_LIMIT = 20.0


class Tab:
    """One page of a browser: what it asks of the network, what its console says, what it shows."""

    def __init__(self, orders, replies):
        self._orders = orders
        self._replies = replies
        self._numbers = itertools.count(1)
        self._session = None
        self._left = b""
        self.events = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call(
            "Target.attachToTarget", targetId=target, flatten=True
        )["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def call(self, method, **parameters):
        number = next(self._numbers)
        order = {"id": number, "method": method, "params": parameters}
        if self._session:
            order["sessionId"] = self._session
        os.write(self._orders, json.dumps(order).encode() + b"\0")
        while True:
            message = self._next()
            if message.get("id") == number:
                assert "error" not in message, message
                return message["result"]
            self.events.append(message)

    def _next(self):
        while b"\0" not in self._left:
            ready, _, _ = select.select([self._replies], [], [], TIME_LIMIT)
            assert ready, "the browser does not answer"
            piece = os.read(self._replies, 1 << 20)
            assert piece, "the browser has ended"
            self._left += piece
        message, _, self._left = self._left.partition(b"\0")
        return json.loads(message)

    def open(self, file, width=1200, height=900, **features):
        """Open a file at a width in CSS pixels; media features by their names, with _ for -."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )
        wanted = [
            {"name": name.replace("_", "-"), "value": value}
            for name, value in features.items()
        ]
        self.call("Emulation.setEmulatedMedia", features=wanted)
        self.call("Page.navigate", url=file.absolute().as_uri())
        self.wait("document.readyState === 'complete'")

    def run(self, script):
        """The value of a JavaScript expression, a promise awaited."""
        done = self.call(
            "Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in done, done
        return done["result"].get("value")

    def wait(self, script):
        end = time.monotonic() + TIME_LIMIT
        while not self.run(script):
            assert time.monotonic() < end, f"never true: {script}"
            time.sleep(0.05)

    def settled(self):
        """Two frames later."""
        self.run(
            "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(true))))"
        )

    def shot(self, selector=None, *, whole=False):
        """Pixels (height, width, 3) of what is seen, of an element, or of the whole page."""
        more = {}
        if selector:
            box = self.run(
                f"(b => [b.x + scrollX, b.y + scrollY, b.width, b.height])"
                f"(document.querySelector({json.dumps(selector)}).getBoundingClientRect())"
            )
            more = {
                "clip": {
                    **dict(zip(("x", "y", "width", "height"), box, strict=True)),
                    "scale": 1,
                }
            }
        done = self.call(
            "Page.captureScreenshot",
            captureBeyondViewport=bool(selector) or whole,
            **more,
        )
        return np.asarray(
            Image.open(io.BytesIO(base64.b64decode(done["data"]))).convert("RGB")
        )

    def complaints(self):
        """What console and log say, and exceptions."""
        kinds = {
            "Runtime.consoleAPICalled",
            "Runtime.exceptionThrown",
            "Log.entryAdded",
        }
        return [event for event in self.events if event.get("method") in kinds]

    def requests(self):
        """Addresses that were asked for, but data inside the page."""
        asked = (
            e["params"]["request"]["url"]
            for e in self.events
            if e.get("method") == "Network.requestWillBeSent"
        )
        return [
            address for address in asked if not address.startswith(("data:", "about:"))
        ]


@contextlib.contextmanager
def browser(*flags):
    """A tab of a new Chromium."""
    order_in, order_out = os.pipe()
    reply_in, reply_out = os.pipe()
    with tempfile.TemporaryDirectory(
        prefix="chromium-", ignore_cleanup_errors=True
    ) as profile:
        words = [
            "bash",
            "-c",
            f'exec "$@" 3<&{order_in} 4>&{reply_out}',
            "bash",
            CHROMIUM,
            *FLAGS,
            *flags,
        ]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        process = subprocess.Popen(
            [*words, f"--user-data-dir={profile}"],
            pass_fds=(order_in, reply_out),
            start_new_session=True,
            **quiet,
        )
        os.close(order_in)
        os.close(reply_out)
        try:
            tab = Tab(order_out, reply_in)
            yield tab
            tab._session = None
            with contextlib.suppress(AssertionError, OSError):
                tab.call("Browser.close")
            process.wait(TIME_LIMIT)
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()
            os.close(order_out)
            os.close(reply_in)
