"""Options of the commands that read a recorded log: how it is read, and where its results go."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wherry.commands.common import say
from wherry.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

    from wherry.logs.options import ReadingOptions
    from wherry.space.pose import Pose

LogArgument = Annotated[
    Path, typer.Argument(help="A lidar log: CARMEN or Wean format, plain or gzipped, or a ROS bag.")
]
TrajectoryFormatOption = Annotated[
    str, typer.Option(help="Trajectory file in addition to trajectory.tum: csv or kitti.", metavar="FORMAT")
]


@dataclass(frozen=True, slots=True)
class ReadingGroup:
    """Options of reading a recording; see `wherry.logs.options.ReadingOptions`.

    Attributes:
        lenient: Whether to skip malformed lines or messages.
        lidar: Pose of the lidar in the base_link frame, as ``x,y,θ``.
        scan_topic: Topic of the scans.
        odom_topic: Topic of odometry.
    """

    lenient: Annotated[
        bool, typer.Option("--lenient", help="Skip malformed lines or messages, and report their number.")
    ] = False
    lidar: Annotated[
        str | None,
        typer.Option(metavar="X,Y,θ", help="Pose of the lidar on the robot, instead of the log's; m, m, degrees."),
    ] = None
    scan_topic: Annotated[
        str | None,
        typer.Option(metavar="TOPIC", help="Topic of the scans in a bag; in a text log their type, as FLASER."),
    ] = None
    odom_topic: Annotated[str | None, typer.Option(metavar="TOPIC", help="Topic of odometry in a bag.")] = None

    def options(self) -> ReadingOptions:
        """The options for the pipelines.

        Raises:
            InputError: The pose of the lidar is not a pose.
        """
        from wherry.logs.options import ReadingOptions

        lidar = None if self.lidar is None else parse_pose("--lidar", self.lidar)
        return ReadingOptions(self.lenient, lidar, self.scan_topic, self.odom_topic)


def parse_pose(option: str, text: str) -> Pose:
    """A pose from ``x,y,θ`` in metres and degrees.

    Args:
        option: The option that the text came from, for the error.
        text: The text.

    Raises:
        InputError: The text is no pose.
    """
    from wherry.space.pose import Pose

    try:
        x, y, degrees = (float(word) for word in text.split(","))
    except ValueError as error:
        raise InputError(option, text, "must be x,y,θ in metres and degrees") from error
    if not all(math.isfinite(value) for value in (x, y, degrees)):
        raise InputError(option, text, "must be finite")
    return Pose(x, y, math.radians(degrees))


def say_notes(console: Console, notes: Iterable[str]) -> None:
    """Print each note as a line of its own."""
    for note in notes:
        say(console, f"Note: {note}")
