"""The MuJoCo model of a floor plan with the robot of the URDF in it (paper, sections 1 and 3, Fig. 1b)."""

from __future__ import annotations

from importlib import resources

import mujoco
import numpy as np

from wherry.floorplan.plan import FloorPlan
from wherry.robot import BOX_HEIGHT, Body
from wherry.simulation.drive import WHEEL_RADIUS
from wherry.simulation.static_geometry import OBSTACLE, WALL, StaticGeometry
from wherry.space.pose import Floats, Pose

TIMESTEP = 0.005  # s, of the physics
WALL_HEIGHT = 0.5  # m
LIDAR_HEIGHT = 0.20  # m above the floor
LASER_HEIGHT = round(LIDAR_HEIGHT - WHEEL_RADIUS, 6)  # m from base_link up to the laser frame, as in the URDF
BOX_RADIUS = 0.10  # m
BOX_MASS = 1.5  # kg
WHEEL_FRICTION = 1.0  # friction coefficient of a rubber wheel on the floor
FLOOR_FRICTION = 0.3  # friction coefficient of a box on the floor
MOTOR_GAIN = 1.0  # N·m per rad/s of error of a wheel's speed
MAX_MOTOR_TORQUE = 2.0  # N·m
MAX_PICTURE_WIDTH, MAX_PICTURE_HEIGHT = 1920, 1080  # pixels
COLOURS = {  # RGBA, 0 to 1
    "floor": (0.72, 0.71, 0.68, 1),
    "wall": (0.33, 0.38, 0.46, 1),
    "obstacle": (0.50, 0.42, 0.34, 1),
    "warehouse": (0.30, 0.62, 0.38, 1),
}
HIDDEN_GROUP = 3  # geom group of the robot's collision shapes, which are not rendered
BOX_COLOUR = (0.75, 0.18, 0.15, 1)

BODY = Body(
    radius=0.20,
    lidar=Pose(-0.17, 0.0, 0.0),
    box_radius=BOX_RADIUS,
    max_linear=0.6,
    max_angular=2.5,
    max_linear_acceleration=1.0,
    max_angular_acceleration=5.0,
)


def robot_urdf() -> str:
    """The robot's URDF, which RViz and Gazebo use too."""
    return (resources.files("wherry.simulation") / "robot.urdf").read_text(encoding="utf-8")


def build_model(plan: FloorPlan, geometry: StaticGeometry, robot: Pose, boxes: Floats) -> mujoco.MjModel:
    """Build the MuJoCo model of a world.

    The floor is a plane, walls and obstacles are fixed cuboids, and the boxes to deliver are free bodies. Names:
    ``floor``, ``wall <k>``, ``obstacle <k>``, ``box <k>`` (body and geom), ``latch <k>`` (an inactive weld), and the
    names of the URDF's links and joints prefixed with ``robot/``.

    Args:
        plan: The building.
        geometry: Its walls and obstacles.
        robot: Initial pose of base_footprint, world frame.
        boxes: [B, 2] initial centres of the boxes, m, world frame.
    """
    spec = mujoco.MjSpec()
    spec.modelname = "wherry"
    spec.visual.global_.offwidth, spec.visual.global_.offheight = MAX_PICTURE_WIDTH, MAX_PICTURE_HEIGHT
    _configure_solver(spec)
    _add_building(spec, plan, geometry)
    _add_robot(spec, robot)
    for index, (x, y) in enumerate(boxes):
        _add_box(spec, index, float(x), float(y))
    return spec.compile()


def _configure_solver(spec: mujoco.MjSpec) -> None:
    """Set integrator, contact model and sleeping.

    With a time step of 5 ms the robot rolls without slip under the discrete integrator; under the implicit one it moves
    2 % farther than its wheels turn. Boxes sleep, which costs no time, until they are touched.
    """
    spec.option.timestep = TIMESTEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10
    spec.option.enableflags |= int(mujoco.mjtEnableBit.mjENBL_SLEEP)


def _add_building(spec: mujoco.MjSpec, plan: FloorPlan, geometry: StaticGeometry) -> None:
    """Add floor, walls, obstacles, the warehouse's floor marking, and light."""
    friction = [FLOOR_FRICTION, 0.005, 0.0001]
    spec.worldbody.add_geom(
        name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], friction=friction, rgba=COLOURS["floor"]
    )
    for name, kind in (("wall", WALL), ("obstacle", OBSTACLE)):
        for index, (left, bottom, right, top) in enumerate(geometry.rectangles(kind)):
            spec.worldbody.add_geom(
                name=f"{name} {index}",
                type=mujoco.mjtGeom.mjGEOM_BOX,
                size=[(right - left) / 2, (top - bottom) / 2, WALL_HEIGHT / 2],
                pos=[(left + right) / 2, (bottom + top) / 2, WALL_HEIGHT / 2],
                rgba=COLOURS[name],
            )
    for cell in sorted(plan.warehouse):
        spec.worldbody.add_geom(
            name=f"warehouse {cell.x} {cell.y}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[plan.cell_size / 2, plan.cell_size / 2, 0.001],
            pos=[*plan.centre(cell), 0],
            contype=0,
            conaffinity=0,
            rgba=COLOURS["warehouse"],
        )
    spec.visual.headlight.ambient, spec.visual.headlight.diffuse = [0.45] * 3, [0.35] * 3
    spec.worldbody.add_light(
        dir=[0.3, 0.5, -1], diffuse=[0.35] * 3, specular=[0] * 3, type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    )


def _add_robot(spec: mujoco.MjSpec, pose: Pose) -> None:
    """Add the robot of the URDF, with motors and with ellipsoidal wheels.

    Cylinders, as in the URDF, would touch the floor along a line and scrub when the robot turns on the spot, so that it
    would turn 9 % less than its wheels. Ellipsoids of the same size touch the floor in one point.
    """
    robot = mujoco.MjSpec.from_string(robot_urdf())
    heading = [np.cos(pose.theta / 2), 0, 0, np.sin(pose.theta / 2)]
    frame = spec.worldbody.add_frame(pos=[pose.x, pose.y, 0], quat=heading)
    body = frame.attach_body(robot.body("base_footprint"), "robot/", "")
    body.add_freejoint()
    body.sleep = mujoco.mjtSleepPolicy.mjSLEEP_NEVER
    for geom in spec.geoms:
        if geom.name.startswith("robot/") and geom.contype:
            geom.group = HIDDEN_GROUP
    for side in ("left", "right"):
        wheel = spec.geom(f"robot/{side}_wheel")
        wheel.type = mujoco.mjtGeom.mjGEOM_ELLIPSOID
        wheel.size = [WHEEL_RADIUS, WHEEL_RADIUS, wheel.size[1]]
        wheel.condim, wheel.priority, wheel.friction = 4, 1, [WHEEL_FRICTION, 0.005, 0.0001]
        joint = f"robot/{side}_wheel_joint"
        motor = spec.add_actuator(name=f"{side}_motor", target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.set_to_velocity(kv=MOTOR_GAIN)
        motor.forcerange = [-MAX_MOTOR_TORQUE, MAX_MOTOR_TORQUE]
    caster = spec.geom("robot/caster")
    caster.condim, caster.priority = 1, 1


def _add_box(spec: mujoco.MjSpec, index: int, x: float, y: float) -> None:
    """Add a sleeping box at x, y, m, world frame, and the inactive weld by which the latch can hold it."""
    body = spec.worldbody.add_body(name=f"box {index}", pos=[x, y, BOX_HEIGHT / 2])
    body.add_freejoint()
    body.sleep = mujoco.mjtSleepPolicy.mjSLEEP_INIT
    body.add_geom(
        name=f"box {index}",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[BOX_RADIUS, BOX_HEIGHT / 2, 0],
        mass=BOX_MASS,
        friction=[FLOOR_FRICTION, 0.005, 0.0001],
        rgba=BOX_COLOUR,
    )
    spec.add_equality(
        name=f"latch {index}",
        type=mujoco.mjtEq.mjEQ_WELD,
        objtype=mujoco.mjtObj.mjOBJ_BODY,
        name1="robot/base_footprint",
        name2=f"box {index}",
        active=False,
    )
