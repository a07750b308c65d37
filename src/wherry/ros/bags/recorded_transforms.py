"""The transforms of a bag: which topics belong to the robot of the scans, and the trees of their frames."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from wherry.logs.rejections import Rejections
from wherry.ros.bags.storage import BagTopic, OpenBag
from wherry.ros.bags.topics import STATIC_NAME, transform_topics
from wherry.ros.decoding import MessageError, decode_rigid_transform, frames_of
from wherry.ros.message_protocols import TransformStampedLike
from wherry.ros.transform_tree import Pair, TransformTree


@dataclass
class TransformTable:
    """The transforms of one or several topics.

    Attributes:
        tree: Tree of their frames.
        counts: Number of transforms of each pair of parent and child, of topics that are not static.
        topics: The topics.
    """

    tree: TransformTree = field(default_factory=TransformTree)
    counts: Counter[Pair] = field(default_factory=Counter)
    topics: list[BagTopic] = field(default_factory=list)

    def add_all(self, other: TransformTable) -> None:
        """Add another table."""
        self.tree.add_all(other.tree)
        self.counts.update(other.counts)
        self.topics += other.topics


class RecordedTransforms:
    """Reads the transforms of a bag, each topic once.

    Args:
        bag: The bag.
        scans: Topic of the scans, whose namespace tells the robot.
        rejections: Takes the messages that cannot be deserialized.
    """

    def __init__(self, bag: OpenBag, scans: BagTopic, rejections: Rejections) -> None:
        self._bag, self._rejections = bag, rejections
        self._namespace = scans.namespace
        self._tables: dict[BagTopic, TransformTable] = {}
        self.topics = transform_topics(bag)

    def tables(self, prefix: str, *, static_only: bool) -> Iterator[TransformTable]:
        """Transforms of the topics of the nearest namespace, then with those of the namespaces around it; at least one.

        Args:
            prefix: Prefix of the robot's frames; it tells the namespace where that of the scans has no transforms.
            static_only: Whether to leave out transforms that may change.
        """
        table = TransformTable()
        for topics in self._groups(prefix):
            for topic in topics:
                if topic.last == STATIC_NAME or not static_only:
                    table.add_all(self.table(topic))
            yield table

    def _groups(self, prefix: str) -> list[list[BagTopic]]:
        """Topics by namespace, the nearest one first."""
        depths = range(len(self._namespace), -1, -1)
        namespaces = [self._namespace[:depth] for depth in depths]
        others = sorted({topic.namespace for topic in self.topics} - {*namespaces})
        if len(others) > 1:
            others = [namespace for namespace in others if namespace == tuple(prefix.strip("/").split("/"))]
        return [
            [topic for topic in self.topics if topic.namespace == namespace] for namespace in [*namespaces, *others]
        ]

    def table(self, topic: BagTopic) -> TransformTable:
        """The transforms of a topic."""
        if topic not in self._tables:
            self._tables[topic] = _read_table(self._bag, topic, self._rejections)
        return self._tables[topic]


def _read_table(bag: OpenBag, topic: BagTopic, rejections: Rejections) -> TransformTable:
    """The transforms of a topic."""
    table, is_static = TransformTable(topics=[topic]), topic.last == STATIC_NAME
    for message in bag.messages(topic):
        try:
            transforms: Sequence[TransformStampedLike] = message.decode().transforms
        except MessageError as error:
            rejections.reject(message.name, str(error))
            continue
        for transform in transforms:
            pair = frames_of(transform)
            if not is_static:
                table.counts[pair] += 1
            try:
                table.tree.add(*pair, decode_rigid_transform(transform))
            except MessageError as error:
                table.tree.reject(*pair, message.name, str(error))
    return table
