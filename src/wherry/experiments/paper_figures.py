"""The paper's figures from runs of wherry: worlds (Fig. 1), laser and particles (Fig. 3), map and path (Fig. 4)."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from wherry.domains.taxi import taxi_grid
from wherry.environments.grids import taxi_sprites
from wherry.environments.rendering import render_rgb
from wherry.experiments.localization.wandering import RandomWalk
from wherry.experiments.results import write_picture
from wherry.floorplan.generation import place_boxes
from wherry.floorplan.plan import FloorPlan
from wherry.floorplan.world_files import find_world
from wherry.localization.amcl import Amcl
from wherry.localization.parameters import AmclParameters
from wherry.navigation.controller import safe_velocity
from wherry.pipelines.delivery.agent import DeliveryEpisode, delivery_learner
from wherry.pipelines.delivery.page import draw_pictures
from wherry.realization.mission import Mission, order_from_plan
from wherry.robot import Odometry
from wherry.simulation import Simulation, build
from wherry.simulation.ground_truth import true_map
from wherry.simulation.rendering import SceneRenderer
from wherry.space.pose import Floats, Pose
from wherry.trace.records import Record, RobotSnapshot
from wherry.views.snapshot_svg import MapBackground, draw_snapshot

Progress = Callable[[int, int], None]

SEED = 0
BUILDING, MAZE = "rooms", "taxi10"
PARTICLES = 5000
DRAWN_TIMES = (0.0, 0.3, 10.0)  # s after the start of global localization
NO_POINTS = np.empty((0, 2))

CAPTIONS = {
    "fig1a-taxi.png": "Fig. 1a: the Taxi world with taxi (yellow), passenger (blue) and destination (green)",
    "fig1b-world.png": "Fig. 1b: the simulated building with walls, obstacles and cylindrical boxes",
    "fig3-laser.svg": "Fig. 3: the laser's beams (blue) end on walls and boxes while the robot maps",
    "fig3-particles-0.svg": "Fig. 3: AMCL in a maze, global localization: the particles (red) cover all free space",
    "fig3-particles-1.svg": "After the first scans, a few modes are left where the maze looks alike",
    "fig3-particles-2.svg": f"After {DRAWN_TIMES[2]:.0f} s of driving, one mode is left",
    "fig4-map.svg": "Fig. 4: the robot's map and its planned path (green)",
}


def reproduce(images: Path, progress: Progress) -> str:
    """Draw the figures and return a Markdown section that shows them.

    Args:
        images: Folder for the pictures, beside the results file.
        progress: Called with the number of finished pictures and their total.

    Raises:
        InputError: The folder cannot be written to, or rendering does not work here.
    """
    sections = []
    for done, (name, content) in enumerate(figures()):
        progress(done, len(CAPTIONS))
        sections.append(f"{write_picture(images, name, content, CAPTIONS[name])}\n*{CAPTIONS[name]}.*")
    worlds = f"From the worlds `{BUILDING}` and `{MAZE}`, seed {SEED}."
    return "\n\n".join(["## The paper's figures", worlds, *sections]) + "\n"


def figures() -> Iterator[tuple[str, bytes]]:
    """Yield the file name and the content of each figure."""
    taxi = taxi_grid(5)
    state = taxi.state_of((2, 2), passenger="Y", destination="R")
    yield "fig1a-taxi.png", _png(render_rgb(taxi.plan, taxi_sprites(state)))
    plan = place_boxes(find_world(BUILDING), 4, np.random.default_rng(SEED))
    simulation = build(plan, np.random.default_rng(SEED))
    with closing(SceneRenderer(simulation, 1000, 1000)) as renderer:
        yield "fig1b-world.png", _png(renderer.overhead())
    laser, carrying = _delivery_pictures(simulation, plan)
    yield "fig3-laser.svg", laser.encode()
    for index, picture in enumerate(_particles()):
        yield f"fig3-particles-{index}.svg", picture.encode()
    yield "fig4-map.svg", carrying.encode()


def _png(pixels: NDArray[np.uint8]) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def _delivery_pictures(simulation: Simulation, plan: FloorPlan) -> tuple[str, str]:
    """Return two pictures of a delivery, as SVG: beams while the robot maps, and its path while it carries a box."""
    records: list[Record] = []
    world_from_map = simulation.physics.robot_pose  # the map frame is the robot's start pose
    rng = np.random.default_rng(SEED)
    ready = Mission(simulation.robot, order_from_plan(plan), records.append, rng).explore()
    delivery = DeliveryEpisode(ready, delivery_learner("bayes"), records.append, rng)
    for _ in delivery:
        pass
    carrying, _, mapping, _ = draw_pictures(records, delivery.world, plan, world_from_map)
    return mapping.svg, carrying.svg


def _particles() -> Iterator[str]:
    """Yield a picture of the particles, as SVG, at each of `DRAWN_TIMES` during global localization."""
    plan = find_world(MAZE).with_boxes(())
    simulation = build(plan, np.random.default_rng(SEED))
    robot, grid = simulation.robot, true_map(plan)
    parameters = AmclParameters(max_particles=PARTICLES, update_min_d=0.05, update_min_a=0.05)
    amcl = Amcl(grid, robot.body.lidar, parameters, np.random.default_rng(SEED))
    amcl.initialize_globally()
    background = MapBackground(grid, np.empty((0, 4, 2)), np.empty((0, 2, 2)), robot.body.radius, robot.body.box_radius)
    walk, drawn_times = RandomWalk(np.random.default_rng(SEED)), list(DRAWN_TIMES)
    odometry: Odometry | None = None
    driven: list[tuple[float, float]] = []
    while drawn_times:
        measurement = robot.receive()
        if isinstance(measurement, Odometry):
            odometry = measurement
        elif odometry is not None:
            truth = simulation.physics.robot_pose
            driven.append((truth.x, truth.y))
            if measurement.time >= drawn_times[0]:
                drawn_times.pop(0)
                yield _particles_at(background, amcl, truth, measurement.time, np.array(driven))
            amcl.update(odometry, measurement)
            robot.command(safe_velocity(walk.velocity(measurement), measurement, robot.body))


def _particles_at(background: MapBackground, amcl: Amcl, truth: Pose, time: float, driven: Floats) -> str:
    """Return a picture of the particles, as SVG, with the robot at its true pose.

    Args:
        background: The map.
        amcl: The filter.
        truth: True pose of the robot, map frame.
        time: Time since the start of global localization, s.
        driven: [N, 2] true positions of the robot so far, m, map frame.
    """
    snapshot = RobotSnapshot(
        time=time,
        pose=truth,
        lidar=truth,
        points=NO_POINTS.astype(np.float32),
        particles=amcl.particles.astype(np.float32),
        path=NO_POINTS.astype(np.float32),
        boxes=NO_POINTS.astype(np.float32),
        has_load=False,
    )
    label = f"Particles {time:.1f} s after the start of global localization"
    return draw_snapshot(background, snapshot, driven, NO_POINTS, label=label)
