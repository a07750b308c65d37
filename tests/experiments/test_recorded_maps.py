"""Maps of recorded buildings, scored by true relations and by the corrected poses of their logs."""

from __future__ import annotations

import numpy as np
import pytest

from wherry.evaluation import absolute_trajectory_error, load_relations, relation_errors
from wherry.experiments.mapping.drifting_odometry import (
    FALSE_DISTANCE,
    closure_errors,
    drifting_odometry,
    map_building,
)
from wherry.logs.options import ReadingOptions
from wherry.logs.reading import read_log
from wherry.logs.tables import read_odometry
from wherry.mapping.graph_slam import GraphSlam
from wherry.mapping.particle_slam import ParticleSlam
from wherry.mapping.settings import GraphSlamSettings, ParticleSlamSettings
from wherry.robot import Odometry, Velocity
from wherry.space.pose import Pose
from wherry.space.trajectory import merge_odometry
from wherry_testing.buildings import shared_data


def test_graph_slam_on_intel_is_better_than_gmapping() -> None:
    log = read_log(shared_data("intel/intel_910_rawodom.clf.gz"))
    slam = GraphSlam(log.lidar, GraphSlamSettings(empty_range=0.0))
    for scan, odometry in zip(log.scans, log.scan_odometry, strict=True):
        slam.add(scan, odometry)
    slam.finish()
    dense = merge_odometry(log.odometry, read_odometry(shared_data("intel/intel_rawodom_dense.txt.gz")))
    found = relation_errors(slam.trajectory, load_relations(shared_data("intel/intel.relations.gz")), dense)
    assert found.relations == 2984
    assert found.translational_error_m <= 0.066
    assert found.far_translational_error_m <= 0.072
    assert found.rotational_error_deg <= 1.5


@pytest.mark.parametrize(("name", "largest"), [("aces", 0.15), ("csail", 0.15), ("fhw", 0.30)])
def test_drifting_odometry_is_corrected(name: str, largest: float) -> None:
    result = map_building(shared_data(f"radish/{name}-corrected.log.gz"), name, seed=1)
    assert result.odometry_rmse_m > 1.0
    assert result.rmse_m <= largest
    assert result.closures > 20
    assert result.false_closures == 0


def test_a_short_range_lidar_closes_loops_after_large_errors() -> None:
    """The front end's errors exceed its covariances, so search windows are too narrow at first."""
    log = read_log(shared_data("radish/fhw-corrected.log.gz"), ReadingOptions(lenient=True))
    reference = np.array([odometry.pose.as_array() for odometry in log.scan_odometry if odometry is not None])
    odometry = drifting_odometry(reference, np.random.default_rng(2))
    slam = GraphSlam(log.lidar, GraphSlamSettings(range_limit=12.0, empty_range=0.0))
    for scan, pose in zip(log.scans, odometry, strict=True):
        slam.add(scan, Odometry(scan.time, Pose.from_array(pose), Velocity()))
    slam.finish()
    accepted = [closure for closure in slam.loop_closures if closure.is_accepted]
    errors = closure_errors(slam.snapshot().keyframe_scans, accepted, reference)
    assert absolute_trajectory_error(slam.trajectory.poses, reference) <= 0.30
    assert errors[:, 0].max() < FALSE_DISTANCE


@pytest.mark.slow
def test_particle_slam_on_intel_is_as_good_as_gmapping() -> None:
    log = read_log(shared_data("intel/intel_910_rawodom.clf.gz"))
    slam = ParticleSlam(Pose(), np.random.default_rng(0), ParticleSlamSettings(empty_range=0.0))
    for scan, odometry in zip(log.scans, log.scan_odometry, strict=True):
        slam.add(scan, odometry)
    dense = merge_odometry(log.odometry, read_odometry(shared_data("intel/intel_rawodom_dense.txt.gz")))
    relations = load_relations(shared_data("intel/intel.relations.gz"))
    assert relation_errors(slam.trajectory, relations, dense).translational_error_m <= 0.09
