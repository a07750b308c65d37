"""Collection of a text log's messages."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from wherry.logs.assembly import RecordedOdometry, RecordedScan, assemble_log
from wherry.logs.lidar_log import LidarLog
from wherry.logs.options import ReadingOptions
from wherry.logs.rejections import Rejections
from wherry.robot import Scan
from wherry.space.pose import IDENTITY, Pose

SICK_RANGE_MAX = 80.0  # m, longest valid range if a log gives none; without a return, SICK lidars read 81.83 or 81.91
MOUNT_TOLERANCE = 1e-3  # m and rad by which the lidar's pose on the robot may vary between scans


@dataclass
class LogCollector:
    """Scans and odometry of the messages that were read so far.

    Attributes:
        source: Name of the file.
        options: How to read.
        line: Number of the line that is being read.
        scan_message: Type of the first scan message, the only type that scans are taken from; empty before it.
        lidar_offset: Distance of the lidar ahead of base_link, m; None if the log does not give it.
        range_max: Longest valid range, m.
        scans: Scans with the poses of base_link in the odom frame.
        lidars: The lidar in the odom frame at each scan.
        odometry: Odometry messages.
        rejections: Lines that were left out, with reasons.
    """

    source: str
    options: ReadingOptions
    line: int = 0
    scan_message: str = ""
    lidar_offset: float | None = None
    range_max: float = SICK_RANGE_MAX
    scans: list[RecordedScan] = field(default_factory=list)
    lidars: list[Pose] = field(default_factory=list)
    odometry: list[RecordedOdometry] = field(default_factory=list)
    rejections: Rejections = field(init=False)

    def __post_init__(self) -> None:
        """Create the rejections."""
        self.rejections = Rejections(self.source, self.options.lenient)

    def skip_line(self, reason: str) -> None:
        """Leave the malformed line out.

        Raises:
            InputError: The collector is not lenient; the error names the line and the reason.
        """
        self.rejections.reject(self._name, reason)

    def add_scan(self, scan: Scan, robot: Pose, lidar: Pose, received: float | None = None) -> None:
        """Add a scan.

        Args:
            scan: The scan.
            robot: base_link in the odom frame.
            lidar: The lidar in the odom frame.
            received: Time at which the recorder received it, s; None if it was not recorded.
        """
        self.scans.append(RecordedScan(self._name, scan, robot, received))
        self.lidars.append(lidar)

    def add_odometry(self, time: float, pose: Pose, received: float | None = None) -> None:
        """Add odometry.

        Args:
            time: Time, s; gmapping repeats the poses of scans with time 0.
            pose: base_link in the odom frame.
            received: Time at which the recorder received it, s; None if it was not recorded.
        """
        if time == 0.0 and self.odometry:
            return
        self.odometry.append(RecordedOdometry(self._name, time, pose, received))

    def log(self) -> LidarLog:
        """The log of all messages.

        Raises:
            InputError: There are no scans, or there are outliers, see `assemble_log`.
        """
        skipped = self.rejections.entries
        return assemble_log(self.source, self.scans, self.odometry, self._mount(), self.options, skipped=skipped)

    @property
    def _name(self) -> str:
        """Name of the line that is being read."""
        return f"line {self.line}"

    def _mount(self) -> Pose:
        """The lidar in the base_link frame: from the poses of the scans if they agree, otherwise from the parameter.

        They disagree in logs where only the lidar's poses were corrected afterwards.
        """
        if self.options.lidar is not None:
            return self.options.lidar
        mounts = np.array(
            [lidar.relative_to(scan.pose).as_array() for lidar, scan in zip(self.lidars, self.scans, strict=True)]
        ).reshape(-1, 3)
        if len(mounts) and np.abs(mounts - mounts[0]).max() <= MOUNT_TOLERANCE < np.abs(mounts[0]).max():
            return Pose.from_array(mounts[0])
        return IDENTITY if self.lidar_offset is None else Pose(self.lidar_offset, 0.0, 0.0)
