"""The robot's description as robot_state_publisher and RViz take it: the simulator's own URDF, hung up by base_link.

Driver software tells where base_link is in odom (REP 105), and a frame has one parent. So here base_footprint hangs
below base_link, where physics has the robot stand on base_footprint.
"""

from __future__ import annotations

from xml.etree import ElementTree

BASE_JOINT = "base_joint"


def robot_description(urdf: str) -> str:
    """The simulator's URDF with base_link as its root.

    Raises:
        ValueError: base_footprint and base_link are not joined as this expects.
    """
    robot = ElementTree.fromstring(urdf)  # noqa: S314 - it is our own
    joint = robot.find(f"joint[@name='{BASE_JOINT}']")
    if joint is None:
        raise ValueError(f"the robot has no {BASE_JOINT}")
    parent, child, origin = (joint.find(tag) for tag in ("parent", "child", "origin"))
    if parent is None or child is None or origin is None or origin.get("rpy") != "0 0 0":
        raise ValueError(f"{BASE_JOINT} is more than a shift between two links")
    parent.attrib["link"], child.attrib["link"] = child.attrib["link"], parent.attrib["link"]
    origin.attrib["xyz"] = " ".join(f"{0.0 - float(value):g}" for value in origin.attrib["xyz"].split())
    # No encoding is declared: it would be the locale's, and parsers of text refuse any.
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(robot, encoding="unicode") + "\n"
