"""The scans of a bag: those of one lidar, with what was corrected in them."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from wherry.errors import InputError
from wherry.logs.assembly import RecordedScan
from wherry.logs.lidar_log import MAX_RANGES
from wherry.logs.rejections import Rejections, joined
from wherry.ros.bags.storage import BagTopic, OpenBag
from wherry.ros.decoding import MessageError, decode_laser_scan
from wherry.ros.frame_names import shown

MAX_FRAMES_NAMED = 3  # frames of scans that a note lists
MIN_NEAREST_COUNT = 100  # readings at range_min from which on they may be no measurements
MIN_NEAREST_SHARE = 0.02  # share of readings at range_min above which they are no measurements, but not obstacles


@dataclass(frozen=True, slots=True)
class ScanSeries:
    """Scans of one lidar.

    Attributes:
        scans: The scans in the order of the recording.
        frame: Frame of the lidar, without slashes around it.
        rejected: Number of scans that were left out as invalid.
        notes: What was decided or corrected, as sentences.
    """

    scans: tuple[RecordedScan, ...]
    frame: str
    rejected: int
    notes: tuple[str, ...]


def read_scans(bag: OpenBag, topic: BagTopic, rejections: Rejections) -> ScanSeries:
    """Scans of a topic; of scans in several frames, those of the most frequent frame.

    Raises:
        InputError: There are too many, none can be used, or (unless the reader is lenient) one is invalid.
    """
    rejected_before, name = len(rejections.entries), shown(topic.name)
    remarks: Counter[str] = Counter()
    found = _decoded(bag, topic, rejections, remarks)
    rejected = len(rejections.entries) - rejected_before
    if not found:
        raise InputError(bag.path, name, _unusable_reason(rejections))
    notes = [f"{name}: {remark} ({count} of {topic.count} scans)" for remark, count in sorted(remarks.items())]
    counts = Counter(frame for frame, _ in found)
    frame = counts.most_common(1)[0][0]
    if len(counts) > 1:
        listed = ", ".join(f"{shown(each)!r} ({count})" for each, count in counts.most_common(MAX_FRAMES_NAMED))
        notes.append(f"{name} has scans in the frames {listed}; those in {shown(frame)!r} are used")
    scans, note = _without_nearest_readings(name, [recorded for each, recorded in found if each == frame])
    return ScanSeries(tuple(scans), frame, rejected, joined([*notes, note]))


def _decoded(
    bag: OpenBag, topic: BagTopic, rejections: Rejections, remarks: Counter[str]
) -> list[tuple[str, RecordedScan]]:
    """The usable scans of a topic, each with its frame; what was corrected in them is counted in ``remarks``.

    Raises:
        InputError: There are too many, or (unless the reader is lenient) one is invalid.
    """
    found: list[tuple[str, RecordedScan]] = []
    ranges = 0
    for message in bag.messages(topic):
        try:
            content = message.decode()
            scan = decode_laser_scan(content, on_remark=lambda remark: remarks.update([remark]))
        except MessageError as error:
            rejections.reject(message.name, str(error))
            continue
        ranges += len(scan.ranges)
        if ranges > MAX_RANGES:
            raise InputError(bag.path, message.name, f"exceeds the {MAX_RANGES:,} ranges that fit into memory")
        found.append((content.header.frame_id.strip("/"), RecordedScan(message.name, scan, None, message.received)))
    return found


def _without_nearest_readings(topic: str, scans: list[RecordedScan]) -> tuple[list[RecordedScan], str]:
    """The scans, without readings of −inf or range_min if they are too many to be obstacles that near."""
    near = [recorded.scan.ranges == recorded.scan.range_min for recorded in scans]
    count = sum(int(beams.sum()) for beams in near)
    share = count / sum(map(len, near))
    if count < MIN_NEAREST_COUNT or share <= MIN_NEAREST_SHARE:
        return scans, ""
    note = f"{topic}: {share:.0%} of the readings are −inf or range_min, which is taken for no measurement"
    cleared = [
        replace(recorded, scan=replace(recorded.scan, ranges=np.where(beams, np.nan, recorded.scan.ranges)))
        for recorded, beams in zip(scans, near, strict=True)
    ]
    return cleared, note


def _unusable_reason(rejections: Rejections) -> str:
    """Why no scan of a topic can be used."""
    first = f", the first: {rejections.entries[0]}" if rejections.entries else ""
    return f"has no usable LaserScan messages ({len(rejections.entries)} skipped{first}); --scan-topic chooses another"
