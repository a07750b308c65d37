"""The boxes of a delivery as objects of the State, with their names and tracks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wherry.realization.box_tracks import BoxTrack, update_tracks
from wherry.robot import Body, Scan
from wherry.space.pose import Floats, Pose


@dataclass(frozen=True, slots=True)
class BoxObject:
    """A box that the robot found and has not delivered yet.

    Attributes:
        name: Name of the object in the State.
        track: Track of the box, at its last position on the floor.
        is_held: Whether the latch holds it.
    """

    name: str
    track: BoxTrack
    is_held: bool = False

    @property
    def position(self) -> Floats:
        """[2] centre of the track, m, map frame."""
        return np.array([self.track.x, self.track.y])


class BoxRegistry:
    """All boxes that were found and are not delivered yet.

    Args:
        tracks: Tracks of the boxes on the floor, which are named in this order.

    Attributes:
        boxes: The boxes on the floor and in the fork.
        picked_up: Tracks of all boxes that were picked up so far, at their positions before.
        delivered: Number of delivered boxes.
    """

    def __init__(self, tracks: Sequence[BoxTrack]) -> None:
        self.boxes: tuple[BoxObject, ...] = ()
        self.picked_up: tuple[BoxTrack, ...] = ()
        self.delivered = 0
        self._name_count = 0
        self.add(tracks)

    @property
    def on_floor(self) -> tuple[BoxObject, ...]:
        """The boxes on the floor, including one between the prongs that the latch does not hold."""
        return tuple(box for box in self.boxes if not box.is_held)

    @property
    def held(self) -> BoxObject | None:
        """The box that the latch holds; None for none."""
        return next((box for box in self.boxes if box.is_held), None)

    def add(self, tracks: Sequence[BoxTrack]) -> None:
        """Add and name the boxes whose tracks are not known yet."""
        known = {box.track.track_id for box in self.on_floor}
        new = [track for track in tracks if track.track_id not in known]
        self.boxes += tuple(
            BoxObject(f"box{self._name_count + number}", track) for number, track in enumerate(new, start=1)
        )
        self._name_count += len(new)

    def pick_up(self, picked: BoxObject) -> None:
        """Mark a box as held."""
        self.boxes = tuple(replace(box, is_held=True) if box is picked else box for box in self.boxes)
        self.picked_up += (picked.track,)

    def deliver(self, delivered: BoxObject) -> None:
        """Remove a box that the warehouse has taken, and count it as delivered."""
        self.remove(delivered)
        self.delivered += 1

    def remove(self, removed: BoxObject) -> None:
        """Remove a box."""
        self.boxes = tuple(box for box in self.boxes if box is not removed)

    def update(self, scan: Scan, pose: Pose, body: Body) -> None:
        """Update the tracks of the boxes on the floor with a scan.

        Args:
            scan: The new scan.
            pose: base_link in the map frame at the scan's time.
            body: The robot's shape.
        """
        on_floor = [box.track for box in self.on_floor]
        if not on_floor:
            return
        updated = {track.track_id: track for track in update_tracks(on_floor, scan, pose, body)}
        self.boxes = tuple(
            box if box.is_held else replace(box, track=updated[box.track.track_id]) for box in self.boxes
        )
