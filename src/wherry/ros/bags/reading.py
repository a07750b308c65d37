"""ROS 1 and ROS 2 bags as lidar logs, without a ROS installation (the rosbags package, optional extra ``bags``)."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

from wherry.errors import InputError
from wherry.logs.assembly import assemble_log
from wherry.logs.lidar_log import LidarLog
from wherry.logs.options import DEFAULT_READING, ReadingOptions
from wherry.logs.rejections import Rejections
from wherry.ros.bags.files import RecordingFiles, find_files, is_bag
from wherry.ros.bags.mounts import MountFinder, RobotFrames
from wherry.ros.bags.recorded_odometry import read_odometry_messages, read_odometry_transforms
from wherry.ros.bags.recorded_scans import read_scans
from wherry.ros.bags.recorded_transforms import RecordedTransforms
from wherry.ros.bags.storage import ODOMETRY, SCAN, BagTopic, OpenBag, open_bag, open_other_parts
from wherry.ros.bags.topics import choose_odometry_topic, choose_scan_topic
from wherry.ros.transforms import Mount

__all__ = ["is_bag", "read_bag"]

UNKNOWN_MOUNT = "no transform says where the lidar sits on the robot, so its frame is taken for the robot's"


def read_bag(path: str | Path, options: ReadingOptions = DEFAULT_READING) -> LidarLog:
    """Read the scans of a bag, its odometry, and where the lidar sits on the robot.

    Messages are decoded and checked as those of a live robot (`wherry.ros.decoding`). The topics are those of the
    options, otherwise they are chosen as `wherry.ros.bags.topics` says; a bag without Odometry messages gets its
    odometry from the transforms of the robot's frame in the odom frame. The lidar's pose on the robot follows from the
    transforms, static or constant, of all frames between. Scans of a lidar that hangs upside down are mirrored.

    Args:
        path: A ROS 1 bag, the folder of a ROS 2 bag, one of its .mcap or .db3 files, or the folder of a split
            recording.
        options: How to read.

    Raises:
        InputError: The rosbags package is missing, the bag cannot be read or has no scans, the lidar's pose on the
            robot is unknown, or (unless lenient) a message is invalid; the error names the topic and the message.
    """
    path = Path(path)
    recording = find_files(path)
    with open_bag(path, recording.files) as bag:
        return _read_log(bag, recording, options)


def _read_log(bag: OpenBag, recording: RecordingFiles, options: ReadingOptions) -> LidarLog:
    """The log of an open bag."""
    rejections, notes = Rejections(str(bag.path), options.lenient), [*recording.notes]
    topic = choose_scan_topic(bag, options.scan_topic, notes)
    odometry_topic = choose_odometry_topic(bag, topic, options.odometry_topic, notes)
    scans = read_scans(bag, topic, rejections)
    frames = RobotFrames(
        scans.frame,
        "",
        "",
        has_odometry=False,
        namespace="".join(topic.namespace[:1]),
        has_other_scans=sum(other.type == SCAN and other.count > 0 for other in bag.topics) > 1,
    )
    transforms = RecordedTransforms(bag, topic, rejections)
    if odometry_topic is not None and odometry_topic.type == ODOMETRY:
        odometry = read_odometry_messages(bag, odometry_topic, rejections)
    else:
        odometry = read_odometry_transforms(bag, transforms, scans.frame, frames.prefix, odometry_topic, rejections)
    frames = replace(frames, base=odometry.base, odom=odometry.odom, has_odometry=bool(odometry.readings))
    notes += [*scans.notes, *odometry.notes]
    finder = MountFinder(transforms, frames, rejections, notes)
    mount = _mount(finder, options, partial(_mount_in_other_parts, recording, topic, finder))
    upright = [replace(recorded, scan=mount.upright(recorded.scan)) for recorded in scans.scans]
    return assemble_log(
        str(bag.path),
        upright,
        odometry.readings,
        mount.pose,
        options,
        skipped=rejections.entries,
        skipped_scans=scans.rejected,
        notes=notes,
    )


def _mount(finder: MountFinder, options: ReadingOptions, find_elsewhere: Callable[[], Mount | None]) -> Mount:
    """The lidar's mount: as the user states it, by the transforms of the bag or of the other parts of its recording.

    Raises:
        InputError: It is unknown, and the bag has odometry; or a transform cannot be used.
    """
    if options.lidar is not None:
        found = None
        with suppress(InputError):  # what the user states holds, whatever is wrong with the transforms
            found = finder.find()
        return finder.stated(options.lidar, found)
    mount = finder.find() or find_elsewhere()
    if mount is not None:
        return mount
    error = finder.unusable_transform() or (finder.unknown() if finder.frames.has_odometry else None)
    if error is not None:
        raise error
    finder.notes.append(UNKNOWN_MOUNT)
    return Mount()


def _mount_in_other_parts(recording: RecordingFiles, scans: BagTopic, finder: MountFinder) -> Mount | None:
    """The mount by the transforms in the other files of a split recording; None if they do not tell it."""
    rejections = finder.rejections
    with open_other_parts(Path(rejections.source), recording) as bag:
        if bag is None:
            return None
        elsewhere = MountFinder(RecordedTransforms(bag, scans, rejections), finder.frames, rejections, finder.notes)
        mount = elsewhere.find()
    if mount is not None:
        first = recording.other_parts[0].name
        finder.notes.append(f"the lidar's pose on the robot is taken from other files of the recording, as {first}")
    return mount
