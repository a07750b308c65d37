"""RViz markers of boxes, warehouse cells, walls and the perceived condition."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from wherry.robot import BOX_HEIGHT
from wherry.ros import messages as ros
from wherry.ros.encoding import encode_header, encode_pose
from wherry.space.frame import CellFrame
from wherry.space.pose import Pose
from wherry.trace.records import CellLayout, RobotSnapshot

TILE_HEIGHT, LINE_WIDTH, TEXT_HEIGHT = 0.01, 0.01, 0.15  # m
BIT_SIZE = 0.8 * TEXT_HEIGHT  # m, edge of a condition bit's square
BITS_OFFSET, BITS_HEIGHT = 0.4, 0.3  # m, in front of the robot and above the floor
TEXT_OFFSET, TEXT_ELEVATION = 0.5, 0.6  # m, in front of the robot and above the floor
RED, GREEN = ros.ColorRGBA(0.75, 0.18, 0.15, 1.0), ros.ColorRGBA(0.30, 0.62, 0.38, 0.6)
GREY, BLACK = ros.ColorRGBA(0.4, 0.4, 0.4, 0.5), ros.ColorRGBA(0.0, 0.0, 0.0, 1.0)
TRUE_COLOUR, FALSE_COLOUR = ros.ColorRGBA(0.95, 0.55, 0.10, 1.0), ros.ColorRGBA(0.35, 0.35, 0.35, 1.0)


class BoxMarkers:
    """Cylinders for boxes; markers of boxes that disappeared are deleted.

    Attributes:
        radius: Radius of a box, m.
    """

    def __init__(self) -> None:
        self.radius = 0.0
        self._shown = 0

    def update(self, snapshot: RobotSnapshot, frame: str) -> Iterator[ros.Marker]:
        """Markers of the boxes on the floor, of the one that the robot carries, and deletions."""
        poses = [Pose(float(x), float(y)) for x, y in snapshot.boxes]
        if snapshot.has_load:
            poses.append(snapshot.pose)
        header = encode_header(snapshot.time, frame)
        for number, pose in enumerate(poses):
            yield ros.Marker(
                header,
                "boxes",
                number,
                ros.Marker.CYLINDER,
                pose=encode_pose(pose, BOX_HEIGHT / 2),
                scale=ros.Vector3(2 * self.radius, 2 * self.radius, BOX_HEIGHT),
                color=RED,
            )
        for number in range(len(poses), self._shown):
            yield ros.Marker(header, "boxes", number, action=ros.Marker.DELETE)
        self._shown = len(poses)


def condition_markers(
    condition: str, terms: Sequence[str], snapshot: RobotSnapshot, frame: str
) -> Iterator[ros.Marker]:
    """The terms that hold as text, and a row of squares with a colour for each term.

    Args:
        condition: A "1" or "0" for each term; empty before the first perception.
        terms: Names of the terms.
        snapshot: Observation with the robot's pose.
        frame: Name of the map frame.
    """
    if not condition:
        return
    header = encode_header(snapshot.time, frame)
    yield _condition_text(header, condition, terms, snapshot.pose)
    yield _condition_bits(header, condition, snapshot.pose)


def _condition_text(header: ros.Header, condition: str, terms: Sequence[str], robot: Pose) -> ros.Marker:
    true_terms = [term for term, bit in zip(terms, condition, strict=False) if bit == "1"]
    # From above, the text must hide neither the robot nor the squares.
    offset = TEXT_OFFSET + TEXT_HEIGHT * (1 + len(true_terms)) / 2
    return ros.Marker(
        header,
        "condition",
        0,
        ros.Marker.TEXT_VIEW_FACING,
        pose=encode_pose(Pose(robot.x, robot.y + offset), TEXT_ELEVATION),
        scale=ros.Vector3(z=TEXT_HEIGHT),
        color=BLACK,
        text="\n".join([condition, *true_terms]),
    )


def _condition_bits(header: ros.Header, condition: str, robot: Pose) -> ros.Marker:
    middle = (len(condition) - 1) / 2
    points = tuple(
        ros.Point(robot.x + (bit - middle) * TEXT_HEIGHT, robot.y + BITS_OFFSET, BITS_HEIGHT)
        for bit in range(len(condition))
    )
    return ros.Marker(
        header,
        "condition",
        1,
        ros.Marker.CUBE_LIST,
        scale=ros.Vector3(BIT_SIZE, BIT_SIZE, BIT_SIZE),
        color=FALSE_COLOUR,
        points=points,
        colors=tuple(TRUE_COLOUR if bit == "1" else FALSE_COLOUR for bit in condition),
    )


def cell_markers(cells: CellLayout, frame: str) -> Iterator[ros.Marker]:
    """The warehouse's cells as tiles, and the walls between cells as lines.

    Args:
        cells: The cells on the map.
        frame: Name of the map frame.
    """
    header = encode_header(cells.time, frame)
    size, origin = cells.frame.cell_size, cells.frame.origin
    for number, (x, y) in enumerate(cells.warehouse.tolist()):
        centre = cells.frame.centre(x, y)
        yield ros.Marker(
            header,
            "warehouse",
            number,
            ros.Marker.CUBE,
            pose=encode_pose(Pose(float(centre[0]), float(centre[1]), origin.theta), TILE_HEIGHT / 2),
            scale=ros.Vector3(size, size, TILE_HEIGHT),
            color=GREEN,
        )
    ends = tuple(end for wall in cells.walls.tolist() for end in _wall_ends(cells.frame, *wall))
    if ends:
        yield ros.Marker(
            header, "cells", 0, ros.Marker.LINE_LIST, scale=ros.Vector3(LINE_WIDTH), color=GREY, points=ends
        )


def _wall_ends(frame: CellFrame, x: int, y: int, north: int) -> list[ros.Point]:
    """Both ends of the wall on a cell's north or east edge, m, map frame."""
    corners = [(x, y + 1), (x + 1, y + 1)] if north else [(x + 1, y), (x + 1, y + 1)]
    ends = frame.origin.transform(np.array(corners, dtype=np.float64) * frame.cell_size)
    return [ros.Point(float(end[0]), float(end[1]), TILE_HEIGHT) for end in ends]
