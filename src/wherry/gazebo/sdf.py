"""A world and its robot as SDF: for Gazebo Sim from Fortress on, and for the classic Gazebo of ROS 1.

Sizes, poses, masses, inertias, limits and sensors are the simulator's own figures; nothing is measured or set here but
what MuJoCo and Gazebo do differently:

- Between two things that touch, Gazebo's engines take the smaller of their coefficients of friction, MuJoCo the larger.
  So the floor has the wheels' coefficient and a box its own, and every pair that matters has the simulator's.
- A wheel's edge touches the floor along a line and scrubs when the robot turns on the spot. The simulator's wheels are
  ellipsoids, which Gazebo's engines do not have; here a thin disc of the wheel's radius touches.
- A detachable joint begins attached. Publishers that the world brings along open the latch during the first 2 s.
- There is no conveyor. What the warehouse takes in is put down outside the building, by a service that a message on
  `take_in_topic` calls.
- A lidar that sees pictures would see its own housing from inside; the housing is invisible to it.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wherry.floorplan.plan import FloorPlan
from wherry.gazebo.latch import (
    OPEN,
    OPENING,
    ROBOT,
    box_name,
    close_topic,
    state_topic,
    take_in_topic,
)
from wherry.simulation.drive import TRACK, WHEEL_RADIUS
from wherry.simulation.lidar import LidarSpecification
from wherry.simulation.model import (
    BODY,
    BOX_COLOUR,
    BOX_HEIGHT,
    BOX_MASS,
    BOX_RADIUS,
    COLOURS,
    FLOOR_FRICTION,
    MAX_MOTOR_TORQUE,
    WALL_HEIGHT,
    WHEEL_FRICTION,
    robot_urdf,
)
from wherry.simulation.simulator import ODOMETRY_RATE
from wherry.simulation.static_geometry import OBSTACLE, WALL, StaticGeometry
from wherry.space.pose import Floats, Pose

ROOT_LINK = "base_footprint"  # massless, which no SDF link can be: a frame here
TREAD = 0.002  # m, how wide the disc is that touches the floor for a wheel
STEP = 0.001  # s, Gazebo's usual time step; at the simulator's 5 ms its contacts jitter
GRAVITY = -9.81  # m/s²
SHELL_GRIP = 1.0  # coefficient of friction of whatever nobody has set one for, in MuJoCo and here
PAINT = 0.002  # m, how thick the warehouse's paint is
LIGHT = ((0.3, 0.5, -1.0), 0.6)  # direction and brightness
HOUSING_FLAG = 0x10  # a bit of Gazebo's visibility flags that nothing else uses
EVERYTHING = 0xFFFFFFFF
SURROUNDINGS = 2.0  # m of floor around the building

SIM_SDF, CLASSIC_SDF = "1.9", "1.6"  # versions that Fortress, and every classic Gazebo since Kinetic, reads
WORLD_SYSTEMS = (("physics", "Physics"), ("user-commands", "UserCommands"), ("scene-broadcaster", "SceneBroadcaster"))
STORE_SPACING, STORE_DISTANCE = 0.3, 1.0  # m, between boxes that were taken in, and from the building to them
PATIENCE = 3000  # ms that Gazebo waits for its own service


@dataclass(frozen=True, slots=True)
class Gazebo:
    """What a generation of Gazebo calls things.

    Attributes:
        plugin_file: With {} for the plugin's name, such as diff-drive.
        plugin_class: With {} for the class, such as DiffDrive.
        messages: Before the names of messages.
        frame_element: In a sensor, the element that holds its frame's name.
    """

    plugin_file: str
    plugin_class: str
    messages: str
    frame_element: str


FORTRESS = Gazebo("ignition-gazebo-{}-system", "ignition::gazebo::systems::{}", "ignition.msgs", "ignition_frame_id")
HARMONIC = Gazebo("gz-sim-{}-system", "gz::sim::systems::{}", "gz.msgs", "gz_frame_id")
GENERATIONS = {"fortress": FORTRESS, "harmonic": HARMONIC}
"""By name; Garden, Ionic and later call things as Harmonic does."""


def world_name(plan: FloorPlan) -> str:
    """The plan's name as topics can have it."""
    return re.sub(r"[^A-Za-z0-9]+", "_", plan.name).strip("_") or "world"


def sim_world(plan: FloorPlan, robot: Pose, boxes: Floats, lidar: LidarSpecification, gazebo: Gazebo) -> str:
    """A world for Gazebo Sim.

    Args:
        plan: The building.
        robot: base_footprint in the world frame.
        boxes: [B, 2] m, world frame, the boxes' middles.
        lidar: The lidar's data sheet.
        gazebo: For which generation.
    """
    sdf, world = _world(plan, SIM_SDF, "ignored")
    for name, kind in WORLD_SYSTEMS:
        _plugin(world, gazebo, name, kind)
    _plugin(world, gazebo, "sensors", "Sensors", render_engine="ogre2")
    if len(boxes):
        _open_latch_at_first(world, gazebo)
    _add_building(world, plan)
    for index, (x, y) in enumerate(boxes):
        _tell_pose(_add_box(world, index, float(x), float(y)), gazebo)
        _add_conveyor(world, index, gazebo)
    model = _add_robot(world, robot, {"canonical_link": "base_link"})
    _tell_pose(model, gazebo)
    _text(_child(model, "frame", name=ROOT_LINK, attached_to="base_link"), pose=_pose([0, 0, -_heights()["base_link"]]))
    laser = model.find("link[@name='laser']")
    assert laser is not None  # noqa: S101 - a test of the URDF says so
    _see_through(laser)
    _add_lidar(laser, lidar, gazebo)
    _add_sim_plugins(model, len(boxes), gazebo)
    return _written(sdf)


def classic_world(plan: FloorPlan, robot: Pose, boxes: Floats, lidar: LidarSpecification) -> str:
    """A world for classic Gazebo (7 to 11) with the plugins of ROS 1's gazebo_plugins.

    Args:
        plan: The building.
        robot: base_footprint in the world frame.
        boxes: [B, 2] m, world frame, the boxes' middles.
        lidar: The lidar's data sheet.
    """
    sdf, world = _world(plan, CLASSIC_SDF, "ode")
    _add_building(world, plan)
    for index, (x, y) in enumerate(boxes):
        _add_box(world, index, float(x), float(y))
    model = _add_robot(world, robot, {})
    laser = model.find("link[@name='laser']")
    assert laser is not None  # noqa: S101 - a test of the URDF says so
    _add_classic_lidar(laser, lidar)
    _add_classic_drive(model)
    return _written(sdf)


# ---- the building


def _world(plan: FloorPlan, version: str, physics: str) -> tuple[ET.Element, ET.Element]:
    """An empty world with physics, light and a floor."""
    sdf = ET.Element("sdf", version=version)
    world = _child(sdf, "world", name=world_name(plan))
    _text(world, gravity=_numbers([0, 0, GRAVITY]))
    _text(
        _child(world, "physics", name="physics", type=physics),
        max_step_size=STEP,
        real_time_factor=1,
        real_time_update_rate=round(1 / STEP),
    )
    _text(_child(world, "scene"), ambient="0.5 0.5 0.5 1", background="0.8 0.85 0.9 1", shadows="false")
    direction, brightness = LIGHT
    sun = _child(world, "light", name="sun", type="directional")
    shade = _numbers([brightness] * 3 + [1])
    _text(sun, cast_shadows="false", pose=_pose([0, 0, 10]), diffuse=shade, specular="0 0 0 1")
    _text(sun, direction=_numbers(direction))
    floor = _static(world, "floor")
    middle = (plan.width * plan.cell_size / 2, plan.height * plan.cell_size / 2)
    _text(floor, pose=_pose([*middle, 0]))
    link = _child(floor, "link", name="floor")
    size = _numbers([2 * (side + SURROUNDINGS) for side in middle])
    for kind, name in (("collision", "floor"), ("visual", "floor_visual")):
        plane = _child(_child(_child(link, kind, name=name), "geometry"), "plane")
        _text(plane, normal="0 0 1", size=size)
    _grip(_of(link, "collision"), WHEEL_FRICTION)
    _paint(_of(link, "visual"), COLOURS["floor"])
    return sdf, world


def _add_building(world: ET.Element, plan: FloorPlan) -> None:
    """Walls, obstacles, and the warehouse's paint."""
    solids = StaticGeometry.from_plan(plan)
    link = _child(_static(world, "building"), "link", name="building")
    for name, kind in (("wall", WALL), ("obstacle", OBSTACLE)):
        for index, (left, bottom, right, top) in enumerate(solids.rectangles(kind)):
            place = [(left + right) / 2, (bottom + top) / 2, WALL_HEIGHT / 2]
            size = _numbers([right - left, top - bottom, WALL_HEIGHT])
            _shape(link, "collision", f"{name}_{index}", place, "box", size=size)
            _shape(link, "visual", f"{name}_{index}_visual", place, "box", COLOURS[name], size=size)
    for cell in sorted(plan.warehouse):
        place = [(cell.x + 0.5) * plan.cell_size, (cell.y + 0.5) * plan.cell_size, 0]
        size = _numbers([plan.cell_size, plan.cell_size, PAINT])
        _shape(link, "visual", f"warehouse_{cell.x}_{cell.y}_visual", place, "box", COLOURS["warehouse"], size=size)


def _add_box(world: ET.Element, index: int, x: float, y: float) -> ET.Element:
    """A box to be delivered."""
    model = _child(world, "model", name=box_name(index))
    _text(model, pose=_pose([x, y, BOX_HEIGHT / 2]))
    link = _child(model, "link", name="box")
    across = BOX_MASS * (3 * BOX_RADIUS**2 + BOX_HEIGHT**2) / 12  # a solid cylinder's
    inertial = _child(link, "inertial")
    _text(inertial, mass=BOX_MASS)
    along = BOX_MASS * BOX_RADIUS**2 / 2
    _text(_child(inertial, "inertia"), ixx=across, iyy=across, izz=along, ixy=0, ixz=0, iyz=0)
    for kind, name in (("collision", "box"), ("visual", "box_visual")):
        _shape(link, kind, name, [0, 0, 0], "cylinder", radius=BOX_RADIUS, length=BOX_HEIGHT)
    _grip(_of(link, "collision"), FLOOR_FRICTION)
    _paint(_of(link, "visual"), BOX_COLOUR)
    return model


# ---- the robot


def _add_robot(world: ET.Element, pose: Pose, attributes: dict[str, str]) -> ET.Element:
    """The URDF's links and joints."""
    urdf = ET.fromstring(robot_urdf())  # noqa: S314 - our own file
    colours = {material.get("name"): _of(material, "color").get("rgba", "") for material in urdf.findall("material")}
    places = _places(urdf)
    model = _child(world, "model", name=ROBOT, **attributes)
    # A box that was held belongs to the robot's tree of bodies and touches the robot only if the tree may touch itself.
    _text(model, pose=_pose([pose.x, pose.y, 0], pose.theta), self_collide="true")
    for source in urdf.findall("link"):
        name = source.get("name", "")
        if name == ROOT_LINK:
            continue
        link = _child(model, "link", name=name)
        _text(link, pose=_pose(places[name]))
        _copy_inertial(_of(source, "inertial"), link)
        for kind in ("collision", "visual"):
            for shape in source.findall(kind):
                _copy_shape(shape, link, kind, colours)
    for source in urdf.findall("joint"):
        if _of(source, "parent").get("link") != ROOT_LINK:
            _copy_joint(source, model)
    return model


def _places(urdf: ET.Element) -> dict[str, list[float]]:
    """[3] m: every link's origin in base_footprint.

    Raises:
        ValueError: A joint of the URDF turns its child; no joint of ours does.
    """
    places = {ROOT_LINK: [0.0, 0.0, 0.0]}
    for joint in urdf.findall("joint"):  # parents come before their children
        origin = _of(joint, "origin")
        if any(_floats(origin.get("rpy", "0 0 0"))):
            raise ValueError(f"{joint.get('name')} turns its child")
        parent = places[_of(joint, "parent").get("link", "")]
        offset = _floats(origin.get("xyz", "0 0 0"))
        places[_of(joint, "child").get("link", "")] = [a + b for a, b in zip(parent, offset, strict=True)]
    return places


def _heights() -> dict[str, float]:
    """m: every link's height over the floor."""
    return {name: place[2] for name, place in _places(ET.fromstring(robot_urdf())).items()}  # noqa: S314


def _copy_inertial(source: ET.Element, link: ET.Element) -> None:
    inertial = _child(link, "inertial")
    origin = source.find("origin")
    _text(inertial, mass=_of(source, "mass").get("value", ""))
    if origin is not None:
        _text(inertial, pose=_pose_of(origin))
    inertia = _of(source, "inertia")
    _text(_child(inertial, "inertia"), **dict(inertia.items()))


def _copy_shape(source: ET.Element, link: ET.Element, kind: str, colours: dict[str | None, str]) -> None:
    """A collision or visual of the URDF."""
    name, body = source.get("name", ""), link.get("name", "")
    element = _child(link, kind, name=name)
    origin = source.find("origin")
    if origin is not None:
        _text(element, pose=_pose_of(origin))
    geometry = _of(source, "geometry")[0]
    sizes: dict[str, object] = dict(geometry.items())
    is_wheel = body.endswith("_wheel")
    if is_wheel and kind == "collision":
        sizes["length"] = TREAD
    _text(_child(_child(element, "geometry"), geometry.tag), **sizes)
    if kind == "visual":
        _paint(element, tuple(_floats(colours[_of(source, "material").get("name")])))
    else:
        _grip(element, WHEEL_FRICTION if is_wheel else 0.0 if body == "caster" else SHELL_GRIP)


def _copy_joint(source: ET.Element, model: ET.Element) -> None:
    turns = source.get("type") == "continuous"
    joint = _child(model, "joint", name=source.get("name", ""), type="revolute" if turns else "fixed")
    _text(joint, parent=_of(source, "parent").get("link", ""), child=_of(source, "child").get("link", ""))
    if turns:
        axis = _child(joint, "axis")
        _text(axis, xyz=_of(source, "axis").get("xyz", ""))
        _text(_child(axis, "limit"), lower="-1e16", upper="1e16", effort=MAX_MOTOR_TORQUE)
        _text(_child(axis, "dynamics"), damping=0, friction=0)


def _see_through(laser: ET.Element) -> None:
    """Hide the lidar's housing from the lidar."""
    for visual in laser.findall("visual"):
        _text(visual, visibility_flags=HOUSING_FLAG)


def _add_lidar(laser: ET.Element, lidar: LidarSpecification, gazebo: Gazebo) -> None:
    sensor = _child(laser, "sensor", name="lidar", type="gpu_lidar")
    _text(sensor, topic="/scan", update_rate=lidar.rate, always_on="true", visualize="false")
    _text(sensor, **{gazebo.frame_element: "laser"})
    rays = _child(sensor, "lidar")
    _describe_lidar(rays, lidar)
    _text(rays, visibility_mask=EVERYTHING & ~HOUSING_FLAG)


def _add_classic_lidar(laser: ET.Element, lidar: LidarSpecification) -> None:
    sensor = _child(laser, "sensor", name="lidar", type="ray")
    _text(sensor, update_rate=lidar.rate, always_on="true", visualize="false")
    _describe_lidar(_child(sensor, "ray"), lidar)
    plugin = _child(sensor, "plugin", name="laser", filename="libgazebo_ros_laser.so")
    _text(plugin, topicName="/scan", frameName="laser")


def _describe_lidar(rays: ET.Element, lidar: LidarSpecification) -> None:
    """Beams, range and noise; both ends of the scan are beams, so the last one stops short of the first."""
    horizontal = _child(_child(rays, "scan"), "horizontal")
    last = -math.pi + math.tau * (lidar.beams - 1) / lidar.beams
    _text(horizontal, samples=lidar.beams, resolution=1, min_angle=-math.pi, max_angle=last)
    _text(_child(rays, "range"), min=lidar.range_min, max=lidar.range_max)
    _text(_child(rays, "noise"), type="gaussian", mean=0, stddev=lidar.noise)


# ---- plugins


def _add_sim_plugins(model: ET.Element, boxes: int, gazebo: Gazebo) -> None:
    """Drive, joint states, and for every box a joint that the latch can close."""
    limits: dict[str, object] = {}
    for name, velocity, acceleration in (
        ("linear", BODY.max_linear, BODY.max_linear_acceleration),
        ("angular", BODY.max_angular, BODY.max_angular_acceleration),
    ):
        limits |= {f"max_{name}_velocity": velocity, f"min_{name}_velocity": -velocity}
        limits |= {f"max_{name}_acceleration": acceleration, f"min_{name}_acceleration": -acceleration}
    _plugin(
        model,
        gazebo,
        "diff-drive",
        "DiffDrive",
        left_joint="left_wheel_joint",
        right_joint="right_wheel_joint",
        wheel_separation=TRACK,
        wheel_radius=WHEEL_RADIUS,
        topic="/cmd_vel",
        odom_topic="/odom",
        tf_topic="/tf",
        frame_id="odom",
        child_frame_id="base_link",
        odom_publish_frequency=ODOMETRY_RATE,
        **limits,
    )
    states = _plugin(model, gazebo, "joint-state-publisher", "JointStatePublisher", topic="/joint_states")
    for side in ("left", "right"):
        _text(states, joint_name=f"{side}_wheel_joint")
    for box in range(boxes):
        _plugin(
            model,
            gazebo,
            "detachable-joint",
            "DetachableJoint",
            parent_link="base_link",
            child_model=box_name(box),
            child_link="box",
            topic=OPEN.name,  # what releases before 6.15 call the next one; they know none of the two after it
            detach_topic=OPEN.name,
            attach_topic=close_topic(box).name,
            output_topic=state_topic(box).name,
            initial_attach="false",  # which releases so far do not know yet: see `_open_latch_at_first`
        )


def _open_latch_at_first(world: ET.Element, gazebo: Gazebo) -> None:
    """Open the latch while the world's clock says second 0 or 1, at once and surely; joints cannot begin detached."""
    for second in OPENING:
        plugin = _plugin(world, gazebo, "triggered-publisher", "TriggeredPublisher")
        clock = _child(plugin, "input", type=f"{gazebo.messages}.Clock", topic=f"/world/{world.get('name')}/clock")
        _child(clock, "match", field="sim.sec").text = str(second)
        _child(plugin, "output", type=f"{gazebo.messages}.Empty", topic=OPEN.name)


def _add_conveyor(world: ET.Element, box: int, gazebo: Gazebo) -> None:
    """Put a box down outside the building, south of it, when a message asks to (Gazebo 6.13 and later)."""
    place = f"x: {STORE_SPACING * (box + 0.5):.12g}, y: {-STORE_DISTANCE:.12g}, z: {BOX_HEIGHT / 2:.12g}"
    plugin = _plugin(world, gazebo, "triggered-publisher", "TriggeredPublisher")
    _child(plugin, "input", type=f"{gazebo.messages}.Empty", topic=take_in_topic(box).name)
    _child(
        plugin,
        "service",
        name=f"/world/{world.get('name')}/set_pose",
        reqType=f"{gazebo.messages}.Pose",
        repType=f"{gazebo.messages}.Boolean",
        timeout=str(PATIENCE),
        reqMsg=f"name: '{box_name(box)}', position: {{{place}}}, orientation: {{w: 1}}",
    )


def _tell_pose(model: ET.Element, gazebo: Gazebo) -> None:
    """Have a model tell where it is in the world, and nothing of its links."""
    _plugin(
        model,
        gazebo,
        "pose-publisher",
        "PosePublisher",
        publish_link_pose="false",
        publish_model_pose="true",
        publish_nested_model_pose="true",  # older releases know only this one
        use_pose_vector_msg="false",
        update_frequency=ODOMETRY_RATE,
    )


def _add_classic_drive(model: ET.Element) -> None:
    plugin = _child(model, "plugin", name="drive", filename="libgazebo_ros_diff_drive.so")
    _text(
        plugin,
        legacyMode="false",
        rosDebugLevel="na",
        updateRate=ODOMETRY_RATE,
        leftJoint="left_wheel_joint",
        rightJoint="right_wheel_joint",
        wheelSeparation=TRACK,
        wheelDiameter=2 * WHEEL_RADIUS,
        wheelTorque=MAX_MOTOR_TORQUE,
        wheelAcceleration=BODY.max_linear_acceleration,
        commandTopic="/cmd_vel",
        odometryTopic="/odom",
        odometryFrame="odom",
        odometrySource="encoder",
        robotBaseFrame="base_link",
        publishTf="true",
        publishOdomTF="true",
        publishWheelTF="false",
        publishWheelJointState="true",
    )


def _plugin(parent: ET.Element, gazebo: Gazebo, file: str, kind: str, **parameters: object) -> ET.Element:
    plugin = _child(parent, "plugin", filename=gazebo.plugin_file.format(file), name=gazebo.plugin_class.format(kind))
    _text(plugin, **parameters)
    return plugin


# ---- XML


def _static(world: ET.Element, name: str) -> ET.Element:
    """A model that never moves."""
    model = _child(world, "model", name=name)
    _text(model, static="true")
    return model


def _shape(
    link: ET.Element,
    kind: str,
    name: str,
    place: list[float],
    geometry: str,
    colour: tuple[float, ...] | None = None,
    **sizes: object,
) -> None:
    """A collision or visual at a place."""
    element = _child(link, kind, name=name)
    _text(element, pose=_pose(place))
    _text(_child(_child(element, "geometry"), geometry), **sizes)
    if colour is not None:
        _paint(element, colour)


def _grip(collision: ET.Element, friction: float) -> None:
    """Set a coefficient of friction, alike in all directions."""
    engine = _child(_child(_child(collision, "surface"), "friction"), "ode")
    _text(engine, mu=friction, mu2=friction)


def _paint(visual: ET.Element, colour: tuple[float, ...]) -> None:
    _text(_child(visual, "material"), ambient=_numbers(colour), diffuse=_numbers(colour))


def _child(parent: ET.Element, tag: str, /, **attributes: str) -> ET.Element:
    return ET.SubElement(parent, tag, attributes)


def _text(parent: ET.Element, /, **values: object) -> None:
    """Add elements with a value each."""
    for tag, value in values.items():
        is_number = isinstance(value, float | int | np.floating)
        ET.SubElement(parent, tag).text = f"{value:.12g}" if is_number else str(value)


def _of(parent: ET.Element, tag: str) -> ET.Element:
    """A child that must be there; the URDF is our own."""
    child = parent.find(tag)
    if child is None:
        raise ValueError(f"{parent.tag} {parent.get('name', '')} has no {tag}")
    return child


def _pose_of(origin: ET.Element) -> str:
    """A URDF origin as an SDF pose."""
    return f"{origin.get('xyz', '0 0 0')} {origin.get('rpy', '0 0 0')}"


def _numbers(values: Sequence[float]) -> str:
    """Numbers as SDF writes them."""
    return " ".join(f"{value:.12g}" for value in values)


def _pose(place: Sequence[float], yaw: float = 0.0) -> str:
    """A pose as SDF writes it: a place, and a rotation about the vertical axis."""
    return _numbers([*place, 0.0, 0.0, yaw])


def _floats(text: str) -> list[float]:
    return [float(word) for word in text.split()]


def _written(root: ET.Element) -> str:
    """XML that people can read."""
    ET.indent(root)
    return '<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n"
