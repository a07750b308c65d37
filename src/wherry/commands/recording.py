"""The option ``--record``, and context managers that record a run, a log or a ROS node as a bag."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from wherry.logs.lidar_log import LidarLog
    from wherry.robot import Robot
    from wherry.ros.bags.log_recorder import LogRecorder
    from wherry.ros.bags.writer import BagWriter
    from wherry.ros.names import RosNames
    from wherry.ros.transports.protocol import Transport
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
    """Record a run: yields a sink for its estimates, and a function that returns a recorded version of a robot.

    Args:
        path: The bag; None to record nothing.
        laser_height: Height of the robot's lidar above base_link, m.

    Raises:
        InputError: The bag cannot be written.
    """
    from wherry.trace.records import null_sink

    with _open_bag(path) as bag:
        if bag is None:
            yield null_sink, lambda robot: robot
        else:
            from wherry.ros.bags.run_recorder import RunRecorder

            recorder = RunRecorder(bag, laser_height=laser_height)
            yield recorder, recorder.robot


@contextlib.contextmanager
def recorded_log(path: Path | None, log: LidarLog) -> Iterator[LogRecorder | None]:
    """Record a log and the estimates computed from it; None as the path records nothing.

    Raises:
        InputError: The bag cannot be written.
    """
    with _open_bag(path) as bag:
        if bag is None:
            yield None
        else:
            from wherry.ros.bags.log_recorder import LogRecorder

            yield LogRecorder(bag, log)


@contextlib.contextmanager
def recorded_transport(path: Path | None, transport: Transport, names: RosNames) -> Iterator[Transport]:
    """Record all messages that go through a transport; None as the path records nothing.

    Raises:
        InputError: The bag cannot be written.
    """
    with _open_bag(path) as bag:
        if bag is None:
            yield transport
        else:
            from wherry.ros.bags.recorded_transport import RecordedTransport

            recorded = RecordedTransport(transport, bag, names)
            try:
                yield recorded
            finally:
                recorded.stop_recording()


@contextlib.contextmanager
def _open_bag(path: Path | None) -> Iterator[BagWriter | None]:
    """Open a bag, which is completed even when the block ends with an error, Ctrl-C or SIGTERM."""
    if path is None:
        yield None
        return
    from wherry.ros.bags.writer import BagWriter

    def interrupt(number: int, frame: object) -> None:
        raise KeyboardInterrupt

    previous = signal.signal(signal.SIGTERM, interrupt)
    try:
        with BagWriter(path) as bag:
            yield bag
    finally:
        signal.signal(signal.SIGTERM, previous)
