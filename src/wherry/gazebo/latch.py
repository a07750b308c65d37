"""A node that makes the detachable joints of Gazebo Sim the latch that the agent works.

Gazebo's joints know nothing of ``latch/command`` and ``latch/state``, nor of the warehouse. Each box of an exported
world has a joint of its own (`wherry.gazebo.sdf`), which an empty message closes with the box wherever it stands,
and which tells "attached" or "detached" when that changes, and only then. So this node

- closes the joint of the box that stands in the fork, if one does, as the models' poses say;
- opens it over the warehouse only, as the conveyor's cam does, and has Gazebo take the box in: it is put down outside;
- answers a command once Gazebo has told that it is done. A command that is not answered comes again, and is passed on
  again.

It says nothing before the world's clock has passed the time in which the world itself opens the joints, for they begin
closed; and the first thing that it asks of Gazebo is to open them, in case an earlier node has left one closed.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import yaml

from wherry.errors import InputError
from wherry.floorplan.plan import Cell
from wherry.ros import messages as ros
from wherry.ros.decoding import MessageError, decode_pose, decode_stamp
from wherry.ros.diagnostics import RejectedMessages
from wherry.ros.names import RosNames
from wherry.ros.nodes.latch import LatchCommand, LatchState, from_latch_command, to_latch_state
from wherry.ros.topics import Topic
from wherry.ros.transports.protocol import Transport
from wherry.space.pose import Pose
from wherry.yaml_files import check_number, load_mapping

FORMAT_VERSION = 1
LARGEST = 10.0  # m, of any length
MOST_BOXES = 1000
ROBOT = "wherry"
OPENING = (0, 1)  # s of the world's clock in which it opens the joints
ATTACHED, DETACHED = "attached", "detached"
OPEN = Topic("/latch/open", ros.Empty)
"""Lets go of whatever is held."""


def box_name(box: int) -> str:
    """The model of a box."""
    return f"box_{box}"


def pose_topic(model: str) -> Topic[ros.PoseStamped]:
    """Where a model is in the world; Gazebo's PosePublisher chooses the name."""
    return Topic(f"/model/{model}/pose", ros.PoseStamped)


def close_topic(box: int) -> Topic[ros.Empty]:
    """Makes the latch hold a box as it stands."""
    return Topic(f"/latch/close/{box_name(box)}", ros.Empty)


def take_in_topic(box: int) -> Topic[ros.Empty]:
    """Makes the warehouse take a box in."""
    return Topic(f"/latch/take_in/{box_name(box)}", ros.Empty)


def state_topic(box: int) -> Topic[ros.String]:
    """Where `ATTACHED` and `DETACHED` are told."""
    return Topic(f"/latch/state/{box_name(box)}", ros.String)


@dataclass(frozen=True, slots=True)
class Site:
    """What the latch has to know of an exported world.

    Attributes:
        boxes: How many.
        reach: m, how far from base_link a box's middle may be for the latch to close around it.
        cell_size: m, the cells' side.
        warehouse: Its cells; the corner of cell (0, 0) is the world's origin.
    """

    boxes: int
    reach: float
    cell_size: float
    warehouse: frozenset[Cell]

    def allows_opening(self, robot: Pose) -> bool:
        """Whether base_link is over the warehouse."""
        return Cell(math.floor(robot.x / self.cell_size), math.floor(robot.y / self.cell_size)) in self.warehouse


def format_site(site: Site) -> str:
    """A site as a file."""
    cells = [[cell.x, cell.y] for cell in sorted(site.warehouse)]
    document = {"wherry-latch": FORMAT_VERSION, "boxes": site.boxes, "reach": site.reach}
    return yaml.safe_dump({**document, "cell_size": site.cell_size, "warehouse": cells}, sort_keys=False)


def load_site(path: str | Path) -> Site:
    """Read what `format_site` wrote.

    Raises:
        InputError: The file cannot be read, or is not of this format.
    """
    document = load_mapping(path)
    if document.get("wherry-latch") != FORMAT_VERSION:
        raise InputError(path, "wherry-latch", f"is not {FORMAT_VERSION}; wherry export gazebo writes such files")
    return Site(
        boxes=_count(path, "boxes", document.get("boxes")),
        reach=check_number(path, "reach", document.get("reach"), most=LARGEST),
        cell_size=check_number(path, "cell_size", document.get("cell_size"), most=LARGEST),
        warehouse=_cells(path, document.get("warehouse")),
    )


def _count(path: str | Path, field: str, value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= MOST_BOXES:
        raise InputError(path, field, f"{value!r} is no whole number from 0 to {MOST_BOXES:,}")
    return value


def _cells(path: str | Path, value: Any) -> frozenset[Cell]:
    if not isinstance(value, list):
        raise InputError(path, "warehouse", "is no list of cells")
    for cell in value:
        if not (isinstance(cell, list) and [type(number) for number in cell] == [int, int]):
            raise InputError(path, "warehouse", f"{cell!r} is no cell, such as [3, 0]")
    return frozenset(Cell(x, y) for x, y in value)


class GazeboLatch:
    """The node.

    Args:
        site: The world.
        transport: ROS.
        names: What the agent's topics are called, and how often the state is told.
    """

    def __init__(self, site: Site, transport: Transport, names: RosNames) -> None:
        self.refusals = RejectedMessages()
        self._site = site
        self._transport = transport
        self._command, self._state = names.topics.latch_command, names.topics.latch_state
        self._period = 1 / names.rates.latch_state
        self._lock = threading.RLock()  # guards everything below; an answer may come while one asks
        self._time = 0.0  # s, the world's clock
        self._places: dict[str, Pose] = {}
        self._attached: set[int] = set()
        self._delivered: set[int] = set()
        self._is_reset = False
        self._pending: LatchCommand | None = None  # what Gazebo has been asked for
        self._answered = 0.0
        self._connect()

    def run(self, stopped: Callable[[], bool] = lambda: False) -> None:
        """Tell the latch's state again and again until ``stopped``; everything else happens as messages come."""
        while not stopped():
            with self._lock:
                self._reset()
                self._tell()
            time.sleep(self._period)

    @property
    def is_ready(self) -> bool:
        """Whether Gazebo has been heard, and has opened all joints."""
        return self._is_reset and self._time >= OPENING[-1] + 1

    def _connect(self) -> None:
        transport = self._transport
        transport.advertise(OPEN)
        transport.advertise(self._state)
        for model in (ROBOT, *map(box_name, range(self._site.boxes))):
            transport.subscribe(pose_topic(model), partial(self._hear_pose, model))
        for box in range(self._site.boxes):
            transport.advertise(close_topic(box))
            transport.advertise(take_in_topic(box))
            transport.subscribe(state_topic(box), partial(self._hear_state, box))
        transport.subscribe(self._command, self._hear_command)

    # ---- on the transport's thread

    def _hear_pose(self, model: str, message: ros.PoseStamped) -> None:
        try:
            seconds, pose = decode_stamp(message.header.stamp), decode_pose(message.pose)
        except MessageError as error:
            self.refusals.add(pose_topic(model).name, error)
            return
        with self._lock:
            self._places[model] = pose
            if model == ROBOT:
                self._time = seconds

    def _hear_state(self, box: int, message: ros.String) -> None:
        with self._lock:
            if message.data == ATTACHED:
                self._attached.add(box)
            elif message.data == DETACHED:
                self._attached.discard(box)
                self._take_in(box)
            else:
                self.refusals.add(state_topic(box).name, f"says {message.data!r}")
                return
            if self._pending is not None and self._pending.close == bool(self._attached):
                self._answer(self._pending)
            self._tell()

    def _hear_command(self, message: ros.JointState) -> None:
        try:
            command = from_latch_command(message)
        except MessageError as error:
            self.refusals.add(self._command.name, error)
            return
        with self._lock:
            if self.is_ready and command.number > self._answered:
                self._obey(command)
            self._tell()

    # ---- with the lock held

    def _obey(self, command: LatchCommand) -> None:
        """Ask Gazebo for what there is to do; where there is nothing, that is the answer."""
        box = self._box_in_fork()
        robot = self._places[ROBOT]
        if command.close and not self._attached and box is not None:
            self._pending = command
            self._transport.publish(close_topic(box), ros.Empty())
        elif not command.close and self._attached and self._site.allows_opening(robot):
            self._pending = command
            self._transport.publish(OPEN, ros.Empty())
        else:
            self._answer(command)

    def _answer(self, command: LatchCommand) -> None:
        self._answered, self._pending = command.number, None

    def _box_in_fork(self) -> int | None:
        """The box around which the latch can close."""
        robot = self._places[ROBOT]
        for box in sorted(set(range(self._site.boxes)) - self._delivered):
            place = self._places.get(box_name(box))
            if place is not None and place.distance_to(robot) <= self._site.reach:
                return box
        return None

    def _take_in(self, box: int) -> None:
        """Have the warehouse take in a box that was let go on command."""
        if self._pending is not None and not self._pending.close:
            self._delivered.add(box)
            self._transport.publish(take_in_topic(box), ros.Empty())

    def _reset(self) -> None:
        """Open every joint once somebody is there to do so."""
        if not self._is_reset and ROBOT in self._places and self._transport.count_subscribers(OPEN):
            self._is_reset = True
            self._transport.publish(OPEN, ros.Empty())

    def _tell(self) -> None:
        if self.is_ready:
            state = LatchState(self._time, bool(self._attached), self._answered)
            self._transport.publish(self._state, to_latch_state(state))
