"""A robot's shape and limits from a YAML file; without a lidar pose in it, the transforms give that pose."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Annotated

from pydantic import Field, ValidationInfo, field_validator

from wherry.documents import Document, Number, load_yaml, parse_yaml, validate
from wherry.robot import Body
from wherry.space.pose import Pose

MAX_VALUE = 100.0  # in the unit of each number in the file

Positive = Annotated[Number, Field(gt=0.0, le=MAX_VALUE)]
Coordinate = Annotated[Number, Field(ge=-MAX_VALUE, le=MAX_VALUE)]


@dataclass(frozen=True, slots=True)
class BodyParameters:
    """A `Body` whose lidar pose may be unknown.

    Attributes:
        radius: Radius of the circle around base_link that contains the robot and its load, m.
        box_radius: Radius of the boxes that fit the fork, m.
        max_linear: Maximum speed, m/s.
        max_angular: Maximum turn rate, rad/s.
        max_linear_acceleration: Maximum acceleration, m/s².
        max_angular_acceleration: Maximum angular acceleration, rad/s².
        lidar: Pose of the lidar in base_link; None to take it from the transforms.
    """

    radius: float
    box_radius: float
    max_linear: float
    max_angular: float
    max_linear_acceleration: float
    max_angular_acceleration: float
    lidar: Pose | None = None

    def body(self, lidar: Pose) -> Body:
        """The body, with the lidar at the given pose unless the file gives one."""
        return Body(
            radius=self.radius,
            lidar=self.lidar or lidar,
            box_radius=self.box_radius,
            max_linear=self.max_linear,
            max_angular=self.max_angular,
            max_linear_acceleration=self.max_linear_acceleration,
            max_angular_acceleration=self.max_angular_acceleration,
        )


class _LidarPose(Document):
    x: Coordinate  # m
    y: Coordinate  # m
    theta: Coordinate  # rad


class _BodyFile(Document):
    """The fields of `BodyParameters`."""

    radius: Positive
    box_radius: Positive
    max_linear: Positive
    max_angular: Positive
    max_linear_acceleration: Positive
    max_angular_acceleration: Positive
    lidar: _LidarPose | None = None

    @field_validator("box_radius")
    @classmethod
    def _fits_into_radius(cls, box_radius: float, info: ValidationInfo) -> float:
        if box_radius >= info.data.get("radius", MAX_VALUE):
            raise ValueError("is not smaller than radius, which contains the load")
        return box_radius


def load_body(path: str | Path | None = None) -> BodyParameters:
    """Read a robot's shape and limits.

    Args:
        path: A YAML file with the fields of `BodyParameters`; None for wherry's own robot.

    Raises:
        InputError: The file cannot be read, or a value is missing, unknown or out of bounds.
    """
    if path is None:
        file = validate(_BodyFile, parse_yaml(default_body_text(), "body.yaml"), "body.yaml")
    else:
        file = load_yaml(path, _BodyFile)
    lidar = None if file.lidar is None else Pose(file.lidar.x, file.lidar.y, file.lidar.theta)
    return BodyParameters(**file.model_dump(exclude={"lidar"}), lidar=lidar)


def default_body_text() -> str:
    """The text of the body file of wherry's own robot, a template for other robots."""
    return (resources.files("wherry.ros") / "body.yaml").read_text(encoding="utf-8")
