"""The scans of a bag: those of one lidar, with what was corrected in them."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from wherry.errors import InputError
from wherry.logs.assembly import RecordedScan
from wherry.robot import Scan
from wherry.ros.bags.rejections import Rejections
from wherry.ros.bags.storage import BagTopic, OpenBag
from wherry.ros.decoding import MessageError, decode_laser_scan

MAX_RANGES = 200_000_000  # total of all scans, 1.6 GB
MAX_FRAMES_NAMED = 3  # frames of scans that a note lists
MAX_SWEEP_RATIO = 1.1  # time from the first beam to the last ÷ time from a scan to the next
MIN_NEAREST_COUNT = 100  # readings at range_min from which on they may be no measurements
MIN_NEAREST_SHARE = 0.02  # share of readings at range_min above which they are no measurements, but not obstacles


@dataclass(frozen=True, slots=True)
class ScanSeries:
    """Scans of one lidar.

    Attributes:
        scans: The scans in the order of the recording.
        frame: Frame of the lidar, without slashes around it.
        notes: What was decided or corrected, as sentences.
    """

    scans: tuple[RecordedScan, ...]
    frame: str
    notes: tuple[str, ...]


def read_scans(bag: OpenBag, topic: BagTopic, rejections: Rejections) -> ScanSeries:
    """Scans of a topic; of scans in several frames, those of the most frequent frame.

    Raises:
        InputError: There are too many, none can be used, or (unless the reader is lenient) one is invalid.
    """
    remarks: Counter[str] = Counter()
    found: list[tuple[str, RecordedScan]] = []
    ranges = 0
    for message in bag.messages(topic):
        try:
            content = message.decode()
            scan = decode_laser_scan(content, on_remark=lambda remark: remarks.update([remark]))
        except MessageError as error:
            rejections.add(message.name, error)
            continue
        ranges += len(scan.ranges)
        if ranges > MAX_RANGES:
            raise InputError(bag.path, message.name, f"exceeds the {MAX_RANGES:,} ranges that fit into memory")
        found.append((content.header.frame_id.strip("/"), RecordedScan(message.name, scan, None, message.received)))
    if not found:
        raise InputError(bag.path, topic.name, _unusable_reason(topic, rejections))
    notes = [f"{topic.name}: {remark} ({count} of {topic.count} scans)" for remark, count in sorted(remarks.items())]
    counts = Counter(frame for frame, _ in found)
    frame = counts.most_common(1)[0][0]
    if len(counts) > 1:
        listed = ", ".join(f"{name!r} ({count})" for name, count in counts.most_common(MAX_FRAMES_NAMED))
        notes.append(f"{topic.name} has scans in the frames {listed}; those in {frame!r} are used")
    scans = [recorded for name, recorded in found if name == frame]
    for correct in (_without_impossible_times, _without_nearest_readings):
        scans, note = correct(topic.name, scans)
        notes += [note] if note else []
    return ScanSeries(tuple(scans), frame, tuple(notes))


def _without_impossible_times(topic: str, scans: list[RecordedScan]) -> tuple[list[RecordedScan], str]:
    """The scans, without beam times that would make a sweep longer than the time from a scan to the next."""
    steps = np.diff([recorded.scan.time for recorded in scans])
    steps = steps[steps > 0.0]
    if len(steps) == 0:
        return scans, ""
    limit = MAX_SWEEP_RATIO * float(np.median(steps))
    excess = sum(recorded.scan.duration > limit for recorded in scans)
    if excess <= len(scans) / 2:
        return scans, ""
    longest = max(recorded.scan.duration for recorded in scans)
    note = (
        f"{topic}: time_increment would make a scan last {longest:.3g} s where the next one follows after "
        f"{limit / MAX_SWEEP_RATIO:.3g} s, so the scans are not corrected for motion"
    )
    return [_with_scan(recorded, replace(recorded.scan, time_increment=0.0)) for recorded in scans], note


def _without_nearest_readings(topic: str, scans: list[RecordedScan]) -> tuple[list[RecordedScan], str]:
    """The scans, without readings of −inf or range_min if they are too many to be obstacles that near."""
    near = [recorded.scan.ranges == recorded.scan.range_min for recorded in scans]
    count = sum(int(beams.sum()) for beams in near)
    share = count / sum(map(len, near))
    if count < MIN_NEAREST_COUNT or share <= MIN_NEAREST_SHARE:
        return scans, ""
    note = f"{topic}: {share:.0%} of the readings are −inf or range_min, which is taken for no measurement"
    cleared = [
        _with_scan(recorded, replace(recorded.scan, ranges=np.where(beams, np.nan, recorded.scan.ranges)))
        for recorded, beams in zip(scans, near, strict=True)
    ]
    return cleared, note


def _with_scan(recorded: RecordedScan, scan: Scan) -> RecordedScan:
    return replace(recorded, scan=scan)


def _unusable_reason(topic: BagTopic, rejections: Rejections) -> str:
    """Why no scan of a topic can be used."""
    first = f", the first: {rejections.skipped[0]}" if rejections.skipped else ""
    return f"has no usable LaserScan messages ({len(rejections.skipped)} skipped{first}); --scan-topic chooses another"
