"""Names of frames: those of REP 105 and REP 120, and those that differ by a robot's prefix."""

from __future__ import annotations

import re
from collections.abc import Iterable

MAX_FRAMES_NAMED = 4  # frames that an error lists
MAX_NAME_LENGTH = 40  # characters of a name in an error
ODOMETRY_FRAME = re.compile(r"(?:^|[/_])odom(?:_combined|_ekf|_filtered|_raw)?$")
WORLD_FRAME = re.compile(r"(?:^|[/_])(?:map|world|earth)$")
BASE_FRAME = re.compile(r"(?:^|[/_])base_(?:link|footprint)$")


def is_odometry_frame(frame: str) -> bool:
    """Whether a frame has the name of one in which odometry is given, with or without a prefix."""
    return ODOMETRY_FRAME.search(frame) is not None


def is_base_frame(frame: str) -> bool:
    """Whether a frame has one of the names of the robot's frame in REP 105 and REP 120, with or without a prefix."""
    return BASE_FRAME.search(frame) is not None


def is_world_frame(frame: str) -> bool:
    """Whether a frame has the name of one in which the robot moves, with or without a prefix."""
    return is_odometry_frame(frame) or WORLD_FRAME.search(frame) is not None


def resolve_frame(name: str, frames: Iterable[str], prefix: str = "") -> str | None:
    """The frame of a tree that a message means: drivers may leave the prefix out that others write, or reverse.

    Args:
        name: Name of the frame in the message.
        frames: Frames of the tree.
        prefix: Prefix of the robot's frames, such as "robot1", if several frames match.

    Returns:
        The frame of that name, else the only one that differs by a prefix; None if there is none.
    """
    name = name.strip("/")
    known = set(frames)
    if name in known or not name:
        return name or None
    similar = sorted(frame for frame in known if frame.endswith(f"/{name}") or name.endswith(f"/{frame}"))
    if len(similar) > 1 and prefix:
        similar = [frame for frame in similar if frame.startswith(f"{prefix.strip('/')}/")]
    return similar[0] if len(similar) == 1 else None


def shown(name: str) -> str:
    """A name for an error of one line: without control characters, and shortened."""
    plain = name if name.isprintable() else repr(name)
    return plain if len(plain) <= MAX_NAME_LENGTH else f"{plain[: MAX_NAME_LENGTH - 1]}…"


def arrow(parent: str, child: str) -> str:
    """A transform for an error or a note."""
    return f"{shown(parent)} → {shown(child)}"


def listed_frames(frames: Iterable[str]) -> str:
    """Names of frames for an error."""
    names = [shown(frame) for frame in sorted(frames)]
    listed = ", ".join(names[:MAX_FRAMES_NAMED])
    return f"{listed}, … ({len(names)} frames)" if len(names) > MAX_FRAMES_NAMED else listed or "none"
