"""A world and its robot as SDF: for Gazebo Sim from Fortress on, and for the classic Gazebo of ROS 1.

The templates in ``templates/`` hold the structure; sizes, poses, masses, inertias, limits and sensors are the
simulator's. Where MuJoCo and Gazebo differ:

- For two surfaces in contact, Gazebo's engines use the smaller coefficient of friction, MuJoCo the larger. The floor
  therefore has the wheels' coefficient, so that wheels, caster and boxes slide on it as in the simulator.
- A wheel's edge touches the floor along a line and scrubs when the robot turns on the spot. The simulator's wheels are
  ellipsoids, which Gazebo's engines lack; here a thin disc of the wheel's radius touches.
- A detachable joint begins attached. Publishers of the world itself detach all joints during the first 2 s.
- There is no conveyor. A message on `removal_topic` moves a delivered box out of the building.
- A rendering lidar would see its own housing from inside; the housing is invisible to it.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import jinja2

from wherry.floorplan.plan import FloorPlan
from wherry.gazebo import latch_topics
from wherry.gazebo.latch_topics import OPENING_SECONDS, ROBOT, box_name
from wherry.gazebo.robot_model import read_robot_model
from wherry.robot import BOX_HEIGHT
from wherry.simulation.drive import TRACK_WIDTH, WHEEL_RADIUS
from wherry.simulation.lidar import LidarSpecification
from wherry.simulation.model import (
    BODY,
    BOX_COLOUR,
    BOX_MASS,
    BOX_RADIUS,
    COLOURS,
    FLOOR_FRICTION,
    MAX_MOTOR_TORQUE,
    WALL_HEIGHT,
    WHEEL_FRICTION,
)
from wherry.simulation.simulator import ODOMETRY_RATE
from wherry.simulation.static_geometry import OBSTACLE, WALL, StaticGeometry
from wherry.space.pose import Floats, Pose

TIME_STEP = 0.001  # s, Gazebo's default; contacts jitter at the simulator's 5 ms
GRAVITY = -9.81  # m/s²
PAINT_THICKNESS = 0.002  # m, of the warehouse's floor marking
FLOOR_MARGIN = 2.0  # m of floor around the building
STORAGE_SPACING, STORAGE_DISTANCE = 0.3, 1.0  # m between removed boxes, and m from the building to them
SERVICE_TIMEOUT = 3000  # ms that Gazebo waits for its own service
HOUSING_FLAG = 0x10  # bit of Gazebo's visibility flags that only the lidar's housing has
VISIBILITY_MASK = 0xFFFFFFFF & ~HOUSING_FLAG  # flags of what the lidar sees: everything but its housing


@dataclass(frozen=True, slots=True)
class GazeboGeneration:
    """Names that differ between generations of Gazebo Sim.

    Attributes:
        plugin_file: Library of a system; {} stands for a name such as diff-drive.
        plugin_class: Class of a system; {} stands for a name such as DiffDrive.
        messages: Package of the messages.
        frame_element: Element of a sensor that holds the name of its frame.
    """

    plugin_file: str
    plugin_class: str
    messages: str
    frame_element: str


FORTRESS = GazeboGeneration(
    "ignition-gazebo-{}-system", "ignition::gazebo::systems::{}", "ignition.msgs", "ignition_frame_id"
)
HARMONIC = GazeboGeneration("gz-sim-{}-system", "gz::sim::systems::{}", "gz.msgs", "gz_frame_id")
GENERATIONS = {"fortress": FORTRESS, "harmonic": HARMONIC}
"""Generations by name; Garden, Ionic and later use Harmonic's names."""


def world_name(plan: FloorPlan) -> str:
    """The plan's name with the characters that topics may have."""
    return re.sub(r"[^A-Za-z0-9]+", "_", plan.name).strip("_") or "world"


def sim_world(
    plan: FloorPlan, robot: Pose, boxes: Floats, lidar: LidarSpecification, generation: GazeboGeneration
) -> str:
    """A world for Gazebo Sim.

    Args:
        plan: The building.
        robot: base_footprint in the world frame.
        boxes: Centres of the boxes, [B, 2] m, world frame.
        lidar: The lidar's data sheet.
        generation: Generation of Gazebo Sim.
    """
    return _render("world.sdf.j2", plan, robot, boxes, lidar=lidar, generation=generation)


def classic_world(plan: FloorPlan, robot: Pose, boxes: Floats, lidar: LidarSpecification) -> str:
    """A world for classic Gazebo (7 to 11) with the plugins of ROS 1's gazebo_plugins.

    Args:
        plan: The building.
        robot: base_footprint in the world frame.
        boxes: Centres of the boxes, [B, 2] m, world frame.
        lidar: The lidar's data sheet.
    """
    return _render("classic.world.j2", plan, robot, boxes, lidar=lidar)


# ---- values of the templates


@dataclass(frozen=True, slots=True)
class _Cuboid:
    """A wall, an obstacle, or a painted cell.

    Attributes:
        name: Name, unique in the building.
        centre: Centre, [3] m, world frame.
        size: Lengths along x, y and z, [3] m.
        colour: Red, green, blue and alpha from 0 to 1.
        is_solid: Whether other bodies collide with it.
    """

    name: str
    centre: tuple[float, float, float]
    size: tuple[float, float, float]
    colour: Sequence[float]
    is_solid: bool


@dataclass(frozen=True, slots=True)
class _Box:
    """A box to be delivered.

    Attributes:
        number: Number of the box, from 0.
        name: Name of its model.
        position: Centre on the floor, [2] m, world frame.
        removal_request: Request to Gazebo's set_pose service that moves the box out of the building.
    """

    number: int
    name: str
    position: tuple[float, float]
    removal_request: str


@dataclass(frozen=True, slots=True)
class _World:
    """The floor, the building and its boxes.

    Attributes:
        name: Name of the world, as topics contain it.
        centre: Centre of the floor, [2] m, world frame.
        floor_size: Lengths of the floor along x and y, [2] m.
        building: Walls, obstacles and painted cells.
        boxes: Boxes to be delivered.
    """

    name: str
    centre: tuple[float, float]
    floor_size: tuple[float, float]
    building: Sequence[_Cuboid]
    boxes: Sequence[_Box]

    @classmethod
    def of(cls, plan: FloorPlan, boxes: Floats) -> _World:
        """Describe a plan with boxes at [B, 2] m."""
        x, y = plan.width * plan.cell_size / 2, plan.height * plan.cell_size / 2
        return cls(
            name=world_name(plan),
            centre=(x, y),
            floor_size=(2 * (x + FLOOR_MARGIN), 2 * (y + FLOOR_MARGIN)),
            building=[*_solid_cuboids(plan), *_painted_cells(plan)],
            boxes=[
                _Box(number, box_name(number), (float(x), float(y)), _removal_request(number))
                for number, (x, y) in enumerate(boxes)
            ],
        )


def _solid_cuboids(plan: FloorPlan) -> Iterator[_Cuboid]:
    solids = StaticGeometry.from_plan(plan)
    for name, kind in (("wall", WALL), ("obstacle", OBSTACLE)):
        for index, (left, bottom, right, top) in enumerate(solids.rectangles(kind).tolist()):
            centre = ((left + right) / 2, (bottom + top) / 2, WALL_HEIGHT / 2)
            size = (right - left, top - bottom, WALL_HEIGHT)
            yield _Cuboid(f"{name}_{index}", centre, size, COLOURS[name], is_solid=True)


def _painted_cells(plan: FloorPlan) -> Iterator[_Cuboid]:
    size = plan.cell_size
    for cell in sorted(plan.warehouse):
        centre = (*plan.centre(cell), 0.0)
        paint = (size, size, PAINT_THICKNESS)
        yield _Cuboid(f"warehouse_{cell.x}_{cell.y}", centre, paint, COLOURS["warehouse"], is_solid=False)


def _removal_request(box: int) -> str:
    """Request that places a box south of the building."""
    x, y, z = map(_number, (STORAGE_SPACING * (box + 0.5), -STORAGE_DISTANCE, BOX_HEIGHT / 2))
    return f"name: '{box_name(box)}', position: {{x: {x}, y: {y}, z: {z}}}, orientation: {{w: 1}}"


# ---- rendering


def _render(template: str, plan: FloorPlan, robot: Pose, boxes: Floats, **values: object) -> str:
    """Render a template as indented XML."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("wherry.gazebo"), autoescape=True, undefined=jinja2.StrictUndefined
    )
    environment.filters.update(num=_number, nums=_numbers)
    environment.globals.update(_constants())
    text = environment.get_template(template).render(
        world=_World.of(plan, boxes), robot=read_robot_model(), robot_pose=robot, **values
    )
    root = ET.fromstring(text.strip())  # noqa: S314 - rendered from this package's template
    ET.indent(root)
    return '<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _constants() -> dict[str, object]:
    return {
        "BODY": BODY,
        "BOX_COLOUR": BOX_COLOUR,
        "BOX_HEIGHT": BOX_HEIGHT,
        "BOX_MASS": BOX_MASS,
        "BOX_RADIUS": BOX_RADIUS,
        "COLOURS": COLOURS,
        "FLOOR_FRICTION": FLOOR_FRICTION,
        "GRAVITY": GRAVITY,
        "HOUSING_FLAG": HOUSING_FLAG,
        "MAX_MOTOR_TORQUE": MAX_MOTOR_TORQUE,
        "ODOMETRY_RATE": ODOMETRY_RATE,
        "OPENING_SECONDS": OPENING_SECONDS,
        "ROBOT": ROBOT,
        "SERVICE_TIMEOUT": SERVICE_TIMEOUT,
        "TIME_STEP": TIME_STEP,
        "TRACK_WIDTH": TRACK_WIDTH,
        "VISIBILITY_MASK": VISIBILITY_MASK,
        "WHEEL_FRICTION": WHEEL_FRICTION,
        "WHEEL_RADIUS": WHEEL_RADIUS,
        "pi": math.pi,
        "topics": latch_topics,
    }


def _number(value: float) -> str:
    """A number as SDF writes it."""
    return f"{value:.12g}"


def _numbers(values: Sequence[float], *more: float) -> str:
    """Numbers as SDF writes them, separated by spaces."""
    return " ".join(map(_number, (*values, *more)))
