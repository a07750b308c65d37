"""Collection of a text log's messages."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from wherry.errors import InputError
from wherry.logs.assembly import assemble_log
from wherry.logs.lidar_log import MAX_RANGES, LidarLog
from wherry.logs.mounts import find_mount
from wherry.logs.options import ReadingOptions
from wherry.logs.recorded import Recorded, RecordedOdometry, RecordedScan
from wherry.logs.rejections import Rejections, without_numbers
from wherry.logs.timestamps import MAX_TIME, unit_of
from wherry.robot import Scan
from wherry.space.pose import Floats, Pose

SICK_RANGE_MAX = 80.0  # m, longest valid range if a log gives none; without a return, SICK lidars read 81.83 or 81.91
MAX_MESSAGES = 1_500_000  # total of scans and odometry of a log, seven hours at 10 Hz and 50 Hz
MOUNTS = ("offset", "side_offset", "angular_offset")  # ends of the names of parameters: m ahead, m to the left, rad
FRONT, REAR = "robot_frontlaser_", "robot_rearlaser_"
FRONT_MESSAGES, REAR_MESSAGES = ("FLASER", "ROBOTLASER1", "RAWLASER1"), ("RLASER", "ROBOTLASER2", "RAWLASER2")
PREFERRED_MESSAGES = ("ROBOTLASER1", "FLASER", "L", "ROBOTLASER0", "RAWLASER1")
MIN_PREFERRED_SHARE = 0.5  # scans of a preferred message, as a share of those of the most frequent one
RANGE_PARAMETER = "robot_front_laser_max"
FIELD_PARAMETER, RESOLUTION_PARAMETER = "laser_front_laser_fov", "laser_front_laser_resolution"
PARAMETERS = (
    *(side + end for side in (FRONT, REAR) for end in MOUNTS),
    RANGE_PARAMETER,
    FIELD_PARAMETER,
    RESOLUTION_PARAMETER,
)


@dataclass
class LogCollector:
    """Scans and odometry of the messages that were read so far.

    Attributes:
        source: Name of the file.
        options: How to read.
        line: Number of the line that is being read.
        parameters: Values of the log's parameters that are used, by name; None for those that it does not have.
        scans: Scans with the poses of base_link in the odom frame, by the type of the message.
        lidars: Poses of base_link and of the lidar in the odom frame at these scans, by the type of the message.
        odometry: Odometry messages.
        unread_lasers: Numbers of messages that may be scans, but of an unknown format, by type.
        rejections: Lines that were left out, with reasons.
        messages: Number of scans and odometry messages.
        ranges: Number of ranges of all scans.
        scan_notes: What was assumed about the scans, by the type of the message and the kind of the assumption.
        notes: What was decided about the log.
    """

    source: str
    options: ReadingOptions
    line: int = 0
    parameters: dict[str, float | None] = field(default_factory=lambda: dict.fromkeys(PARAMETERS))
    scans: dict[str, list[RecordedScan]] = field(default_factory=dict)
    lidars: dict[str, list[tuple[Pose, Pose]]] = field(default_factory=dict)
    odometry: list[RecordedOdometry] = field(default_factory=list)
    unread_lasers: Counter[str] = field(default_factory=Counter)
    rejections: Rejections = field(init=False)
    scan_notes: dict[str, dict[str, str]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    messages: int = 0
    ranges: int = 0

    def __post_init__(self) -> None:
        """Create the rejections."""
        self.rejections = Rejections(self.source, self.options.lenient)

    @property
    def range_max(self) -> float:
        """Longest valid range of messages that do not state it, m."""
        value = self.parameters[RANGE_PARAMETER]
        return value if value is not None and value > 0.0 else SICK_RANGE_MAX

    @property
    def front_field_of_view(self) -> float | None:
        """Field of view of messages that do not state it, rad or degrees; None if no parameter gives it."""
        return self.parameters[FIELD_PARAMETER]

    @property
    def front_resolution(self) -> float | None:
        """Angle between beams of messages that do not state it, degrees; None if no parameter gives it."""
        return self.parameters[RESOLUTION_PARAMETER]

    def note_of(self, message: str, text: str) -> None:
        """Note an assumption about the scans of a type of message, the first of each kind; an empty text is ignored."""
        if text:
            self.scan_notes.setdefault(message, {}).setdefault(without_numbers(text), f"{message}: {text}")

    def skip_line(self, reason: str) -> None:
        """Leave the malformed line out.

        Raises:
            InputError: The collector is not lenient; the error names the line and the reason.
        """
        self.rejections.reject(self._name, reason)

    def add_scan(
        self, message: str, scan: Scan, robot: Pose | None, lidar: Pose | None, received: float | None = None
    ) -> None:
        """Add a scan.

        Args:
            message: Type of the message.
            scan: The scan.
            robot: base_link in the odom frame; None if the message does not give it.
            lidar: The lidar in the odom frame; None if the message does not give it.
            received: Time at which the recorder received it, s; None if it was not recorded.

        Raises:
            InputError: The scans of the log do not fit into memory.
        """
        self.ranges += len(scan.ranges)
        self._count_message()
        self.scans.setdefault(message, []).append(RecordedScan(self._name, scan, robot, received))
        if robot is not None and lidar is not None:
            self.lidars.setdefault(message, []).append((robot, lidar))

    def add_odometry(self, time: float, pose: Pose, received: float | None = None) -> None:
        """Add odometry.

        Args:
            time: Time, s; gmapping repeats the poses of scans with time 0.
            pose: base_link in the odom frame.
            received: Time at which the recorder received it, s; None if it was not recorded.

        Raises:
            InputError: The odometry of the log does not fit into memory.
        """
        if time == 0.0 and self.odometry:
            return
        self._count_message()
        self.odometry.append(RecordedOdometry(self._name, time, pose, received))

    def _count_message(self) -> None:
        """Count a message, and check that the log fits into memory."""
        self.messages += 1
        if self.messages > MAX_MESSAGES or self.ranges > MAX_RANGES:
            limit = f"{MAX_MESSAGES:,} messages and {MAX_RANGES:,} ranges that fit into memory"
            raise InputError(self.source, self._name, f"exceeds the {limit}")

    def log(self) -> LidarLog:
        """The log of all messages.

        Raises:
            InputError: There are no scans, nothing states where the lidar sits, or there are outliers, see
                `assemble_log`.
        """
        message = self._chosen_message()
        scans = self.scans.get(message, [])
        mount = Pose()
        if scans:
            pairs = self.lidars.get(message, [])
            mount, mount_note = find_mount(self.source, pairs, self._stated_mount(message), self.options.lidar)
            self.notes += [*self.scan_notes.get(message, {}).values(), *([mount_note] if mount_note else [])]
        times = np.array([recorded.scan.time for recorded in scans])
        odometry_times = np.array([reading.time for reading in self.odometry])
        timed = self._in_seconds(scans, times, "scans")
        return assemble_log(
            self.source,
            timed,
            self._in_seconds(self.odometry, odometry_times, "odometry"),
            mount,
            self.options,
            skipped=self.rejections.entries,
            notes=self.notes,
            skipped_scans=len(scans) - len(timed),
        )

    @property
    def _name(self) -> str:
        """Name of the line that is being read."""
        return f"line {self.line}"

    def _chosen_message(self) -> str:
        """The type of message that scans are taken from: the one asked for, else a usual one, else the most frequent.

        Raises:
            InputError: The log has no scans of the type asked for, or only scans of unknown formats.
        """
        counts = {message: len(scans) for message, scans in self.scans.items()}
        found = ", ".join(f"{message} ({count:,})" for message, count in (counts | self.unread_lasers).items())
        wanted = self.options.scan_topic
        if wanted is not None and wanted not in counts:
            raise InputError(self.source, "--scan-topic", f"{wanted} has no scans in it; there are {found or 'none'}")
        if not counts:
            if self.unread_lasers:
                raise InputError(self.source, "", f"has scans in messages of unknown formats only: {found}")
            return ""
        most = max(counts.values())
        usual = [name for name in PREFERRED_MESSAGES if counts.get(name, 0) >= MIN_PREFERRED_SHARE * most]
        message = wanted or (usual or sorted(counts, key=lambda name: (-counts[name], name)))[0]
        if len(counts) + len(self.unread_lasers) > 1:
            self.notes.append(f"the scans are those of {message}, of {found}; --scan-topic chooses others")
        return message

    def _stated_mount(self, message: str) -> Pose | None:
        """The lidar in the base_link frame by the log's parameters; None if there are none for the message."""
        side = FRONT if message in FRONT_MESSAGES else REAR if message in REAR_MESSAGES else ""
        values = [self.parameters.get(side + end) for end in MOUNTS]
        if all(value is None for value in values):
            return None
        default_angle = np.pi if side == REAR else 0.0
        return Pose.from_array(
            np.array([values[0] or 0.0, values[1] or 0.0, default_angle if values[2] is None else values[2]])
        )

    def _in_seconds(self, recorded: Sequence[Recorded], times: Floats, name: str) -> list[Recorded]:
        """What was recorded with its stamps, [N], in seconds, without impossible ones."""
        unit, unit_name = unit_of(times)
        if unit != 1.0:
            self.notes.append(f"the times of the {name} are in {unit_name}: they are converted to seconds")
        kept: list[Recorded] = []
        for entry, time in zip(recorded, times.tolist(), strict=True):
            if abs(time * unit) > MAX_TIME:
                self.rejections.reject(entry.name, f"has a time beyond {MAX_TIME:g} s")
            else:
                kept.append(entry if unit == 1.0 else entry.at(time * unit))
        return kept
