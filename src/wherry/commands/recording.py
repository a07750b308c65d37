"""The option of the commands whose runs can be recorded as ROS bags, and what it means."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from wherry.logs.carmen import LidarLog
    from wherry.robot import Robot
    from wherry.ros.bags.recording import LogRecording
    from wherry.ros.names import Names
    from wherry.ros.transports.transport import Transport
    from wherry.trace.records import Sink

RecordOption = Annotated[
    Path | None,
    typer.Option(
        "--record",
        help="Record a ROS bag: NAME.bag for ROS 1, NAME.mcap or a new folder's NAME for ROS 2.",
        metavar="NAME",
    ),
]


@contextlib.contextmanager
def recorded(path: Path | None, *, laser_height: float = 0.0) -> Iterator[tuple[Sink, Callable[[Robot], Robot]]]:
    """What records a run: a sink, and what makes a recorded robot of a robot.

    Args:
        path: The bag; None to record nothing.
        laser_height: m, of the robot's lidar over base_link.

    Raises:
        InputError: The bag cannot be written.
    """
    from wherry.trace.records import null_sink

    if path is None:
        yield null_sink, lambda robot: robot
        return
    from wherry.ros.bags.recording import Bag, Recording

    with _interrupted_when_terminated(), Bag(path) as bag:
        recording = Recording(bag, laser_height=laser_height)
        yield recording, recording.robot


@contextlib.contextmanager
def recorded_log(path: Path | None, log: LidarLog) -> Iterator[LogRecording | None]:
    """What records a log as a bag, with what was found out about it.

    Args:
        path: The bag; None to record nothing.
        log: What is run through.

    Raises:
        InputError: The bag cannot be written.
    """
    if path is None:
        yield None
        return
    from wherry.ros.bags.recording import Bag, LogRecording

    with _interrupted_when_terminated(), Bag(path) as bag:
        yield LogRecording(bag, log)


@contextlib.contextmanager
def recorded_transport(path: Path | None, transport: Transport, names: Names) -> Iterator[Transport]:
    """The transport, with everything that goes through it recorded.

    Args:
        path: The bag; None to record nothing.
        transport: ROS.
        names: What everything is called.

    Raises:
        InputError: The bag cannot be written.
    """
    if path is None:
        yield transport
        return
    from wherry.ros.bags.recording import Bag, RecordedTransport

    with _interrupted_when_terminated(), Bag(path) as bag:
        recorded = RecordedTransport(transport, bag, names)
        try:
            yield recorded
        finally:
            recorded.finish()


@contextlib.contextmanager
def _interrupted_when_terminated() -> Iterator[None]:
    """Let SIGTERM end a run as Ctrl-C does, so that its bag is finished."""

    def interrupt(number: int, frame: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
