"""Grid Markov localization finds the robot's cell from a global start, with the resolution of a cell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wherry.localization.grid_markov import GridMarkov
from wherry.localization.parameters import AmclParameters
from wherry.space.pose import Pose
from wherry_testing.rooms import LIDAR, Building, drive, wheel_odometry

PARAMETERS = AmclParameters(alpha1=0.05, alpha2=0.05, alpha3=0.05, alpha4=0.05)


def run(filter_: GridMarkov, steps: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    truth = list(drive())[:steps]
    pairs = zip(truth, wheel_odometry(truth, rng), strict=True)
    return np.array(
        [filter_.update(now, Building().scan(now.time, pose, rng)).distance_to(pose) for pose, now in pairs]
    )


def test_global_localization_converges() -> None:
    found = run(GridMarkov(Building().grid(), LIDAR, PARAMETERS, cell_size=0.3, headings=36), 250)
    assert np.median(found[-50:]) < 0.2


def test_tracking_is_precise_to_a_cell() -> None:
    markov = GridMarkov(Building().grid(), LIDAR, PARAMETERS, cell_size=0.3, headings=36)
    markov.initialize(next(iter(drive())), np.diag([0.01, 0.01, 0.01]))
    found = run(markov, 250)
    assert np.median(found) < 0.2
    assert markov.memory == 4 * 36 * 36 * 36


def test_motion_of_whole_cells_shifts_the_histogram_exactly() -> None:
    exact = replace(PARAMETERS, alpha1=0.0, alpha2=0.0, alpha3=0.0, alpha4=0.0)
    markov = GridMarkov(Building().grid(origin=Pose()), LIDAR, exact, cell_size=0.3, headings=36)
    markov._belief[:] = 0.0
    markov._belief[9, 5, 7] = 1.0  # heading 90°
    markov._predict(Pose(0.6, 0.0, 0.0))
    assert np.unravel_index(markov._belief.argmax(), markov._belief.shape) == (9, 7, 7)
    assert markov._belief.max() > 0.999
    markov._predict(Pose(0.0, 0.0, np.radians(20.0)))
    assert np.unravel_index(markov._belief.argmax(), markov._belief.shape) == (11, 7, 7)
