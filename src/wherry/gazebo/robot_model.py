"""The robot's URDF as links, shapes and joints, with the coefficients of friction that Gazebo needs in addition."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from wherry.simulation.model import WHEEL_FRICTION, robot_urdf

ROOT_LINK = "base_footprint"  # has no mass
TREAD_WIDTH = 0.002  # m, of the disc that replaces a wheel: a wide one scrubs when the robot turns on the spot
DEFAULT_FRICTION = 1.0  # coefficient where the URDF sets none, in MuJoCo and in Gazebo
FRICTION = {"left_wheel": WHEEL_FRICTION, "right_wheel": WHEEL_FRICTION, "caster": 0.0}  # coefficients by link


@dataclass(frozen=True, slots=True)
class Shape:
    """A collision or visual of a link.

    Attributes:
        name: Unique within the link.
        pose: Pose in the link, as SDF writes it (x y z m, roll pitch yaw rad); empty for the link's own.
        geometry: "box", "cylinder" or "sphere".
        measures: Lengths by their names in URDF and SDF, m, as the URDF writes them.
        colour: Red, green, blue and alpha from 0 to 1; empty for a collision.
    """

    name: str
    pose: str
    geometry: str
    measures: Mapping[str, str]
    colour: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class Link:
    """A rigid body of the robot.

    Attributes:
        name: Name of the link and of its frame.
        position: Origin of the link in base_footprint, [3] m.
        mass: Mass, kg, as the URDF writes it.
        inertial_pose: Pose of the centre of mass in the link, as SDF writes it; empty for the link's own.
        inertia: Moments of inertia by name, kg m², as the URDF writes them.
        friction: Coefficient of friction of the link's surface.
        collisions: Shapes for collision detection.
        visuals: Shapes for rendering.
    """

    name: str
    position: tuple[float, float, float]
    mass: str
    inertial_pose: str
    inertia: Mapping[str, str]
    friction: float
    collisions: tuple[Shape, ...]
    visuals: tuple[Shape, ...]


@dataclass(frozen=True, slots=True)
class Joint:
    """A connection of two links.

    Attributes:
        name: Name of the joint.
        parent: Name of the parent link.
        child: Name of the child link.
        axis: Axis of rotation in the child's frame, as the URDF writes it; empty for a fixed joint.
    """

    name: str
    parent: str
    child: str
    axis: str


@dataclass(frozen=True, slots=True)
class RobotModel:
    """The robot without its massless root link.

    Attributes:
        links: All links; base_link is the first.
        joints: Joints between these links.
    """

    links: tuple[Link, ...]
    joints: tuple[Joint, ...]

    @property
    def base_height(self) -> float:
        """Height of base_link above the floor, m."""
        return self.links[0].position[2]


def read_robot_model() -> RobotModel:
    """Read the simulator's URDF."""
    urdf = ET.fromstring(robot_urdf())  # noqa: S314 - part of this package
    colours = {
        material.get("name", ""): _child(material, "color").get("rgba", "")
        for material in urdf.iter("material")
        if len(material)
    }
    positions = _positions(urdf)
    links = tuple(
        _link(element, positions, colours) for element in urdf.findall("link") if element.get("name") != ROOT_LINK
    )
    joints = tuple(joint for joint in map(_joint, urdf.findall("joint")) if joint.parent != ROOT_LINK)
    return RobotModel(links, joints)


def _positions(urdf: ET.Element) -> dict[str, tuple[float, float, float]]:
    """Origin of every link in base_footprint, m.

    Raises:
        ValueError: A joint rotates its child; none of this robot's does.
    """
    positions = {ROOT_LINK: (0.0, 0.0, 0.0)}
    for joint in urdf.findall("joint"):  # parents precede their children
        origin = _child(joint, "origin")
        if any(_floats(origin.get("rpy", "0 0 0"))):
            raise ValueError(f"{joint.get('name')} rotates its child")
        x, y, z = positions[_child(joint, "parent").get("link", "")]
        dx, dy, dz = _floats(origin.get("xyz", "0 0 0"))
        positions[_child(joint, "child").get("link", "")] = (x + dx, y + dy, z + dz)
    return positions


def _link(element: ET.Element, positions: Mapping[str, tuple[float, float, float]], colours: Mapping[str, str]) -> Link:
    name = element.get("name", "")
    is_wheel = name.endswith("_wheel")
    inertial = _child(element, "inertial")
    return Link(
        name=name,
        position=positions[name],
        mass=_child(inertial, "mass").get("value", ""),
        inertial_pose=_pose(inertial),
        inertia=dict(_child(inertial, "inertia").items()),
        friction=FRICTION.get(name, DEFAULT_FRICTION),
        collisions=tuple(_collisions(element, is_wheel=is_wheel)),
        visuals=tuple(_visuals(element, colours)),
    )


def _collisions(link: ET.Element, *, is_wheel: bool) -> Iterator[Shape]:
    for element in link.findall("collision"):
        geometry = _child(element, "geometry")[0]
        measures = dict(geometry.items())
        if is_wheel:
            measures["length"] = f"{TREAD_WIDTH:.12g}"
        yield Shape(element.get("name", ""), _pose(element), geometry.tag, measures)


def _visuals(link: ET.Element, colours: Mapping[str, str]) -> Iterator[Shape]:
    for element in link.findall("visual"):
        geometry = _child(element, "geometry")[0]
        colour = _floats(colours[_child(element, "material").get("name", "")])
        yield Shape(element.get("name", ""), _pose(element), geometry.tag, dict(geometry.items()), tuple(colour))


def _joint(element: ET.Element) -> Joint:
    is_continuous = element.get("type") == "continuous"
    return Joint(
        name=element.get("name", ""),
        parent=_child(element, "parent").get("link", ""),
        child=_child(element, "child").get("link", ""),
        axis=_child(element, "axis").get("xyz", "") if is_continuous else "",
    )


def _pose(element: ET.Element) -> str:
    """The origin of an element as SDF writes it."""
    origin = element.find("origin")
    return "" if origin is None else f"{origin.get('xyz', '0 0 0')} {origin.get('rpy', '0 0 0')}"


def _child(parent: ET.Element, tag: str) -> ET.Element:
    """A child element that this package's URDF has."""
    child = parent.find(tag)
    if child is None:
        raise ValueError(f"{parent.tag} {parent.get('name', '')} has no {tag}")
    return child


def _floats(text: str) -> list[float]:
    return [float(word) for word in text.split()]
