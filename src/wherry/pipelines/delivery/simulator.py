"""The simulated robot as a ROS robot: its settings, its world, and the referee's counts."""

from __future__ import annotations

from dataclasses import dataclass

from wherry.errors import InputError
from wherry.floorplan.world_files import find_world
from wherry.simulation import Simulation, build
from wherry.simulation.seeded_worlds import seed_world

MAX_RATE = 20.0  # simulated seconds per second


@dataclass(frozen=True, slots=True)
class SimulatorSettings:
    """Settings of a simulated ROS robot.

    Attributes:
        world: Name of a built-in world, or path of a world file.
        boxes: Number of boxes; None for the world's own.
        seed: Seed of all randomness.
        rate: Simulated seconds per second.
    """

    world: str = "rooms"
    boxes: int | None = None
    seed: int = 0
    rate: float = 1.0


def build_simulation(settings: SimulatorSettings) -> Simulation:
    """Build the world that ``wherry deliver`` builds with the same settings.

    Raises:
        InputError: A setting is not valid.
    """
    if not 0.0 < settings.rate <= MAX_RATE:
        raise InputError("--rate", f"{settings.rate}", f"is not above 0 and at most {MAX_RATE:g}")
    world = seed_world(find_world(settings.world), settings.boxes, settings.seed)
    return build(world.plan, world.physics_rng)


def referee_summary(simulation: Simulation) -> dict[str, int | float]:
    """Simulated time, s, and the referee's counts of boxes and collisions so far."""
    referee = simulation.referee
    return {
        "sim_seconds": simulation.time,
        "boxes": len(simulation.plan.boxes),
        "delivered": referee.delivered,
        "collisions": len(referee.collisions),
    }
