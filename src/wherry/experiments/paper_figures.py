"""The paper's figures, from our own runs: the world (Fig. 1), laser and particles (Fig. 3), map and path (Fig. 4)."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from wherry.domains.taxi import taxi_grid
from wherry.environments.grids import taxi_figures
from wherry.environments.pictures import in_colour
from wherry.experiments.localization.kidnapping import Wanderer, true_map
from wherry.experiments.results import write_picture
from wherry.floorplan.generation import place_boxes
from wherry.floorplan.plan import FloorPlan
from wherry.floorplan.world_files import find_world
from wherry.localization.amcl import Amcl
from wherry.localization.parameters import AmclParameters
from wherry.navigation.controller import safe_velocity
from wherry.pipelines.delivery.agent import DeliveryEpisode, delivery_learner
from wherry.pipelines.delivery.page import choose_pictures
from wherry.realization.mission import Mission, order_from_plan
from wherry.robot import Odometry
from wherry.simulation import Simulation, build
from wherry.simulation.rendering import SceneRenderer
from wherry.space.pose import Floats, Pose
from wherry.trace.records import Record, RobotSnapshot
from wherry.views.drawing import Scene, draw

Progress = Callable[[int, int], None]

SEED = 0
BUILDING, MAZE = "rooms", "taxi10"
PARTICLES = 5000
INSTANTS = (0.0, 0.3, 10.0)  # s after the robot was switched on somewhere
NOTHING = np.empty((0, 2))

CAPTIONS = {
    "fig1a-taxi.png": "Fig. 1a: the Taxi world: taxi yellow, passenger blue, destination green",
    "fig1b-world.png": "Fig. 1b: the simulated building with walls, obstacles and cylindrical boxes",
    "fig3-laser.svg": "Fig. 3: walls and boxes stop the laser's beams (blue) while the robot maps",
    "fig3-particles-0.svg": "Fig. 3: AMCL in a maze, switched on somewhere: the robot could be anywhere (red)",
    "fig3-particles-1.svg": "The first scans leave few places that look alike",
    "fig3-particles-2.svg": f"After {INSTANTS[2]:.0f} s of driving, one place is left",
    "fig4-map.svg": "Fig. 4: the robot's own map, and in green where it means to drive",
}


def reproduce(images: Path, progress: Progress) -> str:
    """Make the figures and return a section of Markdown that shows them.

    Args:
        images: The folder for the pictures; it stands beside the results file.
        progress: Told how many pictures are done, of how many.

    Raises:
        InputError: The folder cannot be written to, or nothing can be rendered here.
    """
    shown = []
    for done, (name, content) in enumerate(figures()):
        progress(done, len(CAPTIONS))
        shown.append(f"{write_picture(images, name, content, CAPTIONS[name])}\n*{CAPTIONS[name]}.*")
    worlds = f"From the worlds `{BUILDING}` and `{MAZE}`, seed {SEED}."
    return "\n\n".join(["## The paper's figures", worlds, *shown]) + "\n"


def figures() -> Iterator[tuple[str, bytes]]:
    """Each figure's file name and content."""
    taxi = taxi_grid(5)
    state = taxi.state_of((2, 2), passenger="Y", destination="R")
    yield "fig1a-taxi.png", _png(in_colour(taxi.plan, taxi_figures(state)))
    plan = place_boxes(find_world(BUILDING), 4, np.random.default_rng(SEED))
    simulation = build(plan, np.random.default_rng(SEED))
    with closing(SceneRenderer(simulation, 1000, 1000)) as renderer:
        yield "fig1b-world.png", _png(renderer.overhead())
    laser, carrying = _delivery_pictures(simulation, plan)
    yield "fig3-laser.svg", laser.encode()
    for number, picture in enumerate(_particles()):
        yield f"fig3-particles-{number}.svg", picture.encode()
    yield "fig4-map.svg", carrying.encode()


def _png(pixels: NDArray[np.uint8]) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def _delivery_pictures(simulation: Simulation, plan: FloorPlan) -> tuple[str, str]:
    """The laser while the robot maps, and the path while it carries a box."""
    records: list[Record] = []
    world_from_map = simulation.physics.robot_pose  # the map's frame is where the robot starts
    rng = np.random.default_rng(SEED)
    ready = Mission(simulation.robot, order_from_plan(plan), records.append, rng).explore()
    delivery = DeliveryEpisode(ready, delivery_learner("bayes"), records.append, rng)
    for _ in delivery:
        pass
    carrying, _, mapping, _ = choose_pictures(records, delivery.world, plan, world_from_map)
    return mapping.svg, carrying.svg


def _particles() -> Iterator[str]:
    """The cloud of particles while a robot that was switched on somewhere finds out where it is."""
    plan = find_world(MAZE).with_boxes(())
    simulation = build(plan, np.random.default_rng(SEED))
    robot, grid = simulation.robot, true_map(plan)
    parameters = AmclParameters(max_particles=PARTICLES, update_min_d=0.05, update_min_a=0.05)
    amcl = Amcl(grid, robot.body.lidar, parameters, np.random.default_rng(SEED))
    amcl.initialize_globally()
    scene = Scene(grid, np.empty((0, 4, 2)), np.empty((0, 2, 2)), robot.body.radius, robot.body.box_radius)
    wanderer, instants = Wanderer(np.random.default_rng(SEED)), list(INSTANTS)
    odometry: Odometry | None = None
    driven: list[tuple[float, float]] = []
    while instants:
        measurement = robot.receive()
        if isinstance(measurement, Odometry):
            odometry = measurement
        elif odometry is not None:
            truth = simulation.physics.robot_pose
            driven.append((truth.x, truth.y))
            if measurement.time >= instants[0]:
                instants.pop(0)
                yield _moment(scene, amcl, truth, measurement.time, np.array(driven))
            amcl.update(odometry, measurement)
            robot.command(safe_velocity(wanderer.velocity(measurement), measurement, robot.body))


def _moment(scene: Scene, amcl: Amcl, truth: Pose, time: float, driven: Floats) -> str:
    """One instant; the robot is drawn where it truly is."""
    seen = RobotSnapshot(
        time=time,
        pose=truth,
        lidar=truth,
        points=NOTHING.astype(np.float32),
        particles=amcl.particles.astype(np.float32),
        path=NOTHING.astype(np.float32),
        boxes=NOTHING.astype(np.float32),
        has_load=False,
    )
    label = f"Particles {time:.1f} s after the robot was switched on"
    return draw(scene, seen, driven, NOTHING, label=label)
