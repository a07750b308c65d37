"""The sentence on a localization run: what it says of the map, and of the pose at the end."""

from __future__ import annotations

import numpy as np
import pytest

from wherry.localization.agreement import ScanAgreement
from wherry.localization.drive_fit import DriveFit
from wherry.localization.estimation import PoseEstimate
from wherry.localization.fit import MapFit
from wherry.localization.localizer import Localization
from wherry.pipelines.logs.verdicts import localization_verdict, lost_probability
from wherry.space.pose import Pose

AGREEMENT = ScanAgreement(1.0, 0.0, 0.0, 0.0, -0.1, 100)


def drive(fit: float, longest: float, distance: float, *, coverage: float = 1.0) -> DriveFit:
    return DriveFit(MapFit(coverage * fit, 0.0, coverage * (1.0 - fit), 1.0), distance, longest)


def localized(lost: float = 0.0) -> Localization:
    estimate = PoseEstimate(0.0, Pose(1.0, 2.0), np.eye(3), 1.0, 500, 1.0, is_updated=True)
    return Localization(estimate, lost, AGREEMENT)


def verdict(found: DriveFit, *, lost: float = 0.0, is_global: bool = True) -> str:
    return localization_verdict(found, localized(lost), is_global=is_global)


def test_a_long_drive_that_fits() -> None:
    expected = "The scans fit the map (fit 0.99), and the robot is localized (probability of being lost 0.00)."
    assert verdict(drive(0.99, 54.0, 54.0)) == expected
    assert "but the robot is probably lost at the end (probability 0.90)." in verdict(drive(0.99, 54.0, 54.0), lost=0.9)


def test_a_short_drive_cannot_tell() -> None:
    found = drive(0.95, 3.1, 3.1)
    said = verdict(found)
    assert said.startswith(
        "The scans fit the map (fit 0.95), but the robot drove only 3.1 m: too short to tell whether"
    )
    assert said.endswith(f"(probability of being lost {1.0 - found.map_probability:.2f}).")


def test_a_mirrored_map_does_not_fit_though_most_scans_do() -> None:
    found = drive(0.77, 8.0, 55.6)
    expected = "These scans do not fit this map: odometry and scans agree with it over 8.0 of 55.6 m at most."
    assert verdict(found) == expected
    assert lost_probability(found, localized()) == 1.0


def test_what_else_it_may_be_is_said() -> None:
    assert verdict(drive(0.4, 0.0, 30.0)).endswith("fit 0.40, at least 0.7 on the right map.")
    assert "the drive of 2.1 m is too short to find the pose" in verdict(drive(0.4, 0.0, 2.1))
    assert "--global searches the whole map" in verdict(drive(0.4, 0.0, 30.0), is_global=False)
    assert "it covers only 30% of what the lidar sees" in verdict(drive(1.0, 30.0, 30.0, coverage=0.3))


@pytest.mark.parametrize("lost", [0.0, 0.3])
def test_the_doubt_about_the_map_is_part_of_the_probability_of_being_lost(lost: float) -> None:
    found = drive(0.82, 18.0, 54.0)
    assert 0.5 < found.map_probability < 0.9
    assert lost_probability(found, localized(lost)) == pytest.approx(1.0 - (1.0 - lost) * found.map_probability)
    assert "only in part (fit 0.82)" in verdict(found, lost=lost)
    assert "odometry and scans agree with it over 18.0 of 54.0 m at most" in verdict(found, lost=lost)
