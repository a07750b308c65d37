"""Names of topics and frames, and publishing rates: ROS's conventions, or those of a YAML file such as this one.

namespace: robot1          # before every relative topic name
frame_prefix: robot1/      # before every frame but the map's
topics: {scan: front/scan, cmd_vel: /teleop/cmd_vel}
frames: {laser: lidar_link}
rates: {diagnostics: 2.0}  # Hz
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, Field

from wherry.documents import Document, Number, load_yaml, validate
from wherry.errors import InputError
from wherry.ros import messages as ros
from wherry.ros.topics import QosProfile, Topic

TOPIC_NAME = re.compile(r"/?[A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*)*")
FRAME_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_./-]*")
FRAME_PREFIX = re.compile(rf"({FRAME_NAME.pattern})?")
NAMESPACE = re.compile(r"/?([A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*)*)?/?")
MAX_RATE = 1000.0  # Hz
OPTIONS = "--namespace, --frame-prefix, --remap"


@dataclass(frozen=True, slots=True)
class Topics:
    """All topics; the default names are those of amcl, gmapping, move_base and nav2."""

    # Topics of the robot
    scan: Topic[ros.LaserScan] = Topic("scan", ros.LaserScan, QosProfile.SENSOR)
    odom: Topic[ros.Odometry] = Topic("odom", ros.Odometry, QosProfile.SENSOR)
    tf: Topic[ros.TFMessage] = Topic("/tf", ros.TFMessage)
    tf_static: Topic[ros.TFMessage] = Topic("/tf_static", ros.TFMessage, QosProfile.LATCHED)
    clock: Topic[ros.Clock] = Topic("/clock", ros.Clock, QosProfile.SENSOR)
    joint_states: Topic[ros.JointState] = Topic("joint_states", ros.JointState)
    cmd_vel: Topic[ros.Twist] = Topic("cmd_vel", ros.Twist)
    cmd_vel_stamped: Topic[ros.TwistStamped] = Topic("cmd_vel", ros.TwistStamped)  # ROS 2; nav2 uses one of the two
    robot_description: Topic[ros.String] = Topic("robot_description", ros.String, QosProfile.LATCHED)  # ROS 2
    latch_command: Topic[ros.JointState] = Topic("latch/command", ros.JointState)
    latch_state: Topic[ros.JointState] = Topic("latch/state", ros.JointState)
    # Topics of either an external navigation stack or the agent
    map: Topic[ros.OccupancyGrid] = Topic("map", ros.OccupancyGrid, QosProfile.LATCHED)
    amcl_pose: Topic[ros.PoseWithCovarianceStamped] = Topic("amcl_pose", ros.PoseWithCovarianceStamped)
    initialpose: Topic[ros.PoseWithCovarianceStamped] = Topic("initialpose", ros.PoseWithCovarianceStamped)
    # Topics of the agent
    particlecloud: Topic[ros.PoseArray] = Topic("particlecloud", ros.PoseArray)
    plan: Topic[ros.Path] = Topic("plan", ros.Path)
    predicted_path: Topic[ros.Path] = Topic("predicted_path", ros.Path)
    markers: Topic[ros.MarkerArray] = Topic("markers", ros.MarkerArray, QosProfile.LATCHED)
    diagnostics: Topic[ros.DiagnosticArray] = Topic("/diagnostics", ros.DiagnosticArray)


@dataclass(frozen=True, slots=True)
class Frames:
    """Names of the frames of REP 105 and REP 120, and of the lidar's frame.

    Attributes:
        map: Frame of the map, fixed in the world.
        odom: Frame of the odometry, which drifts.
        base_link: Frame of the robot, at the middle of the drive axle.
        base_footprint: base_link on the floor, which nav2 and slam_toolbox use by default.
        laser: Frame of the lidar.
    """

    map: str = "map"
    odom: str = "odom"
    base_link: str = "base_link"
    base_footprint: str = "base_footprint"
    laser: str = "laser"


@dataclass(frozen=True, slots=True)
class Rates:
    """Publishing rates of the topics that are not published with each measurement.

    Attributes:
        clock: Rate of ``/clock``, Hz.
        latch_state: Rate of ``latch/state``, Hz.
        diagnostics: Rate of ``/diagnostics``, Hz.
    """

    clock: float = 100.0
    latch_state: float = 10.0
    diagnostics: float = 1.0


@dataclass(frozen=True, slots=True)
class RosNames:
    """The names of a robot's topics and frames, and the rates of its topics.

    Attributes:
        topics: Topics with their absolute names.
        frames: Names of the frames, with the robot's prefix.
        rates: Publishing rates, Hz.
    """

    topics: Topics = Topics()
    frames: Frames = Frames()
    rates: Rates = Rates()


def _check_name(pattern: re.Pattern[str], name: str) -> str:
    if not pattern.fullmatch(name):
        raise ValueError(f"{name!r} is not a name that ROS allows")
    return name


TopicName = Annotated[str, AfterValidator(partial(_check_name, TOPIC_NAME))]
FrameName = Annotated[str, AfterValidator(partial(_check_name, FRAME_NAME))]


class _NamesFile(Document):
    """The contents of a YAML file, or the values of the command line's options, which take precedence."""

    namespace: Annotated[str, AfterValidator(partial(_check_name, NAMESPACE))] = ""
    frame_prefix: Annotated[str, AfterValidator(partial(_check_name, FRAME_PREFIX))] = ""
    topics: dict[str, TopicName] | None = None
    frames: dict[str, FrameName] | None = None
    rates: dict[str, Annotated[Number, Field(gt=0.0, le=MAX_RATE)]] | None = None


def load_names(
    path: str | Path | None = None,
    *,
    namespace: str = "",
    frame_prefix: str = "",
    remappings: Sequence[str] = (),
) -> RosNames:
    """Read names and rates; options take precedence over the file, and the file over ROS's conventions.

    Args:
        path: A YAML file as above; None for the conventions.
        namespace: Prefix of all relative topic names.
        frame_prefix: Prefix of all frames except the map's.
        remappings: As on ROS's command lines: "scan:=/front/scan".

    Raises:
        InputError: The file cannot be read, or a field, name or rate in it or in the options cannot be used.
    """
    file = _NamesFile() if path is None else load_yaml(path, _NamesFile)
    source = OPTIONS if path is None else path
    for section, values, known in (
        ("topics", file.topics, Topics),
        ("frames", file.frames, Frames),
        ("rates", file.rates, Rates),
    ):
        _check_fields(source, section, values or {}, [entry.name for entry in fields(known)])
    given = {"namespace": namespace, "frame_prefix": frame_prefix, "topics": _parse_remappings(remappings)}
    options = validate(_NamesFile, given, OPTIONS)
    topics = {**(file.topics or {}), **(options.topics or {})}
    prefix = options.frame_prefix or file.frame_prefix
    return RosNames(
        _absolute_topics(topics, (options.namespace or file.namespace).strip("/")),
        _prefixed_frames(file.frames or {}, prefix),
        Rates(**(file.rates or {})),
    )


def _check_fields(source: str | Path, section: str, values: Mapping[str, Any], known: Sequence[str]) -> None:
    """Refuse unknown fields of a section."""
    for key in values:
        if key not in known:
            raise InputError(source, f"{section}.{key}", f"is none of {', '.join(known)}")


def _parse_remappings(remappings: Sequence[str]) -> dict[str, str]:
    """New names of topics by the fields of `Topics`."""
    defaults = {entry.name: getattr(Topics(), entry.name).name.lstrip("/") for entry in fields(Topics)}
    found = {}
    for remapping in remappings:
        old, _, new = remapping.partition(":=")
        keys = [key for key, name in defaults.items() if name == old.lstrip("/")]
        if not keys or not new:
            known = ", ".join(sorted({*defaults.values()}))
            raise InputError("--remap", remapping, f"is not NAME:=NEW with a NAME of {known}")
        found.update(dict.fromkeys(keys, new))
    return found


def _absolute_topics(names: Mapping[str, str], namespace: str) -> Topics:
    """All topics with their absolute names."""
    topics = Topics()
    for entry in fields(Topics):
        topic: Topic[Any] = getattr(topics, entry.name)
        name = names.get(entry.name, topic.name)
        absolute = name if name.startswith("/") else "/".join(["", *([namespace] if namespace else []), name])
        topics = replace(topics, **{entry.name: replace(topic, name=absolute)})
    return topics


def _prefixed_frames(names: Mapping[str, str], prefix: str) -> Frames:
    """All frames, each with the robot's prefix except the map, which several robots share."""
    frames = {**asdict(Frames()), **names}
    return Frames(**{key: name if key == "map" else f"{prefix}{name}" for key, name in frames.items()})
