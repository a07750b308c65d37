"""The SLAM methods by name."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass
from types import MappingProxyType

import numpy as np

from wherry.mapping.graph_slam import GraphSlam
from wherry.mapping.particle_slam import ParticleSlam
from wherry.mapping.pose_graph import optimized
from wherry.mapping.settings import GraphSlamSettings, ParticleSlamSettings, SlamSettings
from wherry.mapping.slam import Slam
from wherry.robot import Odometry, Scan
from wherry.space.pose import Pose

Measurements = Iterable[tuple[Scan, Odometry | None]]


@dataclass(frozen=True, slots=True)
class SlamMethod:
    """A SLAM method that can be chosen by name.

    Attributes:
        create: Creates the method from the lidar's pose, a source of randomness, and the settings.
        compile_kernels: Compiles all kernels by mapping a few measurements with the lidar at the given pose.
        can_continue: Whether the method can continue the map of a saved pose graph.
    """

    create: Callable[[Pose, np.random.Generator, SlamSettings], Slam]
    compile_kernels: Callable[[Pose, Measurements], None]
    can_continue: bool = False


def _create_graph_slam(lidar: Pose, rng: np.random.Generator, settings: SlamSettings) -> GraphSlam:
    """Graph SLAM, which uses no randomness."""
    del rng
    return GraphSlam(lidar, GraphSlamSettings(**asdict(settings)))


def _compile_graph_slam(lidar: Pose, measurements: Measurements) -> None:
    """Map with short submaps and frequent searches, so that loop closing and optimization are compiled too."""
    slam = GraphSlam(lidar, GraphSlamSettings(submap_scans=4, closure_every=1))
    _map(slam, measurements)
    optimized(slam.pose_graph)


def _create_particle_slam(lidar: Pose, rng: np.random.Generator, settings: SlamSettings) -> ParticleSlam:
    """Particle SLAM."""
    return ParticleSlam(lidar, rng, ParticleSlamSettings(**asdict(settings)))


def _compile_particle_slam(lidar: Pose, measurements: Measurements) -> None:
    """Map with the default settings."""
    _map(ParticleSlam(lidar, np.random.default_rng(0)), measurements)


def _map(slam: Slam, measurements: Measurements) -> None:
    """Map all measurements, and render the map."""
    for scan, odometry in measurements:
        slam.add(scan, odometry)
    slam.grid()


SLAM_METHODS: Mapping[str, SlamMethod] = MappingProxyType(
    {
        "graph": SlamMethod(_create_graph_slam, _compile_graph_slam, can_continue=True),
        "particles": SlamMethod(_create_particle_slam, _compile_particle_slam),
    }
)
