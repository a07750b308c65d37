"""The odometry of a bag, from messages of Odometry or from transforms."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from wherry.errors import InputError
from wherry.logs.assembly import RecordedOdometry
from wherry.logs.rejections import Rejections
from wherry.ros.bags.recorded_transforms import RecordedTransforms, TransformTable
from wherry.ros.bags.storage import BagTopic, OpenBag
from wherry.ros.decoding import MessageError, decode_odometry, decode_transform, frames_of
from wherry.ros.frame_names import arrow, is_base_frame, is_odometry_frame, is_world_frame, resolve_frame, shown
from wherry.ros.transform_tree import Pair


@dataclass(frozen=True, slots=True)
class OdometrySeries:
    """Odometry of one frame in another.

    Attributes:
        readings: The readings in the order of the recording.
        odom: Frame of the odometry, without slashes around it; empty if it is not named.
        base: Frame whose pose it gives; empty if it is not named.
        notes: What was decided, as sentences.
    """

    readings: tuple[RecordedOdometry, ...] = ()
    odom: str = ""
    base: str = ""
    notes: tuple[str, ...] = ()


def read_odometry_messages(bag: OpenBag, topic: BagTopic, rejections: Rejections) -> OdometrySeries:
    """Odometry of a topic; of messages about several frames, those of the most frequent frame.

    Raises:
        InputError: No message can be used, or (unless the reader is lenient) one is invalid.
    """
    found: list[tuple[Pair, RecordedOdometry]] = []
    for message in bag.messages(topic):
        try:
            content = message.decode()
            odometry = decode_odometry(content)
        except MessageError as error:
            rejections.reject(message.name, str(error))
            continue
        pair = content.header.frame_id.strip("/"), content.child_frame_id.strip("/")
        found.append((pair, RecordedOdometry(message.name, odometry.time, odometry.pose, message.received)))
    if not found:
        raise InputError(bag.path, shown(topic.name), unusable_reason(topic, rejections, "--odom-topic"))
    counts = Counter(pair for pair, _ in found)
    (odom, base), count = counts.most_common(1)[0]
    readings = tuple(reading for pair, reading in found if pair == (odom, base))
    notes = []
    if count < len(found):
        used = f"{count} of {len(found)} messages, {arrow(odom, base)}, are used"
        notes.append(f"{shown(topic.name)} has odometry of several frames; {used}")
    base = "" if base == odom or is_world_frame(base) else base
    return OdometrySeries(readings, odom, base, tuple(notes))


def read_odometry_transforms(
    bag: OpenBag,
    transforms: RecordedTransforms,
    laser: str,
    prefix: str,
    chosen: BagTopic | None,
    rejections: Rejections,
) -> OdometrySeries:
    """Odometry of the robot's frame in the odom frame by transforms; empty if there are none.

    Args:
        bag: The bag.
        transforms: Its transforms.
        laser: Frame of the scans.
        prefix: Prefix of the robot's frames.
        chosen: The topic of transforms that ``--odom-topic`` names; None to choose.
        rejections: Takes unusable transforms.

    Raises:
        InputError: The topic chosen has none, or (unless the reader is lenient) a transform is invalid.
    """
    tables = transforms.tables(prefix, static_only=False) if chosen is None else iter([transforms.table(chosen)])
    table = next((table for table in tables if _odometry_pairs(table, laser, prefix)), None)
    if table is None:
        if chosen is None:
            return OdometrySeries()
        raise InputError(bag.path, f"--odom-topic {chosen.name}", "has no transform of the robot in a frame odom")
    pairs = _odometry_pairs(table, laser, prefix)
    odom, base = pairs[0]
    topics = [topic for topic in table.topics if pairs[0] in transforms.table(topic).counts]
    readings = [reading for topic in topics for reading in _readings(bag, topic, pairs[0], rejections)]
    if not readings:
        raise InputError(
            bag.path, f"{arrow(odom, base)}", f"no transform can be used (the first: {rejections.entries[0]})"
        )
    notes = [f"odometry is taken from the transforms {arrow(odom, base)}"]
    if len(pairs) > 1:
        notes[0] += f", not from {arrow(*pairs[1])}"
    return OdometrySeries(tuple(readings), odom, base, tuple(notes))


def _odometry_pairs(table: TransformTable, laser: str, prefix: str) -> list[Pair]:
    """Pairs of an odom frame and a frame of the robot, the likeliest one first."""
    tree = table.tree
    found = resolve_frame(laser, tree.frames, prefix) or laser

    def rank(pair: Pair) -> tuple[object, ...]:
        child = pair[1]
        is_connected = tree.chain(child, found) is not None
        is_own = bool(prefix) and child.startswith(f"{prefix}/")
        return (not is_connected, not is_own, not is_base_frame(child), -table.counts[pair])

    pairs = [pair for pair in table.counts if is_odometry_frame(pair[0]) and not is_world_frame(pair[1])]
    return sorted(sorted(pairs), key=rank)


def _readings(bag: OpenBag, topic: BagTopic, pair: Pair, rejections: Rejections) -> list[RecordedOdometry]:
    """The transforms of one pair on a topic."""
    readings = []
    for message in bag.messages(topic):
        try:
            links = [link for link in message.decode().transforms if frames_of(link) == pair]
        except MessageError:
            continue  # rejected already when the transforms were read
        for link in links:
            try:
                transform = decode_transform(link)
            except MessageError as error:
                rejections.reject(message.name, str(error))
            else:
                readings.append(RecordedOdometry(message.name, transform.time, transform.pose, message.received))
    return readings


def unusable_reason(topic: BagTopic, rejections: Rejections, option: str) -> str:
    """Why nothing of a topic can be used."""
    first = next((line for line in rejections.entries if line.startswith(f"{shown(topic.name)}, ")), "")
    none = "its one message cannot" if topic.count == 1 else f"none of its {topic.count:,} messages can"
    return f"{none} be used (the first: {first}); {option} chooses another topic"
