"""The pose at which localization of a log starts, and what it was taken from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wherry.localization.agreement import scan_agreement
from wherry.localization.lost import EvidenceModel
from wherry.localization.parameters import KNOWN_START_COVARIANCE, LOG_PARAMETERS, AmclParameters
from wherry.localization.refinement import match_scan
from wherry.localization.sensor import valid_beams
from wherry.logs.lidar_log import LidarLog
from wherry.pipelines.logs.reference import Reference
from wherry.pipelines.logs.verdicts import pose_text
from wherry.space.distance_field import DistanceField
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose

CHECKED_SCANS = 5  # first scans that are compared with the map at the start pose
MAX_FIELD_DISTANCE = 1.0  # m, distance at which the distance field is truncated
MATCH_SIGMA = 0.05  # m, standard deviation of the beam ends around the obstacles


@dataclass(frozen=True, slots=True)
class Start:
    """Where localization starts.

    Attributes:
        pose: Pose of base_link at the first scan, map frame; None if the whole map is searched.
        is_from_reference: Whether the pose is the reference's.
        notes: What was assumed, as sentences for the user.
    """

    pose: Pose | None
    is_from_reference: bool = False
    notes: tuple[str, ...] = ()


def choose_start(
    log: LidarLog,
    grid: OccupancyGrid,
    parameters: AmclParameters | None,
    reference: Reference | None,
    *,
    is_global: bool,
) -> Start:
    """The start pose: none if the start is global, else that of the parameters, the reference, or the map's origin.

    A reference in another frame than the map states a wrong pose. If the first scans do not fit the map there, the
    whole map is searched instead.

    Args:
        log: The scans, all with odometry.
        grid: The map.
        parameters: Content of a parameter file; None without one.
        reference: The reference trajectory; None without one.
        is_global: Whether the whole map is searched.
    """
    if is_global:
        return Start(None)
    check = StartCheck(log, grid)
    if parameters is not None and parameters.set_initial_pose:
        pose, source = parameters.initial_pose, "the parameters' initial pose"
        hint = "; --global searches the whole map"
    elif reference is not None:
        pose = _first_pose(log, reference)
        if check.fits(pose, KNOWN_START_COVARIANCE):
            return Start(pose, is_from_reference=True)
        lead = f"The first scans do not fit the map at the reference's first pose ({pose_text(pose)})"
        return Start(None, notes=(f"{lead}, which may be in another frame: the whole map is searched for the start.",))
    else:
        pose, source = (parameters or LOG_PARAMETERS).initial_pose, "the map's origin, as no start pose is given"
        hint = "; --global searches the whole map, and --params or --reference state a start pose"
    covariance = np.diag((parameters or LOG_PARAMETERS).initial_covariance)
    fits = check.fits(pose, covariance)
    if fits and parameters is not None and parameters.set_initial_pose:
        return Start(pose)
    doubt = "" if fits else f". The first scans do not fit the map there{hint}"
    return Start(pose, notes=(f"Localization starts at ({pose_text(pose)}), {source}{doubt}.",))


class StartCheck:
    """Compares the first scans of a log with the map at a start pose.

    Args:
        log: The scans, all with odometry.
        grid: The map.
    """

    def __init__(self, log: LidarLog, grid: OccupancyGrid) -> None:
        self._log = log
        self._field = DistanceField.of(grid, MAX_FIELD_DISTANCE)
        self._known = ~grid.unknown

    def fits(self, start: Pose, covariance: Floats) -> bool:
        """Whether the first scans fit the map near a start pose with covariance [3, 3] m, m, rad."""
        model, evidence = EvidenceModel(), []
        first = self._log.scan_odometry[0]
        for index, odometry in enumerate(self._log.scan_odometry[:CHECKED_SCANS]):
            ends = valid_beams(self._log.deskewed(index), self._log.lidar, LOG_PARAMETERS).ends
            if odometry is None or first is None or not len(ends):
                continue
            prior = start @ odometry.pose.relative_to(first.pose)
            match = match_scan(self._field, ends, prior, covariance, MATCH_SIGMA)
            evidence.append(model.evidence(scan_agreement(self._field, self._known, ends, self._log.lidar, match.pose)))
        return not evidence or float(np.median(evidence)) < 0.0


def _first_pose(log: LidarLog, reference: Reference) -> Pose:
    """The reference's pose at the first scan, by odometry from the first scan for which it has one."""
    index = int(reference.indices[0])
    pose, odometry, first = Pose.from_array(reference.poses[0]), log.scan_odometry[index], log.scan_odometry[0]
    if odometry is None or first is None:
        raise ValueError("a scan has no odometry")
    return pose @ first.pose.relative_to(odometry.pose)
