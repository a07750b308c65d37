"""The longest consistent stretch of a drive, and the probability that the map is right."""

from __future__ import annotations

import pytest

from wherry.localization.agreement import ScanAgreement
from wherry.localization.drive_fit import SHORT_DRIVE, DriveFit, DrivenScan, fits_map
from wherry.space.pose import Pose

STEP = 0.5  # m between the scans


def drive(fits: list[float], *, scale: float = 1.0, jumps: tuple[int, ...] = (), step: float = STEP) -> DriveFit:
    """A straight drive whose scans have the given fractions of inliers, the others passed through walls.

    Args:
        fits: Fractions of inliers of the scans.
        scale: Distance by the estimate per distance by odometry.
        jumps: Indices of scans before which the estimate jumped 2 m to the side.
        step: Distance between scans, m.
    """
    scans = []
    for index, inliers in enumerate(fits):
        side = 2.0 * sum(jump <= index for jump in jumps)
        agreement = ScanAgreement(inliers, 0.0, 1.0 - inliers, 0.0, -1.0, 100)
        scans.append(DrivenScan(Pose(step * index, 0.0), Pose(scale * step * index, side), agreement))
    return DriveFit.of(scans)


def test_a_drive_that_fits_is_one_stretch() -> None:
    found = drive([0.95] * 81)
    assert (found.distance, found.longest) == (pytest.approx(40.0), pytest.approx(40.0))
    assert found.map_probability > 0.95
    assert fits_map(found)


def test_a_jump_of_the_estimate_ends_a_stretch() -> None:
    assert drive([0.95] * 81, jumps=(60,)).longest == pytest.approx(29.5)
    assert drive([0.95] * 81, jumps=(20, 40, 60)).longest == pytest.approx(10.0, abs=0.5)


def test_scans_that_contradict_the_map_end_a_stretch() -> None:
    assert drive([0.95] * 41 + [0.1] * 40).longest == pytest.approx(20.0, abs=1.0)
    assert drive([0.1] * 81).longest == 0.0


def test_a_scan_that_is_blocked_alone_does_not() -> None:
    assert drive([0.95] * 40 + [0.3] + [0.95] * 40).longest == pytest.approx(40.0)


def test_an_estimate_that_moves_further_than_odometry_is_no_jump_within_its_errors() -> None:
    assert drive([0.95] * 81, scale=1.1).longest == pytest.approx(40.0)
    assert drive([0.95] * 81, scale=2.0).longest == 0.0


def test_scans_beyond_the_known_part_of_the_map_support_nothing() -> None:
    unknown = ScanAgreement(0.2, 0.0, 0.0, 0.8, -1.0, 100)
    scans = [DrivenScan(Pose(STEP * n), Pose(STEP * n), unknown) for n in range(81)]
    assert DriveFit.of(scans).longest == 0.0
    assert not fits_map(DriveFit.of(scans))


def test_a_mediocre_fit_in_short_stretches_is_another_map_unless_the_drive_is_short() -> None:
    jumps = tuple(range(10, 200, 10))
    long = drive([0.77] * 81, jumps=jumps)
    assert long.map_probability < 0.5
    assert not fits_map(long)
    short = drive([0.77] * 21, jumps=jumps)
    assert short.distance < SHORT_DRIVE
    assert short.map_probability < 0.5
    assert fits_map(short)


def test_longer_drives_are_surer() -> None:
    probabilities = [drive([0.95] * scans).map_probability for scans in (2, 6, 21, 81)]
    assert probabilities == sorted(probabilities)
    assert probabilities[0] < 0.8
    assert probabilities[-1] > 0.95


def test_a_robot_that_stands_still_is_not_sure_of_its_map() -> None:
    still = drive([1.0] * 50, step=0.0)
    assert (still.distance, still.longest) == (0.0, 0.0)
    assert fits_map(still)
    assert still.map_probability < 0.95


def test_scans_without_readings_say_nothing() -> None:
    empty = ScanAgreement(0.0, 0.0, 0.0, 0.0, 0.0, 0)
    assert not fits_map(DriveFit.of([DrivenScan(Pose(), Pose(), empty)]))
