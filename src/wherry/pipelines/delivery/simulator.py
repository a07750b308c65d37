"""The simulated robot as a robot of ROS: a world, real time, and the referee's verdict at the end."""

from __future__ import annotations

from dataclasses import dataclass

from wherry.errors import InputError
from wherry.floorplan.world_files import find_world
from wherry.ros.names import RosNames
from wherry.ros.nodes.simulator import Hardware, SimulatorNode
from wherry.ros.transports.protocol import Transport
from wherry.simulation import Simulation, build
from wherry.simulation.drive import WHEEL_RADIUS
from wherry.simulation.model import LASER_HEIGHT
from wherry.simulation.seeded_worlds import seed_world
from wherry.simulation.simulator import ODOMETRY_RATE

WHEEL_JOINTS = ("left_wheel_joint", "right_wheel_joint")
FASTEST = 20.0  # simulated seconds a second


@dataclass(frozen=True, slots=True)
class Settings:
    """What to simulate.

    Attributes:
        world: A built-in world's name, or a world file.
        boxes: How many; None for what the world says.
        seed: Of everything that is random.
        rate: Simulated seconds a second.
    """

    world: str = "rooms"
    boxes: int | None = None
    seed: int = 0
    rate: float = 1.0


def prepare(settings: Settings) -> Simulation:
    """Build the world; the same settings give the world that ``wherry deliver`` has with them.

    Raises:
        InputError: A setting cannot be used.
    """
    if not 0.0 < settings.rate <= FASTEST:
        raise InputError("--rate", f"{settings.rate}", f"is not above 0 and at most {FASTEST:g}")
    world = seed_world(find_world(settings.world), settings.boxes, settings.seed)
    return build(world.plan, world.physics_rng)


def node_of(simulation: Simulation, transport: Transport, names: RosNames, rate: float) -> SimulatorNode:
    """The simulation's robot as a robot of ROS."""
    hardware = Hardware(
        period=1 / ODOMETRY_RATE,
        scan_period=1 / simulation.lidar.specification.rate,
        base_height=WHEEL_RADIUS,
        laser_height=LASER_HEIGHT,
        wheel_joints=WHEEL_JOINTS,
        wheel_angles=lambda: simulation.physics.wheel_angles,
    )
    return SimulatorNode(simulation, hardware, transport, names, rate=rate)


def verdict(simulation: Simulation) -> dict[str, int | float]:
    """What the referee saw."""
    referee = simulation.referee
    return {
        "sim_seconds": simulation.time,
        "boxes": len(simulation.plan.boxes),
        "delivered": referee.delivered,
        "collisions": len(referee.collisions),
    }
