"""A robot snapshot drawn on its map as one SVG element (paper, Fig. 3 and 4).

The SVG is not made with matplotlib, so that its colours can be CSS variables, which follow the theme of the page, and
every shape has a class, by which tests find it.
"""

from __future__ import annotations

import base64
import html
import io
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose
from wherry.trace.records import RobotSnapshot

Coordinates = NDArray[np.floating[Any]]  # of single precision in decoded traces

MARGIN = 0.3  # m around the mapped area
MAX_PARTICLES = 600  # drawn particles; more only make the file larger
LONGER_SIDE = 700  # px, default size of the picture

OCCUPIED_GREY, FREE_GREY = 45, 250  # grey levels of the map's image; unknown cells are transparent


@dataclass(frozen=True)
class MapBackground:
    """The layers below the robot, and the sizes of robot and boxes, in the map frame.

    Attributes:
        grid: The occupancy grid.
        warehouse: [K, 4, 2] m, the corners of the warehouse's cells.
        true_walls: [S, 2, 2] m, end points of the true walls' faces; may be empty.
        robot_radius: Radius of the robot's footprint, m.
        box_radius: Radius of a box, m.
    """

    grid: OccupancyGrid
    warehouse: Floats
    true_walls: Floats
    robot_radius: float
    box_radius: float


def draw_snapshot(
    background: MapBackground,
    snapshot: RobotSnapshot,
    driven: Floats,
    plan: Floats,
    *,
    label: str,
    around_robot: float | None = None,
) -> str:
    """Draw a snapshot.

    Args:
        background: Map, warehouse and true walls.
        snapshot: Measurements and estimates of the robot.
        driven: [D, 2] m, map frame, the path driven so far.
        plan: [G, 2] m, map frame, centres of the cells along the plan; may be empty.
        label: Text alternative for screen readers.
        around_robot: Half side of the shown square around the robot, m; None to show the whole map.

    Returns:
        An SVG element; its colours are CSS variables with default values.
    """
    west, south, east, north = (
        _extent(background) if around_robot is None else _square_around(snapshot.pose, around_robot)
    )
    width, height = east - west, north - south
    scale = LONGER_SIDE / max(width, height)
    layers = [
        _map_image(background.grid),
        _polygons(background.warehouse, "warehouse"),
        _segments(background.true_walls, "truth"),
        _line(driven, "driven"),
        _laser(snapshot),
        _line(plan, "plan"),
        _line(snapshot.path, "path"),
        *(_circle(x, y, background.box_radius, "box") for x, y in snapshot.boxes),
        _robot(snapshot.pose, background.robot_radius, background.box_radius, has_load=snapshot.has_load),
        _circle(snapshot.lidar.x, snapshot.lidar.y, 0.035, "lidar"),
        _particles(snapshot.particles),
    ]
    # Shapes have map coordinates; the group is mirrored because SVG's y axis points down.
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" role="img" aria-label="{html.escape(label)}" '
        f'viewBox="0 0 {width:.3f} {height:.3f}" width="{width * scale:.0f}" '
        f'height="{height * scale:.0f}">{STYLE}'
        f'<rect class="paper" width="{width:.3f}" height="{height:.3f}"/>'
        f'<g transform="translate({-west:.3f} {north:.3f}) scale(1 -1)">' + "".join(layers) + "</g></svg>"
    )


STYLE = """<style>
.paper{fill:var(--paper,#e6e8ec)}
.truth{stroke:var(--truth,#e08a00);stroke-width:.025;opacity:.55}
.warehouse{fill:#f4c430;fill-opacity:.45;stroke:#b58900;stroke-width:.02}
.driven{fill:none;stroke:#7a6fa8;stroke-width:.025;opacity:.6}
.laser{fill:#1f6feb}.beam{stroke:#1f6feb;stroke-width:.006;opacity:.22}
.plan{fill:none;stroke:#1a9c4b;stroke-width:.05;stroke-dasharray:.12 .08;opacity:.85}
.path{fill:none;stroke:#1a9c4b;stroke-width:.06}
.particle{stroke:#d1242f;stroke-width:.008;opacity:.5}
.box{fill:#a0622d;stroke:#5d3716;stroke-width:.02}
.robot{fill:#fff;fill-opacity:.85;stroke:#111;stroke-width:.025}
.fork{stroke:#111;stroke-width:.05;stroke-linecap:round}
.lidar{fill:#1f6feb}
</style>"""


def _extent(background: MapBackground) -> tuple[float, float, float, float]:
    """West, south, east, north edge of the known area, m, map frame."""
    cells = np.argwhere(~background.grid.unknown)
    if not len(cells):
        return -1.0, -1.0, 1.0, 1.0
    points = background.grid.centres(cells)
    west, south = points.min(axis=0) - MARGIN
    east, north = points.max(axis=0) + MARGIN
    return float(west), float(south), float(east), float(north)


def _square_around(pose: Pose, half_side: float) -> tuple[float, float, float, float]:
    """West, south, east, north edge of a square around the robot, m, map frame."""
    return pose.x - half_side, pose.y - half_side, pose.x + half_side, pose.y + half_side


def _map_image(grid: OccupancyGrid) -> str:
    """The map as an embedded PNG, one pixel per grid cell."""
    grey = np.where(grid.occupied, OCCUPIED_GREY, FREE_GREY).astype(np.uint8)
    alpha = np.where(grid.unknown, 0, 255).astype(np.uint8)
    buffer = io.BytesIO()
    Image.fromarray(np.dstack([grey, alpha])).save(buffer, "PNG", optimize=True)
    data = base64.b64encode(buffer.getvalue()).decode("ascii")
    height, width = grid.probability.shape
    origin = grid.origin
    # Row 0 of the image is at the smallest y of the map, which the mirrored group draws at the bottom.
    return (
        f'<image href="data:image/png;base64,{data}" width="{width * grid.resolution:.4f}" '
        f'height="{height * grid.resolution:.4f}" preserveAspectRatio="none" style="image-rendering:pixelated" '
        f'transform="translate({origin.x:.4f} {origin.y:.4f}) rotate({math.degrees(origin.theta):.4f})"/>'
    )


def _points(points: Iterable[Sequence[float]]) -> str:
    return " ".join(f"{x:.3f},{y:.3f}" for x, y in points)


def _line(points: Coordinates, style: str) -> str:
    return f'<polyline class="{style}" points="{_points(points)}"/>' if len(points) > 1 else ""


def _segments(segments: Floats, style: str) -> str:
    return "".join(
        f'<line class="{style}" x1="{a[0]:.3f}" y1="{a[1]:.3f}" x2="{b[0]:.3f}" y2="{b[1]:.3f}"/>' for a, b in segments
    )


def _polygons(polygons: Floats, style: str) -> str:
    return "".join(f'<polygon class="{style}" points="{_points(polygon)}"/>' for polygon in polygons)


def _circle(x: float, y: float, radius: float, style: str) -> str:
    return f'<circle class="{style}" cx="{x:.3f}" cy="{y:.3f}" r="{radius:.3f}"/>'


def _laser(snapshot: RobotSnapshot) -> str:
    """The beams as thin lines with a dot at each end point."""
    beams = "".join(
        f'<line class="beam" x1="{snapshot.lidar.x:.3f}" y1="{snapshot.lidar.y:.3f}" x2="{x:.3f}" y2="{y:.3f}"/>'
        for x, y in snapshot.points
    )
    return beams + "".join(_circle(x, y, 0.022, "laser") for x, y in snapshot.points)


def _particles(particles: Coordinates) -> str:
    """A short line along the heading of each particle."""
    drawn = particles[:: max(1, math.ceil(len(particles) / MAX_PARTICLES))]
    return "".join(
        f'<line class="particle" x1="{x:.3f}" y1="{y:.3f}" '
        f'x2="{x + 0.12 * math.cos(theta):.3f}" y2="{y + 0.12 * math.sin(theta):.3f}"/>'
        for x, y, theta in drawn
    )


def _robot(pose: Pose, radius: float, box_radius: float, *, has_load: bool) -> str:
    """The robot seen from above: footprint, prongs of the fork, and load."""
    prong, tip = 0.8 * radius, 0.55 * radius
    load = _circle(0.0, 0.0, box_radius, "box") if has_load else ""
    return (
        f'<g transform="translate({pose.x:.3f} {pose.y:.3f}) rotate({math.degrees(pose.theta):.2f})">'
        + _circle(0.0, 0.0, radius, "robot")
        + "".join(
            f'<line class="fork" x1="{-tip:.3f}" y1="{side:.3f}" x2="{tip:.3f}" y2="{side:.3f}"/>'
            for side in (-prong, prong)
        )
        + load
        + "</g>"
    )
