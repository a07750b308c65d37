"""A window of the last scans, on which relocalization hypotheses are compared with the estimate."""

from __future__ import annotations

from dataclasses import dataclass

from wherry.localization.agreement import ScanAgreement, mean_agreement
from wherry.space.pose import Floats, Pose

MIN_PERIOD = 0.5  # s, minimum time from one scan in the window to the next
MAX_SCANS = 6  # maximum number of scans in the window


@dataclass(frozen=True, slots=True)
class WindowScan:
    """A scan of the window with the estimate at its time.

    Attributes:
        time: Time of the scan, s.
        odometry: Pose of base_link, odom frame.
        ends: [B, 2] m, ends of the beams, base_link frame.
        agreement: Agreement of the scan with the map at the estimated pose.
        lost_probability: Probability of being lost after the scan, 0 to 1.
    """

    time: float
    odometry: Pose
    ends: Floats
    agreement: ScanAgreement
    lost_probability: float


class ScanWindow:
    """The last scans, sampled at a minimum period."""

    def __init__(self) -> None:
        self._scans: list[WindowScan] = []

    def __len__(self) -> int:
        return len(self._scans)

    @property
    def is_full(self) -> bool:
        """Whether another scan displaces the oldest one."""
        return len(self._scans) == MAX_SCANS

    def clear(self) -> None:
        """Drop all scans."""
        self._scans.clear()

    def add(self, scan: WindowScan) -> bool:
        """Add a scan unless it follows the last one too soon; returns whether it was added."""
        if self._scans and scan.time - self._scans[-1].time < MIN_PERIOD:
            return False
        self._scans.append(scan)
        del self._scans[:-MAX_SCANS]
        return True

    def mean_agreement(self) -> ScanAgreement:
        """The mean agreement of the scans, at least one, with the map at the estimated poses."""
        return mean_agreement([scan.agreement for scan in self._scans])

    def is_lost_throughout(self, threshold: float) -> bool:
        """Whether the probability of being lost exceeded a threshold at every scan."""
        return all(scan.lost_probability > threshold for scan in self._scans)

    def relative_to(self, odometry: Pose) -> list[tuple[Pose, Floats]]:
        """Poses of base_link at the scans relative to a pose in the odom frame, and the beams' ends [B, 2] m."""
        return [(scan.odometry.relative_to(odometry), scan.ends) for scan in self._scans]
