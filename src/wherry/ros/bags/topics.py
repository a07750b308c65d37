"""Choice of the topics of a bag that scans, odometry and transforms are read from."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice, takewhile

from wherry.errors import InputError
from wherry.ros.bags.storage import ODOMETRY, SCAN, TRANSFORMS, BagTopic, OpenBag
from wherry.ros.frame_names import shown

MAX_TOPICS_NAMED = 4  # topics that a message lists
STATIC_NAME = "tf_static"
TRANSFORM_NAMES = ("tf", STATIC_NAME)  # last components of the names of transform topics
OTHER_SENSORS = {
    "sensor_msgs/msg/MultiEchoLaserScan": "laser_proc makes LaserScan messages of its first echoes",
    "sensor_msgs/msg/PointCloud2": "pointcloud_to_laserscan makes LaserScan messages of it",
    "sensor_msgs/msg/PointCloud": "pointcloud_to_laserscan makes LaserScan messages of it",
}


def choose_scan_topic(bag: OpenBag, requested: str | None, notes: list[str]) -> BagTopic:
    """The topic of the scans: the one requested, or of those that have messages ``/scan``, then one whose name ends in
    ``/scan``, then one whose name ends in ``base_scan`` as of PR2 and Fetch, then the one with most messages.

    Args:
        bag: The bag.
        requested: Value of ``--scan-topic``; None to choose.
        notes: List to add a note to if there are several.

    Raises:
        InputError: The topic requested has no scans, or there are none at all.
    """
    topics = [topic for topic in bag.topics if topic.type == SCAN]
    filled = [topic for topic in topics if topic.count]
    if requested is not None:
        return _requested_topic(bag, requested, filled, "--scan-topic", "LaserScan")
    if not filled:
        raise InputError(bag.path, "", f"has no usable LaserScan messages{_other_sensor(bag, topics)}")
    chosen = min(filled, key=_scan_rank)
    if len(topics) > 1:
        notes.append(_choice("scans are", chosen, topics, "--scan-topic"))
    return chosen


def choose_odometry_topic(bag: OpenBag, scans: BagTopic, requested: str | None, notes: list[str]) -> BagTopic | None:
    """The topic of odometry: the one requested, or of those with Odometry messages the one in the namespace of the
    scans, then ``/odom``, then one whose name has "odom" in it, then the one with most messages.

    Topics in the namespace of another scan topic are of another robot.

    Args:
        bag: The bag.
        scans: Topic of the scans.
        requested: Value of ``--odom-topic``, which may be a topic of transforms; None to choose.
        notes: List to add notes to.

    Returns:
        The topic; None if there is no topic of Odometry messages, so that transforms may give the odometry.

    Raises:
        InputError: The topic requested has no odometry.
    """
    topics = [topic for topic in bag.topics if topic.type == ODOMETRY]
    filled = [topic for topic in topics if topic.count]
    if requested is not None:
        transforms = [topic for topic in bag.topics if topic.type in TRANSFORMS and topic.count]
        return _requested_topic(bag, requested, [*filled, *transforms], "--odom-topic", "Odometry or TFMessage")
    own = [topic for topic in filled if not _is_of_other_robot(bag, topic, scans)]
    if not own:
        if topics:
            reason = "another robot's" if filled else "empty"
            notes.append(f"{_named(filled or topics)} is {reason} and was not read; --odom-topic chooses odometry")
        return None
    chosen = min(own, key=lambda topic: _odometry_rank(topic, scans))
    if len(topics) > 1:
        notes.append(_choice("odometry is", chosen, topics, "--odom-topic"))
    elif "odom" not in chosen.name:
        notes.append(f"odometry is taken from {_named([chosen])}; --odom-topic chooses")
    return chosen


def transform_topics(bag: OpenBag) -> list[BagTopic]:
    """Topics of transforms that have messages; the static ones first."""
    topics = [t for t in bag.topics if t.type in TRANSFORMS and t.count and t.last in TRANSFORM_NAMES]
    return sorted(topics, key=lambda topic: topic.last != STATIC_NAME)


def _scan_rank(topic: BagTopic) -> tuple[object, ...]:
    """Order in which topics of scans are preferred."""
    return (topic.absolute != "/scan", topic.last != "scan", topic.last != "base_scan", -topic.count, topic.name)


def _odometry_rank(topic: BagTopic, scans: BagTopic) -> tuple[object, ...]:
    """Order in which topics of odometry are preferred."""
    pairs = zip(topic.namespace, scans.namespace, strict=False)
    shared = sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs))
    return (-shared, topic.last != "odom", "odom" not in topic.name, len(topic.namespace), -topic.count, topic.name)


def _is_of_other_robot(bag: OpenBag, topic: BagTopic, scans: BagTopic) -> bool:
    """Whether a topic is in the namespace of other scans only."""
    if not topic.namespace or topic.namespace[:1] == scans.namespace[:1]:
        return False
    others = (other for other in bag.topics if other.type == SCAN and other.count)
    return any(other.namespace[:1] == topic.namespace[:1] for other in others)


def _requested_topic(
    bag: OpenBag, requested: str, usable: Sequence[BagTopic], option: str, type_names: str
) -> BagTopic:
    """The topic that an option names.

    Raises:
        InputError: It is not usable; the error lists those that are.
    """
    name = f"/{requested.strip('/')}"
    for topic in usable:
        if topic.absolute == name:
            return topic
    found = [topic for topic in bag.topics if topic.absolute == name]
    reason = "is not in the bag"
    if found:
        reason = f"is of {shown(found[0].type)}" if found[0].count else "has no messages"
    raise InputError(bag.path, f"{option} {requested}", f"{reason}; topics of {type_names} messages: {_named(usable)}")


def _choice(what: str, chosen: BagTopic, topics: Sequence[BagTopic], option: str) -> str:
    """A note of which of several topics was chosen."""
    others = [topic for topic in topics if topic != chosen]
    return f"{what} taken from {_named([chosen])}, not from {_named(others)}; {option} chooses"


def _named(topics: Sequence[BagTopic]) -> str:
    """Names of topics and their numbers of messages."""
    named = (f"{shown(topic.name)} ({topic.count} message{'s' * (topic.count != 1)})" for topic in topics)
    names = ", ".join(islice(named, MAX_TOPICS_NAMED))
    return f"{names}, … ({len(topics)} topics)" if len(topics) > MAX_TOPICS_NAMED else names or "none"


def _other_sensor(bag: OpenBag, topics: Sequence[BagTopic]) -> str:
    """What a bag without scans has instead."""
    if topics:
        return f"; its {_named(topics)} is empty"
    for topic in bag.topics:
        if topic.type in OTHER_SENSORS and topic.count:
            return f"; its {shown(topic.name)} is of {topic.short_type}, and {OTHER_SENSORS[topic.type]}"
    for topic in bag.topics:
        if topic.last == "scan":
            return f"; its {shown(topic.name)} is of {shown(topic.type)}"
    return ""
