"""A real ROS 1 for tests: Debian's roscore, and a node outside of wherry that is nothing but Debian's rospy."""

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
from types import TracebackType
from typing import Any, Self

import pytest

DEBIAN_PYTHON = "/usr/bin/python3"
PEER = Path(__file__).with_name("ros1_peer.py")
ROSCORE_PATIENCE = 30.0  # s


def require(*programs: str) -> None:
    """Skip where ROS 1 is not installed; in continuous integration it is."""
    missing = [program for program in programs if shutil.which(program) is None]
    if missing:
        reason = f"{', '.join(missing)}: not installed; the packages are in .ci/run"
        if os.environ.get("CI") == "true":
            pytest.fail(reason)
        pytest.skip(reason)


def wait_until(true: Callable[[], Any], patience: float, what: str) -> None:
    """Wait for something, and fail where it does not come."""
    deadline = time.monotonic() + patience
    while not true():
        if time.monotonic() > deadline:
            pytest.fail(f"not within {patience:g} s: {what}")
        time.sleep(0.05)


class Roscore:
    """A roscore on a port of its own, on 127.0.0.1."""

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

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.kill()

    def start(self) -> None:
        self._process = subprocess.Popen(
            ["/usr/bin/roscore", "-p", str(self.port)],
            env={**self.environment, "ROS_IP": "127.0.0.1"},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        wait_until(self._answers, ROSCORE_PATIENCE, "roscore answers")

    def kill(self) -> None:
        if self._process is not None:
            for process in reversed(_family(self._process.pid)):
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
        """Run an outside node."""
        with Peer([DEBIAN_PYTHON, "-u", str(PEER), name], {**self.environment, "ROS_IP": "127.0.0.1"}) as peer:
            yield peer


def _family(process: int) -> list[int]:
    """A process and all that it has started, which may be in sessions of their own."""
    children = Path(f"/proc/{process}/task/{process}/children").read_text().split()
    return [process, *(member for child in children for member in _family(int(child)))]


class Program:
    """A process whose output is read as it comes; it ends with its block."""

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

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.close()  # which ends those who read it
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
        """kill -9."""
        os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()

    def freeze(self) -> None:
        os.killpg(self.process.pid, signal.SIGSTOP)

    def thaw(self) -> None:
        os.killpg(self.process.pid, signal.SIGCONT)

    def interrupt(self) -> None:
        """Ctrl-C."""
        os.killpg(self.process.pid, signal.SIGINT)

    def result(self) -> dict[str, Any]:
        """What --json has printed."""
        found: dict[str, Any] = json.loads(self.lines[-1])
        return found

    def finish(self, patience: float) -> int:
        """Wait for its end; its exit status."""
        try:
            return self.process.wait(patience)
        except subprocess.TimeoutExpired:
            pytest.fail(f"still runs after {patience:g} s:\n{self.output[-2000:]}")
        finally:
            self._reader.join(1.0)

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.took(line)

    def took(self, line: str) -> None:
        self.lines.append(line)


class Peer(Program):
    """A node outside of wherry: `ros1_peer.py`."""

    reads_input = True

    def __init__(self, command: Sequence[str], environment: dict[str, str]) -> None:
        super().__init__(command, environment)
        self.heard: dict[str, list[dict[str, Any]]] = {}  # by topic: "at" (s, monotonic clock), "message"
        self._answers: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def took(self, line: str) -> None:
        try:
            news = json.loads(line)
        except json.JSONDecodeError:
            super().took(line)
            return
        if "answer" in news:
            self._answers.put(news["answer"])
        else:
            self.heard.setdefault(news["topic"], []).append(news)

    def ask(self, **request: Any) -> Any:
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(request) + "\n")
        self.process.stdin.flush()
        try:
            return self._answers.get(timeout=20.0)
        except queue.Empty:
            pytest.fail(f"no answer to {request}:\n{self.output}")

    def listen(self, topic: str, type_name: str) -> None:
        """Hear a topic; its messages gather in `heard`."""
        self.heard.setdefault(topic, [])
        self.ask(do="listen", topic=topic, type=type_name)

    def send(self, topic: str, type_name: str, message: dict[str, Any], *, latch: bool = False) -> None:
        """Publish; waits at first until somebody listens, or a second."""
        self.ask(do="send", topic=topic, type=type_name, message=message, latch=latch)

    def stop_sending(self, topic: str) -> None:
        self.ask(do="stop sending", topic=topic)

    def relay(self, topic: str, to: str, mode: str) -> None:
        """Pass scans on: "pass", "silent", "nan" (an angle that is no number) or "frame" (of another frame)."""
        self.ask(do="relay", topic=topic, to=to, mode=mode)

    def parameter(self, name: str) -> Any:
        return self.ask(do="parameter", name=name)

    def transform(
        self, target: str, source: str, *, at: tuple[int, int] = (0, 0), patience: float = 5.0
    ) -> list[float]:
        """[7] x, y, z, and the quaternion, as the real tf2 has it at a time (s, ns); by default the last one known."""
        found: list[float] | str = self.ask(do="transform", target=target, source=source, at=at, patience=patience)
        if isinstance(found, str):
            pytest.fail(f"tf2 says: {found}")
        return found

    def wait_for(self, topic: str, count: int, patience: float) -> list[dict[str, Any]]:
        """The messages of a topic, once there are so many."""
        wait_until(lambda: len(self.heard[topic]) >= count, patience, f"{count} messages on {topic}")
        return [news["message"] for news in self.heard[topic]]

    def last(self, topic: str) -> dict[str, Any]:
        message: dict[str, Any] = self.heard[topic][-1]["message"]
        return message


def values_of(diagnostics: dict[str, Any], name: str) -> dict[str, str]:
    """The values of one part in a message on /diagnostics, and its message and level."""
    for status in diagnostics["status"]:
        if status["name"] == name:
            values = {pair["key"]: pair["value"] for pair in status["values"]}
            return {**values, "message": status["message"], "level": str(status["level"])}
    return {}


def heading(quaternion: dict[str, float]) -> float:
    """rad, of a rotation about the z axis."""
    return 2.0 * math.atan2(quaternion["z"], quaternion["w"])


def stamp(message: dict[str, Any]) -> float:
    """s, of a message with a header."""
    found = message["header"]["stamp"]
    return float(found["secs"] + 1e-9 * found["nsecs"])
