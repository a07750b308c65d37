"""What topics and frames are called, and how often what is published: ROS's conventions, or a YAML file's.

namespace: robot1          # before every relative topic name
frame_prefix: robot1/      # before every frame but the map's
topics: {scan: front/scan, cmd_vel: /teleop/cmd_vel}
frames: {laser: lidar_link}
rates: {joint_states: 20.0}
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, TypeVar

from wherry.errors import InputError
from wherry.ros import messages as ros
from wherry.ros.topics import QosProfile, Topic
from wherry.yaml_files import check_number, load_mapping

TOPIC_NAME = re.compile(r"/?[A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*)*")
FRAME_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_./-]*")
NAMESPACE = re.compile(r"/?([A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*)*)?/?")
FASTEST = 1000.0  # Hz


@dataclass(frozen=True, slots=True)
class Topics:
    """Every topic; the default names are those of amcl, gmapping, move_base and nav2."""

    # A robot's
    scan: Topic[ros.LaserScan] = Topic("scan", ros.LaserScan, QosProfile.SENSOR)
    odom: Topic[ros.Odometry] = Topic("odom", ros.Odometry, QosProfile.SENSOR)
    tf: Topic[ros.TFMessage] = Topic("/tf", ros.TFMessage)
    tf_static: Topic[ros.TFMessage] = Topic("/tf_static", ros.TFMessage, QosProfile.LATCHED)
    clock: Topic[ros.Clock] = Topic("/clock", ros.Clock, QosProfile.SENSOR)
    joint_states: Topic[ros.JointState] = Topic("joint_states", ros.JointState)
    cmd_vel: Topic[ros.Twist] = Topic("cmd_vel", ros.Twist)
    cmd_vel_stamped: Topic[ros.TwistStamped] = Topic("cmd_vel", ros.TwistStamped)  # ROS 2; nav2 chooses one of the two
    robot_description: Topic[ros.String] = Topic("robot_description", ros.String, QosProfile.LATCHED)  # ROS 2
    latch_command: Topic[ros.JointState] = Topic("latch/command", ros.JointState)
    latch_state: Topic[ros.JointState] = Topic("latch/state", ros.JointState)
    # An outside stack's, and the agent's own
    map: Topic[ros.OccupancyGrid] = Topic("map", ros.OccupancyGrid, QosProfile.LATCHED)
    amcl_pose: Topic[ros.PoseWithCovarianceStamped] = Topic("amcl_pose", ros.PoseWithCovarianceStamped)
    initialpose: Topic[ros.PoseWithCovarianceStamped] = Topic("initialpose", ros.PoseWithCovarianceStamped)
    # The agent's own
    particlecloud: Topic[ros.PoseArray] = Topic("particlecloud", ros.PoseArray)
    plan: Topic[ros.Path] = Topic("plan", ros.Path)
    predicted_path: Topic[ros.Path] = Topic("predicted_path", ros.Path)
    markers: Topic[ros.MarkerArray] = Topic("markers", ros.MarkerArray, QosProfile.LATCHED)
    diagnostics: Topic[ros.DiagnosticArray] = Topic("/diagnostics", ros.DiagnosticArray)


@dataclass(frozen=True, slots=True)
class Frames:
    """The frames of REP 105 and REP 120, and the lidar's; nav2 and slam_toolbox look for base_footprint by default."""

    map: str = "map"
    odom: str = "odom"
    base_link: str = "base_link"
    base_footprint: str = "base_footprint"
    laser: str = "laser"


@dataclass(frozen=True, slots=True)
class Rates:
    """How often, in Hz, what has no rate of its own is published; scans and odometry come as the sensors give them."""

    clock: float = 100.0
    latch_state: float = 10.0
    diagnostics: float = 1.0


@dataclass(frozen=True, slots=True)
class RosNames:
    """All names and rates of one robot, resolved.

    Attributes:
        topics: With absolute names.
        frames: With the prefix.
        rates: Hz.
    """

    topics: Topics = Topics()
    frames: Frames = Frames()
    rates: Rates = Rates()


T = TypeVar("T", Topics, Frames, Rates)


def load_names(
    path: str | Path | None = None,
    *,
    namespace: str = "",
    frame_prefix: str = "",
    remappings: Sequence[str] = (),
) -> RosNames:
    """Read names and rates; options outrank the file, and what neither says is ROS's convention.

    Args:
        path: A YAML file as above; None for the conventions.
        namespace: Before every relative topic name.
        frame_prefix: Before every frame but the map's.
        remappings: As on ROS's command lines: "scan:=/front/scan".

    Raises:
        InputError: The file cannot be read, or a key, a name or a rate in it or in the options cannot be used.
    """
    source = "--namespace, --frame-prefix, --remap" if path is None else path
    document = {} if path is None else load_mapping(path)
    _check_keys(source, "", document, ("namespace", "frame_prefix", "topics", "frames", "rates"))
    topics = {**_section(source, document, "topics", Topics), **_remapped(remappings)}
    frames = _section(source, document, "frames", Frames)
    rates = {
        key: check_number(source, f"rates.{key}", value, most=FASTEST)
        for key, value in _section(source, document, "rates", Rates).items()
    }
    space = _matching(source, "namespace", namespace or document.get("namespace", ""), NAMESPACE).strip("/")
    prefix = frame_prefix or document.get("frame_prefix", "")
    if prefix:
        _matching(source, "frame_prefix", prefix, FRAME_NAME)
    return RosNames(_resolved(source, topics, space), _prefixed(source, frames, prefix), Rates(**rates))


def _section(source: str | Path, document: Mapping[str, Any], name: str, holder: type[T]) -> dict[str, Any]:
    """A part of the file, with no keys but those of its class."""
    section = document.get(name) or {}
    if not isinstance(section, dict):
        raise InputError(source, name, "is not a mapping")
    _check_keys(source, f"{name}.", section, tuple(entry.name for entry in fields(holder)))
    return section


def _check_keys(source: str | Path, prefix: str, section: Mapping[str, Any], known: Sequence[str]) -> None:
    for key in section:
        if key not in known:
            raise InputError(source, f"{prefix}{key}", f"is none of {', '.join(known)}")


def _remapped(remappings: Sequence[str]) -> dict[str, str]:
    """Topics' new names by their keys."""
    usual = {entry.name: getattr(Topics(), entry.name).name.lstrip("/") for entry in fields(Topics)}
    found = {}
    for remapping in remappings:
        old, _, new = remapping.partition(":=")
        keys = [key for key, name in usual.items() if name == old.lstrip("/")]
        if not keys or not new:
            raise InputError(
                "--remap", remapping, f"is not NAME:=NEW with a NAME of {', '.join(sorted({*usual.values()}))}"
            )
        found.update(dict.fromkeys(keys, new))
    return found


def _resolved(source: str | Path, names: Mapping[str, Any], namespace: str) -> Topics:
    """All topics by their absolute names."""
    topics = Topics()
    for entry in fields(Topics):
        topic: Topic[Any] = getattr(topics, entry.name)
        name = _matching(source, f"topics.{entry.name}", names.get(entry.name, topic.name), TOPIC_NAME)
        absolute = name if name.startswith("/") else "/".join(["", *([namespace] if namespace else []), name])
        topics = replace(topics, **{entry.name: replace(topic, name=absolute)})
    return topics


def _prefixed(source: str | Path, names: Mapping[str, Any], prefix: str) -> Frames:
    """All frames; several robots share one map."""
    frames = {
        entry.name: _matching(source, f"frames.{entry.name}", names.get(entry.name, entry.default), FRAME_NAME)
        for entry in fields(Frames)
    }
    return Frames(**{key: name if key == "map" else prefix + name for key, name in frames.items()})


def _matching(source: str | Path, field: str, name: Any, pattern: re.Pattern[str]) -> str:
    """The name, if ROS allows it."""
    if not isinstance(name, str) or not pattern.fullmatch(name):
        raise InputError(source, field, f"{name!r} is no name that ROS allows")
    return name
