"""The SLAM methods that there are, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from wherry.mapping.graph_slam import GraphSlam, GraphSlamSettings
from wherry.mapping.particle_slam import ParticleSlam, ParticleSlamSettings
from wherry.space.pose import Pose


@dataclass(frozen=True, slots=True)
class MapSettings:
    """What every method has in common.

    Attributes:
        resolution: m, a grid cell's side.
        range_limit: m, readings beyond it are not used.
        empty_range: m, how far a beam that met nothing is believed to be free; 0 if a lidar loses dark surfaces.
    """

    resolution: float = 0.05
    range_limit: float = 30.0
    empty_range: float = 10.0


def _graph(lidar: Pose, rng: np.random.Generator, common: MapSettings) -> GraphSlam:
    """Graph SLAM; it draws no random numbers."""
    del rng
    settings = GraphSlamSettings(
        resolution=common.resolution, range_limit=common.range_limit, empty_range=common.empty_range
    )
    return GraphSlam(lidar, settings)


def _particles(lidar: Pose, rng: np.random.Generator, common: MapSettings) -> ParticleSlam:
    """Rao–Blackwellized particles."""
    settings = ParticleSlamSettings(
        resolution=common.resolution, range_limit=common.range_limit, empty_range=common.empty_range
    )
    return ParticleSlam(lidar, rng, settings)


BACKENDS: Mapping[str, Callable[[Pose, np.random.Generator, MapSettings], GraphSlam | ParticleSlam]] = MappingProxyType(
    {"graph": _graph, "particles": _particles}
)
