"""The robot as an `Environment`: perceives States in scans and executes Actions by driving (paper, section 7)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from wherry.domains.delivery import DROPOFF, MOVES, PICKUP, BoxState, DeliverySite, delivery_reward
from wherry.floorplan.plan import Cell, Direction, Wall
from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.mdp import Transition
from wherry.oomdp.objects import State
from wherry.oomdp.relations import DIRECTIONS
from wherry.realization.box_registry import BoxObject, BoxRegistry
from wherry.realization.box_tracker import DETECTION_PERIOD
from wherry.realization.box_tracks import BoxTrack
from wherry.realization.cells import blocked_directions
from wherry.realization.execution import move_to_cell
from wherry.realization.load import detects_load, mask_load
from wherry.realization.pilot import KnownBoxes, Pilot
from wherry.robot import Scan
from wherry.space.frame import CellFrame
from wherry.space.pose import Pose
from wherry.trace.records import Narration, Phase

INTAKE_TIMEOUT = 50  # scans for which the robot waits until the conveyor has taken its box

DIRECTION_BY_NAME = {name: Direction(step) for name, step in DIRECTIONS.items()}


class RobotEnvironment:
    """A robot in a world of cells: perceives States and executes Actions.

    Args:
        pilot: Drives the robot and tracks its pose.
        frame: The cell frame on the map.
        site: The map's walls, and the warehouse.
        boxes: Tracks of the boxes that were found.

    Attributes:
        pilot: Drives the robot and tracks its pose.
        frame: The cell frame on the map.
        site: The walls of the map, corrected by scans, and the warehouse.
    """

    def __init__(self, pilot: Pilot, frame: CellFrame, site: DeliverySite, boxes: Sequence[BoxTrack]) -> None:
        self.pilot = pilot
        self.frame = frame
        self.site = site
        self._mapped_site = site
        self._boxes = BoxRegistry(boxes)
        self._scan_count = 0
        self._false_boxes: set[str] = set()
        pilot.scan_callbacks.append(self._update_boxes)
        self._update_pilot()

    @property
    def domain(self) -> Domain:
        """The delivery domain within the map's bounds."""
        return self.site.domain

    @property
    def cell(self) -> Cell:
        """The robot's cell, clipped to the map's bounds."""
        x, y = self.frame.cell_at(self.pilot.pose.x, self.pilot.pose.y)
        (west, east), (south, north) = self.site.x_range, self.site.y_range
        return Cell(min(max(x, west), east), min(max(y, south), north))

    @property
    def delivered(self) -> int:
        """Number of delivered boxes."""
        return self._boxes.delivered

    @property
    def remaining(self) -> int:
        """Number of boxes that were found and are not delivered yet."""
        return len(self._boxes.boxes)

    @property
    def boxes_on_floor(self) -> tuple[BoxObject, ...]:
        """The boxes on the floor."""
        return self._boxes.on_floor

    @property
    def picked_up(self) -> tuple[BoxTrack, ...]:
        """Tracks of the boxes that were picked up so far, at their positions before."""
        return self._boxes.picked_up

    @property
    def is_holding(self) -> bool:
        """Whether the latch holds a box."""
        return self._boxes.held is not None

    def update_map(self, frame: CellFrame, site: DeliverySite, boxes: Sequence[BoxTrack]) -> None:
        """Replace the map by an extended one; the known boxes keep their names.

        Args:
            frame: The cell frame on the new map.
            site: The new map's walls, and the warehouse.
            boxes: Tracks of the boxes on the floor; those with a new track id are added.
        """
        self._boxes.add(boxes)
        self.frame, self.site, self._mapped_site = frame, site, site
        self._update_pilot()

    def leave_unheld_box(self) -> bool:
        """Leave a cell with a box that is not held, if the robot is in one; return whether its cell has no box now."""
        here = self.cell
        if self._box_in(here) is None:
            return True
        for direction in Direction:
            if Wall.between(here, direction) not in self.site.walls and not self._box_in(here.neighbour(direction)):
                self._move(direction)
                if self.cell != here:
                    return True
        return False

    def reset(self, rng: np.random.Generator) -> State:
        """Perceive the present State; the real world is not reset."""
        return self._perceive()

    def step(self, action: Action) -> Transition:
        """Execute an action and perceive the next State.

        An action during which the robot got lost is not a valid sample; it is executed again from the cell in which the
        robot is localized afterwards.

        Raises:
            ValueError: The domain has no such action.
        """
        while True:
            times_lost = self.pilot.times_lost
            before = self._perceive()
            self._execute(action)
            after = self._perceive()
            if self.pilot.times_lost == times_lost:
                before = self._without_false_boxes(before)
                terminated = not after.of_class("Box")
                return Transition(before, action, after, delivery_reward(before, action, after), terminated)
            self.site = self._mapped_site  # walls perceived from a wrong pose are discarded
            self._centre_in_cell()

    def _without_false_boxes(self, state: State) -> State:
        """The state without the boxes that turned out to be false detections, so that no effect removes them."""
        for name in self._false_boxes:
            state = state.without(name) if state.get(name) is not None else state
        return state

    def _execute(self, action: Action) -> None:
        """Drive a move, or close or open the latch."""
        if action in MOVES:
            self._move(DIRECTION_BY_NAME[MOVES[action]])
        elif action == PICKUP:
            self._pick_up()
        elif action == DROPOFF:
            self._drop_off()
        else:
            raise ValueError(f"the robot has no action {action}")

    def _centre_in_cell(self) -> None:
        """Drive to the centre of the robot's cell."""
        x, y = self.frame.centre(self.cell.x, self.cell.y).tolist()
        self.pilot.go_to(Pose(x, y, self.pilot.pose.theta), reverse=self.is_holding)

    def _move(self, direction: Direction) -> None:
        """Drive to the next cell; dock if a box stands in it and the fork is empty."""
        here, there = self.cell, self.cell.neighbour(direction)
        box_ahead, box_here = self._box_in(there), self._box_in(here)
        is_fork_full = self.is_holding or box_here is not None
        is_docking = box_ahead is not None and not is_fork_full
        start = self.frame.centre(here.x, here.y) if box_here is None else box_here.position
        goal = box_ahead.position if box_ahead is not None and is_docking else self.frame.centre(there.x, there.y)
        move_to_cell(
            self.pilot, start, goal, is_docking=is_docking, is_fork_full=is_fork_full, is_holding=self.is_holding
        )

    def _pick_up(self) -> None:
        """Close the latch, and mark the box of the robot's cell as held if it holds one."""
        box = self._box_in(self.cell)
        if self.pilot.robot.close_latch() and box is not None and not self.is_holding:
            self._boxes.pick_up(box)
        self._update_pilot()

    def _drop_off(self) -> None:
        """Open the latch, and count the held box as delivered if it was released."""
        held = self._boxes.held
        if self.pilot.robot.open_latch() and held is not None:
            self._boxes.deliver(held)
            self._update_pilot()
            self._wait_for_intake()

    def _wait_for_intake(self) -> None:
        """Wait until the conveyor has taken the box out of the fork, or until the timeout."""
        for _ in range(INTAKE_TIMEOUT):
            if not detects_load(self.pilot.wait_for_scan(), self.pilot.body):
                return

    def _perceive(self) -> State:
        """Wait for a scan, correct the boxes and walls around the robot with it, and return the State."""
        scan = self.pilot.wait_for_scan()
        if not self.pilot.tracker.is_lost:
            self._remove_false_box(scan)
            self._correct_walls(scan)
        boxes = (BoxState(box.name, self._cell_of(box), box.is_held) for box in self._boxes.boxes)
        return self.site.state(self.cell, boxes)

    def _remove_false_box(self, scan: Scan) -> None:
        """Remove the box of the robot's cell if the scan shows none in the fork."""
        box = self._box_in(self.cell)
        if box is None or detects_load(scan, self.pilot.body):
            return
        self._boxes.remove(box)
        self._false_boxes.add(box.name)
        self._update_pilot()
        text = f"There is no box here: {box.name} was a false detection."
        self.pilot.sink(Narration(self.pilot.time, Phase.SURVEY, text))

    def _correct_walls(self, scan: Scan) -> None:
        """Replace the walls around the robot's cell by those in the scan, which is more recent than the map."""
        pilot, body, cell = self.pilot, self.pilot.body, self.cell
        positions = np.array([box.position for box in self.boxes_on_floor]).reshape(-1, 2)
        scan, lidar = mask_load(scan, body), pilot.pose @ body.lidar
        blocked = blocked_directions(scan, lidar, cell, self.frame, body.radius, positions, body.box_radius)
        self.site = _with_walls_around(self.site, cell, blocked)

    def _update_boxes(self, scan: Scan, pose: Pose) -> None:
        """Update the tracks of the boxes on the floor, whose accuracy increases as the robot approaches."""
        self._scan_count += 1
        if self._scan_count % DETECTION_PERIOD == 0:
            self._boxes.update(scan, pose, self.pilot.body)

    def _box_in(self, cell: Cell) -> BoxObject | None:
        """The box on the floor of a cell; None for none."""
        return next((box for box in self.boxes_on_floor if self._cell_of(box) == cell), None)

    def _cell_of(self, box: BoxObject) -> Cell:
        """The cell that contains a box's centre."""
        return Cell(*self.frame.cell_at(box.track.x, box.track.y))

    def _update_pilot(self) -> None:
        """Pass the boxes' positions and the load to the pilot."""
        on_floor = [box.position for box in self.boxes_on_floor]
        self.pilot.boxes = KnownBoxes(np.array(on_floor).reshape(-1, 2), is_holding=self.is_holding)


def _with_walls_around(site: DeliverySite, cell: Cell, blocked: Mapping[Direction, bool]) -> DeliverySite:
    """The site with a wall in each blocked direction of a cell, and none in the other observed directions.

    Walls on the map's bounds are kept, since there are no states beyond them.
    """
    (west, east), (south, north) = site.x_range, site.y_range
    walls = set(site.walls)
    for direction, is_blocked in blocked.items():
        neighbour = cell.neighbour(direction)
        if is_blocked:
            walls.add(Wall.between(cell, direction))
        elif west <= neighbour.x <= east and south <= neighbour.y <= north:
            walls.discard(Wall.between(cell, direction))
    return site if walls == site.walls else replace(site, walls=frozenset(walls))
