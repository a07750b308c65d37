"""A robot's shape and limits from a YAML file; the lidar's place may be left to the transforms."""

from __future__ import annotations

from dataclasses import dataclass, fields
from importlib import resources
from pathlib import Path
from typing import Any

from wherry.errors import InputError
from wherry.robot import Body
from wherry.space.pose import Pose
from wherry.yaml_files import check_number, load_mapping, parse_mapping

LARGEST = 100.0  # of any number in it
LIDAR = ("x", "y", "theta")


@dataclass(frozen=True, slots=True)
class BodyParameters:
    """As `Body`, but that the lidar's pose may not be known yet.

    Attributes:
        radius: m.
        box_radius: m.
        max_linear: m/s.
        max_angular: rad/s.
        max_linear_acceleration: m/s².
        max_angular_acceleration: rad/s².
        lidar: In base_link's frame; None for what the transforms say.
    """

    radius: float
    box_radius: float
    max_linear: float
    max_angular: float
    max_linear_acceleration: float
    max_angular_acceleration: float
    lidar: Pose | None = None

    def body(self, lidar: Pose) -> Body:
        """The body, with the lidar where the transforms say, unless it is given here."""
        return Body(
            radius=self.radius,
            lidar=self.lidar or lidar,
            box_radius=self.box_radius,
            max_linear=self.max_linear,
            max_angular=self.max_angular,
            max_linear_acceleration=self.max_linear_acceleration,
            max_angular_acceleration=self.max_angular_acceleration,
        )


def load_body(path: str | Path | None = None) -> BodyParameters:
    """Read a robot's shape and limits.

    Args:
        path: A YAML file with the fields of `BodyParameters`; None for wherry's own robot.

    Raises:
        InputError: The file cannot be read, or a value is missing, unknown, or impossible.
    """
    source = path or "body.yaml"
    document = parse_mapping(source, own_body()) if path is None else load_mapping(path)
    numbers = [entry.name for entry in fields(BodyParameters) if entry.name != "lidar"]
    for key in document:
        if key not in (*numbers, "lidar"):
            raise InputError(source, str(key), f"is none of {', '.join(numbers)}, lidar")
    values = {key: check_number(source, key, document.get(key), most=LARGEST) for key in numbers}
    if values["box_radius"] >= values["radius"]:
        raise InputError(source, "box_radius", "is not smaller than radius, which contains the load")
    return BodyParameters(**values, lidar=_lidar(source, document.get("lidar")))


def own_body() -> str:
    """The file of wherry's own robot, to begin another one with."""
    return (resources.files("wherry.ros") / "body.yaml").read_text(encoding="utf-8")


def _lidar(source: str | Path, value: Any) -> Pose | None:
    if value is None:
        return None
    if not isinstance(value, dict) or set(value) != set(LIDAR):
        raise InputError(source, "lidar", f"is not a mapping of {', '.join(LIDAR)}")
    return Pose(*(check_number(source, f"lidar.{key}", value[key], most=LARGEST, positive=False) for key in LIDAR))
