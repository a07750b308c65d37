"""The running physics: one MuJoCo model and its state, behind the few verbs that the simulation needs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum

import mujoco
import numpy as np

from wherry.simulation.model import BOX_HEIGHT, BOX_MASS
from wherry.space.pose import Floats, Pose

SETTLING = 0.5  # s before the clock starts, for the robot to sink into its tyres
INTAKE_SPEED = 0.3  # m/s, at which a warehouse takes a box in, downwards


class Kind(Enum):
    """What a thing in the world is."""

    FLOOR = "floor"
    WALL = "wall"
    OBSTACLE = "obstacle"
    ROBOT = "robot"
    BOX = "box"
    WAREHOUSE = "warehouse"


@dataclass(frozen=True, slots=True)
class Thing:
    """Something that can be touched.

    Attributes:
        kind: What it is.
        index: Which one of its kind.
    """

    kind: Kind
    index: int = 0

    def __str__(self) -> str:
        return self.kind.value if self.kind in {Kind.FLOOR, Kind.ROBOT} else f"{self.kind.value} {self.index}"


class Physics:
    """The state of the world in MuJoCo.

    Args:
        model: As `build_model` makes it; belongs to this object from now on, since latches write to it.
        boxes: How many boxes it has.
    """

    def __init__(self, model: mujoco.MjModel, boxes: int) -> None:
        self.model = model
        self.data = mujoco.MjData(model)
        self._base = _positions(model, "robot/base_footprint")
        self._boxes = [_positions(model, f"box {index}") for index in range(boxes)]
        wheels = [model.joint(f"robot/{side}_wheel_joint").qposadr[0] for side in ("left", "right")]
        self._wheels = np.array(wheels)
        self._things = [_thing(model, geom) for geom in range(model.ngeom)]
        self._sinking: list[int] = []
        mujoco.mj_step(model, self.data, round(SETTLING / model.opt.timestep))
        self.data.time = 0.0

    @property
    def time(self) -> float:
        """Since the clock started, s."""
        return float(self.data.time)

    @property
    def robot_pose(self) -> Pose:
        """base_link in the world frame, seen from above."""
        return self._pose(self._base)

    @property
    def wheel_angles(self) -> Floats:
        """[2] rad, how far the left and the right wheel have turned."""
        angles: Floats = self.data.qpos[self._wheels]
        return angles

    @property
    def box_positions(self) -> Floats:
        """[B, 3] m, world frame, the boxes' centres; a box that stands on the floor has z = half its height."""
        return np.array([self.data.qpos[start : start + 3] for start in self._boxes]).reshape(-1, 3)

    def step(self, left: float, right: float) -> None:
        """Advance by one time step with wheel speeds in rad/s."""
        self.data.ctrl[0] = left
        self.data.ctrl[1] = right
        mujoco.mj_step(self.model, self.data)
        if self._sinking:
            self._stop_sunk_boxes()

    def touching(self) -> Iterator[tuple[Thing, Thing, Floats]]:
        """The pairs of things that touch, and where ([2] m, world frame), but for what stands on the floor."""
        geoms = self.data.contact.geom
        if not any(geoms[:, 0].tolist()):  # of a pair with the floor, which is geom 0, MuJoCo names the floor first
            return
        for contact, pair in enumerate(geoms.tolist()):
            first, second = (self._things[geom] for geom in pair)
            if Kind.FLOOR not in {first.kind, second.kind} and first != second:
                yield first, second, self.data.contact.pos[contact, :2].copy()

    def hold(self, box: int) -> None:
        """Weld a box to the robot where it stands."""
        robot, load = self.data.body("robot/base_footprint"), self.data.body(f"box {box}")
        inverse, offset, rotation = np.empty(4), np.empty(3), np.empty(4)
        mujoco.mju_negQuat(inverse, robot.xquat)
        mujoco.mju_rotVecQuat(offset, load.xpos - robot.xpos, inverse)
        mujoco.mju_mulQuat(rotation, inverse, load.xquat)
        latch = self.model.equality(f"latch {box}").id
        # The weld's data: a point of the box, where the robot has to have it, and the box's rotation against the robot.
        self.model.eq_data[latch, :10] = np.concatenate([np.zeros(3), offset, rotation])
        self.data.eq_active[latch] = 1

    def release(self, box: int) -> None:
        """Undo the weld."""
        self.data.eq_active[self.model.equality(f"latch {box}").id] = 0

    def take_in(self, box: int) -> None:
        """Let a box sink through the floor, as a conveyor would take it away; it touches nothing from now on."""
        geom = self.model.geom(f"box {box}").id
        self.model.geom_contype[geom] = self.model.geom_conaffinity[geom] = 0
        body = self.model.body(f"box {box}").id
        self.data.xfrc_applied[body, 2] = BOX_MASS * -self.model.opt.gravity[2]
        self._set_velocity(box, -INTAKE_SPEED)
        self._sinking.append(box)

    def place_robot(self, pose: Pose, load: int | None) -> None:
        """Put the robot, and the box that it holds, somewhere else; it stands still there."""
        before = self.robot_pose
        for start in [self._base] if load is None else [self._base, self._boxes[load]]:
            at = pose @ before.inverse @ self._pose(start)
            self.data.qpos[start : start + 2] = at.x, at.y
            self.data.qpos[start + 3 : start + 7] = [math.cos(at.theta / 2), 0, 0, math.sin(at.theta / 2)]
        self.data.qvel[:] = 0
        mujoco.mj_forward(self.model, self.data)

    def grip_wheels(self, friction: float) -> None:
        """Set the wheels' coefficient of friction."""
        for side in ("left", "right"):
            self.model.geom_friction[self.model.geom(f"robot/{side}_wheel").id, 0] = friction

    def _pose(self, start: int) -> Pose:
        """The pose of a free body whose seven numbers begin at ``start``."""
        x, y, _, w, i, j, k = self.data.qpos[start : start + 7].tolist()
        return Pose(x, y, math.atan2(2 * (w * k + i * j), 1 - 2 * (j * j + k * k)))

    def _set_velocity(self, box: int, downwards: float) -> None:
        """Make a box move straight up or down."""
        start = self.model.jnt_dofadr[self.model.body(f"box {box}").jntadr[0]]
        self.data.qvel[start : start + 6] = [0, 0, downwards, 0, 0, 0]

    def _stop_sunk_boxes(self) -> None:
        """Stop the boxes that have left the floor."""
        for box in [box for box in self._sinking if self.data.qpos[self._boxes[box] + 2] < -BOX_HEIGHT]:
            self._set_velocity(box, 0.0)
            self._sinking.remove(box)


def _positions(model: mujoco.MjModel, body: str) -> int:
    """Where in the model's positions a free body's seven numbers begin."""
    return int(model.jnt_qposadr[model.body(body).jntadr[0]])


def _thing(model: mujoco.MjModel, geom: int) -> Thing:
    """What a geom belongs to; everything of the robot is one thing."""
    name = model.geom(geom).name
    if name.startswith("robot/"):
        return Thing(Kind.ROBOT)
    kind, *numbers = name.split()
    return Thing(Kind(kind), int(numbers[0]) if numbers else 0)
