"""The robot's world as an Environment: States come up from scans, Actions go down to the wheels (paper, section 7)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wherry.domains.delivery import DROPOFF, MOVES, PICKUP, BoxState, DeliverySite, delivery_reward
from wherry.floorplan.plan import Cell, Direction, Wall
from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.mdp import Transition
from wherry.oomdp.objects import State
from wherry.oomdp.relations import DIRECTIONS
from wherry.realization import boxes as seeing
from wherry.realization.cells import ways_seen
from wherry.realization.execution import move
from wherry.realization.pilot import Load, Pilot, shows_load, without_load
from wherry.robot import Scan
from wherry.space.frame import CellFrame
from wherry.space.pose import Floats, Pose
from wherry.trace.records import Narration, Phase

LOOK_EVERY = 3  # scans between two in which the boxes are looked for
LONGEST_INTAKE = 50  # scans that the robot waits for a conveyor to take its box

COMPASS = {name: Direction(step) for name, step in DIRECTIONS.items()}


@dataclass(frozen=True, slots=True)
class KnownBox:
    """A box as the robot knows it.

    Attributes:
        name: Its name in the State.
        place: Where it was last seen on the floor.
        held: Whether the latch holds it.
    """

    name: str
    place: seeing.Box
    held: bool = False

    @property
    def position(self) -> Floats:
        """[2] m, map frame."""
        return np.array([self.place.x, self.place.y])


class RobotEnvironment:
    """A robot that stands in a cell, perceives a State, and does Actions.

    Args:
        pilot: Drives the robot and knows its pose.
        frame: Where the cells lie in the map.
        site: The walls that the map shows, and the warehouse.
        boxes: The boxes that were found.
    """

    def __init__(self, pilot: Pilot, frame: CellFrame, site: DeliverySite, boxes: Sequence[seeing.Box]) -> None:
        self.pilot = pilot
        self.frame = frame
        self.site = site
        self._mapped = site
        self.delivered = 0
        self._scans = 0
        self._ghosts: set[str] = set()
        self._boxes = tuple(KnownBox(f"box{number}", box) for number, box in enumerate(boxes, start=1))
        self._named = len(self._boxes)
        self._taken: tuple[seeing.Box, ...] = ()
        pilot.watchers.append(self._watch_boxes)
        self._tell_pilot()

    @property
    def domain(self) -> Domain:
        """Delivery, within the map's bounds."""
        return self.site.domain

    @property
    def cell(self) -> Cell:
        """The cell that the robot stands in; the nearest one, should it take itself to be beyond the map's bounds."""
        x, y = self.frame.cell_at(self.pilot.pose.x, self.pilot.pose.y)
        (west, east), (south, north) = self.site.x_range, self.site.y_range
        return Cell(min(max(x, west), east), min(max(y, south), north))

    @property
    def remaining(self) -> int:
        """How many of the boxes that were found are not delivered yet."""
        return len(self._boxes)

    @property
    def standing(self) -> tuple[KnownBox, ...]:
        """The boxes on the floor."""
        return tuple(box for box in self._boxes if not box.held)

    @property
    def taken(self) -> tuple[seeing.Box, ...]:
        """The boxes that were picked up so far, where they stood."""
        return self._taken

    @property
    def holding(self) -> bool:
        """Whether the latch holds a box."""
        return any(box.held for box in self._boxes)

    def learn_of(self, frame: CellFrame, site: DeliverySite, boxes: Sequence[seeing.Box]) -> None:
        """Take in what more has been seen of the world; what was known of boxes still holds.

        Args:
            frame: Where the cells lie in the map now.
            site: The walls that the map shows now, and the warehouse.
            boxes: The boxes on the floor; one with a number that is known is known.
        """
        known = {box.place.number for box in self.standing}
        fresh = [box for box in boxes if box.number not in known]
        self._boxes += tuple(KnownBox(f"box{self._named + at}", box) for at, box in enumerate(fresh, start=1))
        self._named += len(fresh)
        self.frame, self.site, self._mapped = frame, site, site
        self._tell_pilot()

    def step_aside(self) -> bool:
        """Leave a box that stands in the fork and is not held; return whether none stands there now."""
        here = self.cell
        if self._standing_in(here) is None:
            return True
        for direction in Direction:
            if Wall.between(here, direction) not in self.site.walls and not self._standing_in(
                here.neighbour(direction)
            ):
                self._move(direction)
                if self.cell != here:
                    return True
        return False

    def reset(self, rng: np.random.Generator) -> State:
        """Perceive where things stand; a robot lives once, so nothing is put back."""
        return self._perceive()

    def step(self, action: Action) -> Transition:
        """Do an action with wheels and latch, and perceive what came of it.

        An action on which the robot got lost says nothing of what actions do: it is done anew from wherever the robot
        finds itself.

        Raises:
            ValueError: There is no such action.
        """
        while True:
            times_lost = self.pilot.times_lost
            before = self._perceive()
            self._do(action)
            after = self._perceive()
            if self.pilot.times_lost == times_lost:
                # That there never was a box is no effect of the action.
                for name in self._ghosts:
                    before = before.without(name) if before.get(name) is not None else before
                reached = not after.of_class("Box")
                return Transition(before, action, after, delivery_reward(before, action, after), reached)
            self.site = self._mapped  # what was seen from a wrong place is forgotten
            self._centre()

    def _do(self, action: Action) -> None:
        if action in MOVES:
            self._move(COMPASS[MOVES[action]])
        elif action == PICKUP:
            self._pick_up()
        elif action == DROPOFF:
            self._drop_off()
        else:
            raise ValueError(f"the robot has no action {action}")

    def _centre(self) -> None:
        """Drive to the middle of the cell that the robot is in."""
        middle = self.frame.centre(self.cell.x, self.cell.y)
        self.pilot.go_to(Pose(float(middle[0]), float(middle[1]), self.pilot.pose.theta), reverse=self.holding)

    def _move(self, direction: Direction) -> None:
        here, there = self.cell, self.cell.neighbour(direction)
        ahead, waiting = self._standing_in(there), self._standing_in(here)
        held = self.holding
        fork_full = held or waiting is not None
        docking = ahead is not None and not fork_full
        home = self.frame.centre(here.x, here.y) if waiting is None else waiting.position
        goal = ahead.position if ahead is not None and docking else self.frame.centre(there.x, there.y)
        move(self.pilot, home, goal, docking=docking, fork_full=fork_full, held=held)

    def _pick_up(self) -> None:
        here = self._standing_in(self.cell)
        if self.pilot.robot.close_latch() and here is not None and not self.holding:
            self._boxes = tuple(replace(box, held=True) if box is here else box for box in self._boxes)
            self._taken += (here.place,)
        self._tell_pilot()

    def _drop_off(self) -> None:
        held = next((box for box in self._boxes if box.held), None)
        if self.pilot.robot.open_latch() and held is not None:
            self._boxes = tuple(box for box in self._boxes if box is not held)
            self.delivered += 1
            self._tell_pilot()
            self._wait_for_intake()

    def _wait_for_intake(self) -> None:
        """Stand until the conveyor has taken the box out of the fork."""
        for _ in range(LONGEST_INTAKE):
            if not shows_load(self.pilot.look(), self.pilot.body):
                return

    def _perceive(self) -> State:
        """Look, correct what is known of the four ways out of this cell, and say it in objects."""
        scan = self.pilot.look()
        if not self.pilot.tracker.lost:
            self._forget_ghost(scan)
            self._correct_walls(scan)
        boxes = (BoxState(box.name, self._cell_of(box), box.held) for box in self._boxes)
        return self.site.state(self.cell, boxes)

    def _forget_ghost(self, scan: Scan) -> None:
        """A box that should stand in the fork, but that the lidar does not see there, was none."""
        here = self._standing_in(self.cell)
        if here is None or shows_load(scan, self.pilot.body):
            return
        self._boxes = tuple(box for box in self._boxes if box is not here)
        self._ghosts.add(here.name)
        self._tell_pilot()
        self.pilot.sink(
            Narration(self.pilot.time, Phase.SURVEY, f"There is no box here: what I took for {here.name} is none.")
        )

    def _correct_walls(self, scan: Scan) -> None:
        """A live scan outranks the map, wherever it shows whether a way is blocked."""
        scan = without_load(scan, self.pilot.body)
        walls = set(self.site.walls)
        cell = self.cell
        lidar = self.pilot.pose @ self.pilot.body.lidar
        positions = np.array([box.position for box in self.standing]).reshape(-1, 2)
        body = self.pilot.body
        for direction, blocked in ways_seen(
            scan, lidar, cell, self.frame, body.radius, positions, body.box_radius
        ).items():
            wall = Wall.between(cell, direction)
            if blocked:
                walls.add(wall)
            elif self._is_inside(cell.neighbour(direction)):
                walls.discard(wall)
        if walls != self.site.walls:
            self.site = replace(self.site, walls=frozenset(walls))

    def _is_inside(self, cell: Cell) -> bool:
        """Whether a cell lies within the map's bounds, beyond which there are no states."""
        (west, east), (south, north) = self.site.x_range, self.site.y_range
        return west <= cell.x <= east and south <= cell.y <= north

    def _watch_boxes(self, scan: Scan, pose: Pose) -> None:
        """Keep the places of the boxes on the floor up to date: the nearer the robot comes, the better it sees them."""
        self._scans += 1
        on_floor = [box.place for box in self.standing]
        if self._scans % LOOK_EVERY or not on_floor:
            return
        seen = {box.number: box for box in seeing.look_for_boxes(on_floor, scan, pose, self.pilot.body)}
        self._boxes = tuple(box if box.held else replace(box, place=seen[box.place.number]) for box in self._boxes)

    def _standing_in(self, cell: Cell) -> KnownBox | None:
        """The box on the floor of a cell."""
        return next((box for box in self.standing if self._cell_of(box) == cell), None)

    def _cell_of(self, box: KnownBox) -> Cell:
        return Cell(*self.frame.cell_at(box.place.x, box.place.y))

    def _tell_pilot(self) -> None:
        on_floor = [box.position for box in self.standing]
        self.pilot.load = Load(np.array(on_floor).reshape(-1, 2), held=self.holding)
