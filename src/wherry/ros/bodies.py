"""A robot's shape and limits from a YAML file; the lidar's place may be left to the transforms."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from importlib import resources
from pathlib import Path
from typing import Any

import yaml

from wherry.errors import InputError
from wherry.files import read_text
from wherry.robot import Body
from wherry.space.pose import Pose

LARGEST_FILE = 64_000  # bytes
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
    try:
        document = yaml.safe_load(own_body() if path is None else read_text(path, limit=LARGEST_FILE))
    except yaml.YAMLError as error:
        raise InputError(source, "", f"is not YAML: {str(error).splitlines()[0]}") from error
    if not isinstance(document, dict):
        raise InputError(source, "", "is not a mapping")
    numbers = [entry.name for entry in fields(BodyParameters) if entry.name != "lidar"]
    for key in document:
        if key not in (*numbers, "lidar"):
            raise InputError(source, str(key), f"is none of {', '.join(numbers)}, lidar")
    values = {key: _number(source, key, document.get(key), positive=True) for key in numbers}
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
    return Pose(*(_number(source, f"lidar.{key}", value[key], positive=False) for key in LIDAR))


def _number(source: str | Path, field: str, value: Any, *, positive: bool) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(source, field, "is missing" if value is None else f"{value!r} is no number")
    if abs(value) > LARGEST or (positive and value <= 0.0):
        raise InputError(source, field, f"{value} is not {'above 0 and' if positive else ''} at most {LARGEST:g}")
    return float(value)
