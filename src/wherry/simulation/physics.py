"""MuJoCo behind the few operations that the simulation needs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum, auto

import mujoco
import numpy as np

from wherry.robot import BOX_HEIGHT
from wherry.simulation.model import BOX_MASS
from wherry.space.pose import Floats, Pose

SETTLING_TIME = 0.5  # s simulated before time 0, until the robot rests on its wheels
INTAKE_SPEED = 0.3  # m/s at which a delivered box sinks through the floor


class BodyKind(StrEnum):
    """Kinds of bodies; the values are the first words of their geoms' names in the MuJoCo model."""

    FLOOR = auto()
    WALL = auto()
    OBSTACLE = auto()
    ROBOT = auto()
    BOX = auto()
    WAREHOUSE = auto()


@dataclass(frozen=True, slots=True)
class ContactBody:
    """A body as one side of a contact.

    Attributes:
        kind: Kind of the body.
        index: Index among the bodies of its kind.
    """

    kind: BodyKind
    index: int = 0

    def __str__(self) -> str:
        return self.kind.value if self.kind in {BodyKind.FLOOR, BodyKind.ROBOT} else f"{self.kind.value} {self.index}"


class Physics:
    """A MuJoCo model and its state.

    Args:
        model: A model from `build_model`, which this object modifies.
        boxes: Number of boxes in the model.
    """

    def __init__(self, model: mujoco.MjModel, boxes: int) -> None:
        self.model = model
        self.data = mujoco.MjData(model)
        self._base = _qpos_address(model, "robot/base_footprint")
        self._boxes = [_qpos_address(model, f"box {index}") for index in range(boxes)]
        wheels = [model.joint(f"robot/{side}_wheel_joint").qposadr[0] for side in ("left", "right")]
        self._wheels = np.array(wheels)
        self._bodies = [_contact_body(model, geom) for geom in range(model.ngeom)]
        self._sinking: list[int] = []
        mujoco.mj_step(model, self.data, round(SETTLING_TIME / model.opt.timestep))
        self.data.time = 0.0

    @property
    def time(self) -> float:
        """Time since the clock started, s."""
        return float(self.data.time)

    @property
    def robot_pose(self) -> Pose:
        """base_link in the world frame, projected onto the floor."""
        return self._pose(self._base)

    @property
    def wheel_angles(self) -> Floats:
        """[2] angles of the left and the right wheel, rad."""
        angles: Floats = self.data.qpos[self._wheels]
        return angles

    @property
    def box_positions(self) -> Floats:
        """[B, 3] centres of the boxes, m, world frame; z is half a box's height for a box on the floor."""
        return np.array([self.data.qpos[start : start + 3] for start in self._boxes]).reshape(-1, 3)

    def step(self, left: float, right: float) -> None:
        """Advance by one time step with speeds of the left and the right wheel, rad/s."""
        self.data.ctrl[0] = left
        self.data.ctrl[1] = right
        mujoco.mj_step(self.model, self.data)
        if self._sinking:
            self._stop_sunk_boxes()

    def contacts(self) -> Iterator[tuple[ContactBody, ContactBody, Floats]]:
        """Yield each pair of bodies in contact, except with the floor, and the point of contact, [2] m, world frame."""
        geoms = self.data.contact.geom
        if not any(geoms[:, 0].tolist()):  # all contacts are with the floor, geom 0, which comes first in a pair
            return
        for contact, pair in enumerate(geoms.tolist()):
            first, second = (self._bodies[geom] for geom in pair)
            if BodyKind.FLOOR not in {first.kind, second.kind} and first != second:
                yield first, second, self.data.contact.pos[contact, :2].copy()

    def hold(self, box: int) -> None:
        """Weld a box to the robot where it is now."""
        robot, load = self.data.body("robot/base_footprint"), self.data.body(f"box {box}")
        inverse, offset, rotation = np.empty(4), np.empty(3), np.empty(4)
        mujoco.mju_negQuat(inverse, robot.xquat)
        mujoco.mju_rotVecQuat(offset, load.xpos - robot.xpos, inverse)
        mujoco.mju_mulQuat(rotation, inverse, load.xquat)
        latch = self.model.equality(f"latch {box}").id
        # A weld's data: anchor in the box frame, the anchor in the robot frame, the box's rotation in the robot frame.
        self.model.eq_data[latch, :10] = np.concatenate([np.zeros(3), offset, rotation])
        self.data.eq_active[latch] = 1

    def release(self, box: int) -> None:
        """Release a box from the weld."""
        self.data.eq_active[self.model.equality(f"latch {box}").id] = 0

    def take_in(self, box: int) -> None:
        """Let a box sink through the floor without contacts, in place of a conveyor that takes it away."""
        geom = self.model.geom(f"box {box}").id
        self.model.geom_contype[geom] = self.model.geom_conaffinity[geom] = 0
        body = self.model.body(f"box {box}").id
        self.data.xfrc_applied[body, 2] = BOX_MASS * -self.model.opt.gravity[2]
        self._set_velocity(box, -INTAKE_SPEED)
        self._sinking.append(box)

    def place_robot(self, pose: Pose, load: int | None) -> None:
        """Place the robot and its load at rest, the robot at a pose in the world frame.

        Args:
            pose: base_link in the world frame.
            load: Index of the box that the latch holds; None for none.
        """
        before = self.robot_pose
        for start in [self._base] if load is None else [self._base, self._boxes[load]]:
            moved = pose @ before.inverse @ self._pose(start)
            self.data.qpos[start : start + 2] = moved.x, moved.y
            self.data.qpos[start + 3 : start + 7] = [math.cos(moved.theta / 2), 0, 0, math.sin(moved.theta / 2)]
        self.data.qvel[:] = 0
        mujoco.mj_forward(self.model, self.data)

    def set_wheel_friction(self, friction: float) -> None:
        """Set the friction coefficient of the wheels."""
        for side in ("left", "right"):
            self.model.geom_friction[self.model.geom(f"robot/{side}_wheel").id, 0] = friction

    def _pose(self, start: int) -> Pose:
        """Pose of the free body whose coordinates begin at qpos[start], world frame, projected onto the floor."""
        x, y, _, w, i, j, k = self.data.qpos[start : start + 7].tolist()
        return Pose(x, y, math.atan2(2 * (w * k + i * j), 1 - 2 * (j * j + k * k)))

    def _set_velocity(self, box: int, upwards: float) -> None:
        """Set a box's linear velocity to a vertical one, m/s, and its angular velocity to zero."""
        start = self.model.jnt_dofadr[self.model.body(f"box {box}").jntadr[0]]
        self.data.qvel[start : start + 6] = [0, 0, upwards, 0, 0, 0]

    def _stop_sunk_boxes(self) -> None:
        """Stop the sinking boxes that are entirely below the floor."""
        for box in [box for box in self._sinking if self.data.qpos[self._boxes[box] + 2] < -BOX_HEIGHT]:
            self._set_velocity(box, 0.0)
            self._sinking.remove(box)


def _qpos_address(model: mujoco.MjModel, body: str) -> int:
    """Index in qpos of a free body's seven coordinates: x, y, z, m, and a quaternion w, x, y, z."""
    return int(model.jnt_qposadr[model.body(body).jntadr[0]])


def _contact_body(model: mujoco.MjModel, geom: int) -> ContactBody:
    """The body that a geom belongs to; the whole robot counts as one body."""
    name = model.geom(geom).name
    if name.startswith("robot/"):
        return ContactBody(BodyKind.ROBOT)
    kind, *numbers = name.split()
    return ContactBody(BodyKind(kind), int(numbers[0]) if numbers else 0)
