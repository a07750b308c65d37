"""A world without hardware: floor plans become MuJoCo models with a `Robot` in them (paper, sections 1 and 3)."""

from wherry.simulation.referee import BoxPlace, BoxTruth, Collision, Referee
from wherry.simulation.simulator import Simulation, build

__all__ = ["BoxPlace", "BoxTruth", "Collision", "Referee", "Simulation", "build"]
