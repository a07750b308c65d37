"""Settings of the latch in an exported world, and the YAML file that contains them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import yaml
from pydantic import Field, field_validator

from wherry.documents import Document, Integer, Number, load_yaml
from wherry.floorplan.plan import Cell
from wherry.space.pose import Pose

FORMAT_VERSION = 1
MIN_LENGTH, MAX_LENGTH = 1e-3, 10.0  # m
MAX_BOXES = 1000

Length = Annotated[Number, Field(ge=MIN_LENGTH, le=MAX_LENGTH)]


@dataclass(frozen=True, slots=True)
class GazeboLatchSettings:
    """Properties of an exported world that the latch depends on.

    Attributes:
        boxes: Number of boxes.
        reach: Maximum distance from base_link to a box's centre at which the latch closes around it, m.
        cell_size: Side of a cell, m.
        warehouse: The warehouse's cells; the corner of cell (0, 0) is the world's origin.
    """

    boxes: int
    reach: float
    cell_size: float
    warehouse: frozenset[Cell]

    def is_over_warehouse(self, robot: Pose) -> bool:
        """Whether base_link, in the world frame, is over the warehouse."""
        return Cell(math.floor(robot.x / self.cell_size), math.floor(robot.y / self.cell_size)) in self.warehouse


class _LatchFile(Document):
    version: Integer = Field(alias="wherry-latch")
    boxes: Annotated[Integer, Field(ge=0, le=MAX_BOXES)]
    reach: Length
    cell_size: Length
    warehouse: list[Annotated[list[Integer], Field(min_length=2, max_length=2)]]

    @field_validator("version")
    @classmethod
    def check_version(cls, version: int) -> int:
        """Refuse other versions."""
        if version != FORMAT_VERSION:
            raise ValueError(f"is not {FORMAT_VERSION}; wherry export gazebo writes such files")
        return version


def format_latch_settings(settings: GazeboLatchSettings) -> str:
    """Format settings as YAML."""
    document = {
        "wherry-latch": FORMAT_VERSION,
        "boxes": settings.boxes,
        "reach": settings.reach,
        "cell_size": settings.cell_size,
        "warehouse": [[cell.x, cell.y] for cell in sorted(settings.warehouse)],
    }
    return yaml.safe_dump(document, sort_keys=False)


def load_latch_settings(path: str | Path) -> GazeboLatchSettings:
    """Read a file that `format_latch_settings` wrote.

    Raises:
        InputError: The file cannot be read, or a field is missing, unknown, or out of range.
    """
    file = load_yaml(path, _LatchFile)
    warehouse = frozenset(Cell(x, y) for x, y in file.warehouse)
    return GazeboLatchSettings(file.boxes, file.reach, file.cell_size, warehouse)
