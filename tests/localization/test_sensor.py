"""Sensor models: selection of beams, likelihood field, beam skipping and beam model."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wherry.localization.parameters import LASER_MODELS, AmclParameters
from wherry.localization.sensor import SENSOR_MODELS, Beams, SensorModel, trace_ray, valid_beams
from wherry.robot import Scan
from wherry.space.distance_field import DistanceField
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry_testing.rooms import LIDAR, Building

PARAMETERS = AmclParameters()


def test_every_laser_model_of_the_parameters_exists() -> None:
    assert tuple(SENSOR_MODELS) == LASER_MODELS


def scan_of(ranges: list[float]) -> Scan:
    return Scan(0.0, np.array(ranges), 0.0, 0.1, 0.1, 10.0)


def test_invalid_readings_are_dropped() -> None:
    scan = scan_of([math.nan, math.inf, -math.inf, -1.0, 0.0, 0.05, 1.0, 2.0, 10.0, 11.0])
    np.testing.assert_allclose(valid_beams(scan, Pose(), PARAMETERS).ranges, [1.0, 2.0])
    limits = AmclParameters(laser_min_range=1.5, laser_max_range=5.0)
    np.testing.assert_allclose(valid_beams(scan, Pose(), limits).ranges, [2.0])
    assert len(valid_beams(scan_of([math.nan] * 5), Pose(), PARAMETERS)) == 0


def test_evenly_spaced_beams_are_in_the_base_frame() -> None:
    scan = Scan(0.0, np.ones(181), -math.pi / 2, math.pi / 180, 0.1, 10.0)
    beams = valid_beams(scan, Pose(0.2, 0.0, math.pi / 2), PARAMETERS).evenly_spaced(3)
    np.testing.assert_allclose(beams.ends, [[1.2, 0.0], [0.2, 1.0], [-0.8, 0.0]], atol=1e-12)


def one_wall(origin: Pose = Pose()) -> DistanceField:  # noqa: B008
    probability = np.full((100, 100), 0.1, np.float32)
    probability[:, 80] = 0.9  # its centre is at x = 8.05 m
    return DistanceField.of(OccupancyGrid(probability, 0.1, origin), 2.0)


@pytest.mark.parametrize("origin", [Pose(), Pose(-3.0, 5.0, 0.7)])
def test_likelihood_field_computes_its_formula(origin: Pose) -> None:
    field = one_wall(origin)
    rng = np.random.default_rng(0)
    ends = rng.uniform(-4.0, 4.0, (7, 2))
    beams = Beams(ends, Pose(), np.hypot(*ends.T), 10.0)
    local = [Pose(x, y, t) for x, y, t in rng.uniform([0, 0, -3], [10, 10, 3], (20, 3))]
    particles = np.array([(origin @ pose).as_array() for pose in local])
    log_weights = np.full(20, 0.5)
    SENSOR_MODELS["likelihood_field"](field, PARAMETERS).add_log_likelihood(particles, beams, log_weights)
    for particle, found in zip(particles, log_weights, strict=True):
        distance = field.at(Pose.from_array(particle).transform(ends))
        p = 0.5 * np.exp(-(distance**2) / (2 * 0.2**2)) + 0.5 / 10.0
        assert found == pytest.approx(0.5 + np.log(p).sum(), abs=1e-4)


def test_beam_skipping_drops_beams_that_agree_with_few_particles() -> None:
    field = one_wall()
    particles = np.array([[5.05, 5.05, 0.0]]).repeat(10, axis=0)
    wall, box = [3.0, 0.0], [0.5, 0.0]
    skipping = SENSOR_MODELS["likelihood_field_prob"](field, PARAMETERS)
    plain = SENSOR_MODELS["likelihood_field"](field, PARAMETERS)

    def log_weights_by(model: SensorModel, ends: list[list[float]]) -> np.ndarray:
        log_weights = np.zeros(10)
        beams = Beams(np.array(ends), Pose(), np.hypot(*np.array(ends).T), 10.0)
        model.add_log_likelihood(particles, beams, log_weights)
        return log_weights

    np.testing.assert_allclose(log_weights_by(skipping, [wall, wall, box]), log_weights_by(plain, [wall, wall]))
    # With more than 90 % of the beams to be skipped, none is.
    np.testing.assert_allclose(log_weights_by(skipping, [box] * 10), log_weights_by(plain, [box] * 10))


def test_rays_end_at_the_first_obstacle() -> None:
    field = one_wall()
    for angle in np.linspace(-1.0, 1.0, 41):
        length = trace_ray(field.distance, 0.1, 20.5, 50.5, math.cos(angle), math.sin(angle), 12.0)
        if abs(5.95 * math.tan(angle)) < 4.9:
            assert length * math.cos(angle) == pytest.approx(5.95, abs=0.1)
    assert trace_ray(field.distance, 0.1, 20.5, 50.5, -1.0, 0.0, 12.0) == 12.0


def test_beam_model_prefers_the_true_pose() -> None:
    building = Building()
    grid = building.grid()
    parameters = AmclParameters(laser_model_type="beam", sigma_hit=0.1)
    model = SENSOR_MODELS["beam"](DistanceField.of(grid, 2.0), parameters)
    truth = Pose(4.5, 2.0, 0.4)
    beams = valid_beams(building.scan(0.0, truth), LIDAR, parameters).evenly_spaced(60)
    offsets = [(0.0, 0.0, 0.0), (0.3, 0.0, 0.0), (0.0, -0.3, 0.0), (0.0, 0.0, 0.2), (1.0, 1.0, 1.0)]
    log_weights = np.zeros(len(offsets))
    model.add_log_likelihood(truth.as_array() + np.array(offsets), beams, log_weights)
    assert log_weights.argmax() == 0
    assert np.isfinite(log_weights).all()
