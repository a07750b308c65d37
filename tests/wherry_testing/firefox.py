"""A client for Debian's Firefox over WebDriver BiDi (https://w3c.github.io/webdriver-bidi)."""

from __future__ import annotations

import base64
import contextlib
import json
import re
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from websockets.sync.client import ClientConnection, connect

PROGRAM = Path("/usr/bin/firefox-esr")
TIMEOUT = 60.0  # s, for a response; a loaded machine starts Firefox slowly


class Page:
    """A window of Firefox.

    Attributes:
        errors: Error messages on the console of the page.
    """

    def __init__(self, socket: ClientConnection) -> None:
        self.errors: list[str] = []
        self._socket = socket
        self._request_id = 0
        self._request("session.new", capabilities={})
        self._request("session.subscribe", events=["log.entryAdded"])
        self._context = self._request("browsingContext.getTree")["contexts"][0]["context"]

    def _request(self, method: str, **params: object) -> Any:
        self._request_id += 1
        self._socket.send(json.dumps({"id": self._request_id, "method": method, "params": params}))
        while True:
            answer = json.loads(self._socket.recv(timeout=TIMEOUT))
            if answer.get("method") == "log.entryAdded" and answer["params"]["level"] == "error":
                self.errors.append(str(answer["params"]["text"]))
            if answer.get("id") == self._request_id:
                assert answer["type"] == "success", answer
                return answer["result"]

    def goto(self, url: str, *, width: int = 1280, height: int = 800) -> None:
        """Open a page in a window of this size, px."""
        self._request("browsingContext.setViewport", context=self._context, viewport={"width": width, "height": height})
        self._request("browsingContext.navigate", context=self._context, url=url, wait="complete")

    def evaluate(self, expression: str) -> Any:
        """The JSON value of an expression, or of its promise."""
        text = f"Promise.resolve({expression}).then((value) => JSON.stringify(value ?? null))"
        answer = self._request("script.evaluate", expression=text, target={"context": self._context}, awaitPromise=True)
        assert answer["type"] == "success", answer
        return json.loads(answer["result"]["value"])

    def until(self, expression: str) -> None:
        """Wait until an expression is true on the page."""
        deadline = time.monotonic() + TIMEOUT
        while not self.evaluate(expression):
            assert time.monotonic() < deadline, f"still false: {expression}"
            time.sleep(0.05)

    def press(self, key: str) -> None:
        """Press and release a key."""
        actions = [{"type": kind, "value": key} for kind in ("keyDown", "keyUp")]
        source = {"type": "key", "id": "keyboard", "actions": actions}
        self._request("input.performActions", context=self._context, actions=[source])

    def click(self, x: float, y: float) -> None:
        """Click at a point of the window, px."""
        move = {"type": "pointerMove", "x": round(x), "y": round(y)}
        buttons = [{"type": kind, "button": 0} for kind in ("pointerDown", "pointerUp")]
        source = {"type": "pointer", "id": "mouse", "actions": [move, *buttons]}
        self._request("input.performActions", context=self._context, actions=[source])

    def screenshot(self, path: Path) -> None:
        """Save a screenshot as PNG."""
        path.write_bytes(
            base64.b64decode(self._request("browsingContext.captureScreenshot", context=self._context)["data"])
        )


@contextlib.contextmanager
def firefox(profile: Path) -> Iterator[Page]:
    """A headless Firefox with a profile folder."""
    command = [PROGRAM, "--headless", "--no-remote", "--profile", profile, "--remote-debugging-port", "0"]
    log = profile / "log.txt"
    with log.open("w") as errors, subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=errors) as process:
        try:
            with connect(f"{_address(log)}/session", max_size=None, open_timeout=TIMEOUT) as socket:
                yield Page(socket)
        finally:
            process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(10.0)
            process.kill()


def _address(log: Path) -> str:
    """Address at which Firefox listens, once it has printed it."""
    deadline = time.monotonic() + TIMEOUT
    while (found := re.search(r"ws://\S+", log.read_text())) is None:
        assert time.monotonic() < deadline, log.read_text()
        time.sleep(0.05)
    return found.group()
