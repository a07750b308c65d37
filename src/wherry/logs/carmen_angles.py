"""Directions of the beams of CARMEN's scans, from what the messages and parameters of a log state."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from wherry.logs.log_lines import MalformedLineError

HALF_CIRCLE = math.pi  # rad, field of view of the lidars that FLASER was made for
HALF_CIRCLE_BEAMS = (180, 181, 361)  # numbers of beams of these lidars, and of no others
KNOWN_FIELDS: Mapping[int, float] = MappingProxyType(
    {beams: math.radians(100.0) for beams in (101, 201, 401)}
    | {beams: math.radians(270.0) for beams in (540, 541, 1080, 1081)}
    | {beams: beams * math.radians(360.0 / 1024.0) for beams in (681, 682, 683, 726)}
)
"""Fields of view, rad, of SICK LMS 200 at 100°, of lidars with 270°, and of Hokuyo URG-04LX, by the number of beams."""
MAX_FIELD = math.tau + math.radians(2.0)  # rad, larger fields of view are in degrees
ROUNDING = 0.01  # rad, error of a rounded field of view
FIELD_TOLERANCE = 0.05  # share by which two statements of a field of view may differ


@dataclass(frozen=True, slots=True)
class BeamAngles:
    """Directions of the beams of a scan.

    Attributes:
        start: Direction of the first beam, rad.
        increment: Angle from one beam to the next, rad.
        note: What was assumed; empty if the log states all.
    """

    start: float
    increment: float
    note: str = ""


def unstated_angles(count: int, field_of_view: float | None, resolution: float | None) -> BeamAngles:
    """Directions of the beams of a message that has ranges only, symmetric about the lidar's x axis.

    Args:
        count: Number of beams.
        field_of_view: Parameter of the log, rad or degrees; None if it has none.
        resolution: Parameter of the log, angle between beams, degrees; None if it has none.
    """
    if field_of_view is not None and field_of_view > 0.0:
        field = field_of_view if field_of_view <= MAX_FIELD else math.radians(field_of_view)
        return _symmetric(count, HALF_CIRCLE if abs(field - HALF_CIRCLE) <= ROUNDING else field)
    if resolution is not None and 0.0 < resolution * count <= math.degrees(MAX_FIELD):
        field = math.radians(resolution) * (count - count % 2)
        if abs(field - HALF_CIRCLE) <= FIELD_TOLERANCE * HALF_CIRCLE:
            return _symmetric(count, HALF_CIRCLE)
        note = f"the field of view is {math.degrees(field):.0f}° by laser_front_laser_resolution and {count} beams"
        return _symmetric(count, field, note)
    if count in HALF_CIRCLE_BEAMS:
        return _symmetric(count, HALF_CIRCLE)
    field = KNOWN_FIELDS.get(count, HALF_CIRCLE)
    assumed = f"{count} beams without a stated field of view: {math.degrees(field):.0f}° are assumed"
    return _symmetric(count, field, f"{assumed}; a line PARAM laser_front_laser_fov, in rad, states it")


def _symmetric(count: int, field_of_view: float, note: str = "") -> BeamAngles:
    """Beams that begin at the right end of a field of view, rad.

    An even number of beams leaves out the last direction; an odd number includes it.
    """
    return BeamAngles(-field_of_view / 2.0, field_of_view / (count if count % 2 == 0 else max(count - 1, 1)), note)


def stated_angles(count: int, start: float, field_of_view: float, resolution: float) -> BeamAngles:
    """Directions of the beams of a message that states them.

    Args:
        count: Number of beams.
        start: Direction of the first beam, rad, or degrees if the field of view is in degrees.
        field_of_view: Angle from the first to the last beam or one more, rad or degrees; 0 if it is not stated.
        resolution: Angle between beams, as the field of view; 0 if it is not stated.

    Raises:
        MalformedLineError: The statements contradict one another, and none is supported by the others.
    """
    if field_of_view > MAX_FIELD:
        start, field_of_view, resolution = math.radians(start), math.radians(field_of_view), math.radians(resolution)
    if min(field_of_view, resolution) < 0.0 or max(field_of_view, resolution) == 0.0:
        raise MalformedLineError("the field of view and the angle between beams must be above 0")
    if resolution == 0.0:
        return BeamAngles(start, _symmetric(count, field_of_view).increment)
    span = resolution * count
    fits = field_of_view == 0.0 or span - 2.0 * resolution <= field_of_view <= span + resolution
    if fits and span - resolution <= MAX_FIELD:
        return BeamAngles(start, resolution)
    by_field, by_resolution = _is_half(start, field_of_view), _is_half(start, span)
    stated = (
        f"start angle {start:.4g}, field of view {field_of_view:.4g} and resolution {resolution:.4g} rad of"
        f" {count} beams contradict one another"
    )
    if by_field and not by_resolution:
        return _symmetric(count, field_of_view, f"{stated}: the beams fill the field of view")
    if by_resolution and not by_field and span <= MAX_FIELD:
        return BeamAngles(start, resolution, f"{stated}: the resolution is used")
    raise MalformedLineError(stated)


def _is_half(start: float, field_of_view: float) -> bool:
    """Whether beams that begin at an angle, rad, over a field of view, rad, are symmetric about the x axis."""
    return field_of_view > 0.0 and abs(start + field_of_view / 2.0) <= FIELD_TOLERANCE * field_of_view
