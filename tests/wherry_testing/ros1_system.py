"""A real ROS 1 for tests: Debian's roscore, and a node of Debian's rospy that is independent of wherry."""

from __future__ import annotations

import json
import math
import os
import queue
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

import pytest

DEBIAN_PYTHON = "/usr/bin/python3"
PEER = Path(__file__).with_name("ros1_peer.py")
ROSCORE_TIMEOUT = 30.0  # s


def require(*programs: str) -> None:
    """Skip a test where programs of ROS 1 are not installed; in continuous integration, fail."""
    missing = [program for program in programs if shutil.which(program) is None]
    if missing:
        reason = f"{', '.join(missing)}: not installed; the packages are in .ci/run"
        if os.environ.get("CI") == "true":
            pytest.fail(reason)
        pytest.skip(reason)


def wait_until(condition: Callable[[], Any], timeout: float, what: str) -> None:
    """Wait until a condition holds; fail the test after the timeout, s."""
    deadline = time.monotonic() + timeout
    while not condition():
        if time.monotonic() > deadline:
            pytest.fail(f"not within {timeout:g} s: {what}")
        time.sleep(0.05)


class Roscore:
    """A roscore on a free port of 127.0.0.1."""

    def __init__(self, folder: Path) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        kept = {key: value for key, value in os.environ.items() if not key.startswith("ROS_")}
        self.environment = {
            **kept,
            "ROS_MASTER_URI": f"http://127.0.0.1:{self.port}",
            "ROS_HOME": str(folder / "ros"),
            "ROS_LOG_DIR": str(folder / "ros" / "log"),
        }
        self.folder = folder
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self.kill()

    def start(self) -> None:
        self._process = subprocess.Popen(
            ["/usr/bin/roscore", "-p", str(self.port)],
            env={**self.environment, "ROS_IP": "127.0.0.1"},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        wait_until(self._answers, ROSCORE_TIMEOUT, "roscore answers")

    def kill(self) -> None:
        if self._process is not None:
            for process in reversed(_process_tree(self._process.pid)):
                os.kill(process, signal.SIGKILL)
            self._process.wait()
            self._process = None
            wait_until(lambda: not self._answers(), 5.0, "roscore is gone")

    def _answers(self) -> bool:
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", self.port)) == 0

    @contextmanager
    def wherry(self, *arguments: str) -> Iterator[Program]:
        """Run a wherry command in this system."""
        with Program([sys.executable, "-m", "wherry", *arguments], self.environment) as program:
            yield program

    @contextmanager
    def python(self, code: str, *arguments: str) -> Iterator[Program]:
        """Run Python in the tests' own environment."""
        with Program([sys.executable, "-u", "-c", code, *arguments], self.environment) as program:
            yield program

    @contextmanager
    def peer(self, name: str = "peer") -> Iterator[Peer]:
        """Run an independent node."""
        with Peer([DEBIAN_PYTHON, "-u", str(PEER), name], {**self.environment, "ROS_IP": "127.0.0.1"}) as peer:
            yield peer


def _process_tree(process: int) -> list[int]:
    """A process and its descendants, which may be in other sessions."""
    children = Path(f"/proc/{process}/task/{process}/children").read_text().split()
    return [process, *(member for child in children for member in _process_tree(int(child)))]


class Program:
    """A process whose output is read continuously; it is terminated at the end of the with block."""

    reads_input = False

    def __init__(self, command: Sequence[str], environment: dict[str, str]) -> None:
        self.process = subprocess.Popen(
            command,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        self.lines: list[str] = []
        self._reader = threading.Thread(target=self._read, daemon=True)

    def __enter__(self) -> Self:
        self._reader.start()
        return self

    def __exit__(self, *exception: object) -> None:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.close()  # ends programs that read it
        if self.process.poll() is None and not self.reads_input:
            os.killpg(self.process.pid, signal.SIGTERM)
        try:
            self.process.wait(5.0)
        except subprocess.TimeoutExpired:
            self.kill()
        self._reader.join()
        self.process.stdout.close()

    @property
    def output(self) -> str:
        return "".join(self.lines)

    def kill(self) -> None:
        """Send SIGKILL."""
        os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()

    def freeze(self) -> None:
        os.killpg(self.process.pid, signal.SIGSTOP)

    def thaw(self) -> None:
        os.killpg(self.process.pid, signal.SIGCONT)

    def interrupt(self) -> None:
        """Send SIGINT, as Ctrl-C does."""
        os.killpg(self.process.pid, signal.SIGINT)

    def result(self) -> dict[str, Any]:
        """The result printed with --json."""
        found: dict[str, Any] = json.loads(self.lines[-1])
        return found

    def finish(self, timeout: float) -> int:
        """Wait for the end of the process; return its exit status."""
        try:
            return self.process.wait(timeout)
        except subprocess.TimeoutExpired:
            pytest.fail(f"still runs after {timeout:g} s:\n{self.output[-2000:]}")
        finally:
            self._reader.join(1.0)

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.handle(line)

    def handle(self, line: str) -> None:
        self.lines.append(line)


class Peer(Program):
    """An independent node: `ros1_peer.py`."""

    reads_input = True

    def __init__(self, command: Sequence[str], environment: dict[str, str]) -> None:
        super().__init__(command, environment)
        self.received: dict[str, list[dict[str, Any]]] = {}  # by topic: "at", s on the monotonic clock, and "message"
        self._answers: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def handle(self, line: str) -> None:
        try:
            entry = json.loads(line)
        except json.JSONDecodeError:
            super().handle(line)
            return
        if "answer" in entry:
            self._answers.put(entry["answer"])
        else:
            self.received.setdefault(entry["topic"], []).append(entry)

    def ask(self, **request: Any) -> Any:
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(request) + "\n")
        self.process.stdin.flush()
        try:
            return self._answers.get(timeout=20.0)
        except queue.Empty:
            pytest.fail(f"no answer to {request}:\n{self.output}")

    def listen(self, topic: str, type_name: str) -> None:
        """Subscribe to a topic; its messages are appended to `received`."""
        self.received.setdefault(topic, [])
        self.ask(do="listen", topic=topic, type=type_name)

    def send(self, topic: str, type_name: str, message: dict[str, Any], *, latch: bool = False) -> None:
        """Publish a message; the first time, wait for a subscriber for up to a second."""
        self.ask(do="send", topic=topic, type=type_name, message=message, latch=latch)

    def stop_sending(self, topic: str) -> None:
        self.ask(do="stop sending", topic=topic)

    def relay(self, topic: str, to: str, mode: str) -> None:
        """Forward scans in mode "pass", "silent", "nan" (an angle is NaN) or "frame" (another frame)."""
        self.ask(do="relay", topic=topic, to=to, mode=mode)

    def parameter(self, name: str) -> Any:
        return self.ask(do="parameter", name=name)

    def transform(self, target: str, source: str, *, at: tuple[int, int] = (0, 0), timeout: float = 5.0) -> list[float]:
        """[7] x, y, z, and the quaternion from the real tf2 at a time (s, ns); the latest by default."""
        found: list[float] | str = self.ask(do="transform", target=target, source=source, at=at, timeout=timeout)
        if isinstance(found, str):
            pytest.fail(f"tf2 says: {found}")
        return found

    def wait_for(self, topic: str, count: int, timeout: float) -> list[dict[str, Any]]:
        """Wait for a number of messages of a topic; return all of them."""
        wait_until(lambda: len(self.received[topic]) >= count, timeout, f"{count} messages on {topic}")
        return [entry["message"] for entry in self.received[topic]]

    def last(self, topic: str) -> dict[str, Any]:
        message: dict[str, Any] = self.received[topic][-1]["message"]
        return message


def values_of(diagnostics: dict[str, Any], name: str) -> dict[str, str]:
    """The values, the text and the level of one component in a message on /diagnostics."""
    for status in diagnostics["status"]:
        if status["name"] == name:
            values = {pair["key"]: pair["value"] for pair in status["values"]}
            return {**values, "message": status["message"], "level": str(status["level"])}
    return {}


def heading(quaternion: dict[str, float]) -> float:
    """The rotation about the z axis, rad."""
    return 2.0 * math.atan2(quaternion["z"], quaternion["w"])


def stamp(message: dict[str, Any]) -> float:
    """The stamp of a message with a header, s."""
    found = message["header"]["stamp"]
    return float(found["secs"] + 1e-9 * found["nsecs"])
