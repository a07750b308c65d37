"""Processes of a ROS 2 system on loopback, for tests; each test has its own domain."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any


def wherry(*arguments: str, domain: int, **options: Any) -> subprocess.Popen[str]:
    """Start a command of wherry."""
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain), "COLUMNS": "200"}
    return subprocess.Popen(
        [sys.executable, "-m", "wherry", *arguments],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        **options,
    )


@contextlib.contextmanager
def simulator(world: str | Path, domain: int, *options: str) -> Iterator[subprocess.Popen[str]]:
    """A simulated robot in its own process."""
    process = wherry("ros2", "simulate", str(world), "--json", *options, domain=domain)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def ended(process: subprocess.Popen[str], sent: signal.Signals | None = None, timeout: float = 20.0) -> dict[str, Any]:
    """Send a signal to a process, or wait for its end; return the JSON of its last line."""
    if sent is not None:
        process.send_signal(sent)
    output, _ = process.communicate(timeout=timeout)
    try:
        result = json.loads(output.splitlines()[-1])
    except (IndexError, ValueError):
        raise AssertionError(f"no JSON in\n{output}") from None
    assert isinstance(result, dict)
    return result


def wait_until(condition: Callable[[], bool], seconds: float = 30.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "the condition was not met in time"
        time.sleep(0.01)
