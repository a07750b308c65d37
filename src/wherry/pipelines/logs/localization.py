"""Localization of a recorded log on a map, with errors against a reference trajectory if there is one."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from wherry.errors import InputError
from wherry.evaluation import position_errors, root_mean_square
from wherry.files import ensure_writable_folder, write_atomically
from wherry.localization.localizer import Localization, Localizer
from wherry.localization.parameter_files import load_parameters
from wherry.localization.parameters import (
    GLOBAL_MAX_PARTICLES,
    GLOBAL_PARAMETERS,
    KNOWN_START_COVARIANCE,
    LOG_PARAMETERS,
    LOST_PROBABILITY_THRESHOLD,
)
from wherry.logs.lidar_log import LidarLog
from wherry.logs.options import ReadingOptions
from wherry.logs.tables import read_odometry
from wherry.logs.timestamps import increasing_times
from wherry.mapping.graph_slam import GraphSlam
from wherry.mapping.saved_graph import load_graph
from wherry.pipelines.logs.reading import read_recording
from wherry.robot import Odometry
from wherry.space.map_files import load_map
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import IDENTITY, Floats, Pose
from wherry.space.trajectory import Trajectory, save_tum
from wherry.space.wean_map import load_wean_map
from wherry.views.map_picture import MapPicture

TRAJECTORY_COLOUR = (30, 150, 60)
LOST_COLOUR = (230, 60, 60)
PARTICLE_COLOUR = (220, 40, 40)


@dataclass(frozen=True, slots=True)
class LocalizationSettings:
    """Inputs of a localization run.

    Attributes:
        log: Path of a lidar log (see `logs.read_log`) or of a bag (see `ros.bags.reading.read_bag`).
        map_file: Path of a map.yaml, of a pose graph saved by mapping, or of a wean.dat.
        params: Path of a parameter file of amcl; None for `GLOBAL_PARAMETERS` if the start is global and
            `LOG_PARAMETERS` otherwise.
        reference: Path of the reference trajectory (see `logs.read_odometry`); None if there is none.
        is_global: Whether the robot starts without an initial pose. Otherwise the initial pose is that of ``params``,
            else that of the reference at the first scan, else the origin of the map frame.
        seed: Seed of all randomness.
        lenient: Whether to skip broken lines or messages of the log.
    """

    log: Path
    map_file: Path
    params: Path | None = None
    reference: Path | None = None
    is_global: bool = False
    seed: int = 0
    lenient: bool = False


@dataclass(frozen=True, slots=True)
class LocalizationResult:
    """Metrics of a localization run.

    Attributes:
        rmse_m: Root mean square distance to the reference, m; None without a reference.
        median_m: Median distance to the reference, m; None without a reference.
        p99_m: 99th percentile of the distances to the reference, m; None without a reference.
        lost_fraction: Fraction of the scans at which the robot was reported lost.
        final_pose: Last estimated pose of base_link, x m, y m, θ rad, map frame.
        ms_per_update_median: Median time of a filter update, ms.
        particles_mean: Mean number of particles over the scans.
        scans: Number of scans.
        relocalizations: Number of relocalizations after the start.
        skipped: Number of broken lines or messages of the log that were skipped.
        unknown_parameters: Keys of the parameter file that are no parameters of amcl.
        seed: Seed of all randomness.
    """

    rmse_m: float | None
    median_m: float | None
    p99_m: float | None
    lost_fraction: float
    final_pose: tuple[float, float, float]
    ms_per_update_median: float
    particles_mean: float
    scans: int
    relocalizations: int
    skipped: int
    unknown_parameters: tuple[str, ...]
    seed: int

    def as_dict(self) -> dict[str, object]:
        """The metrics by name, for JSON."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class LocalizedScan:
    """A scan of the log with its localization.

    Attributes:
        index: Index of the scan in the log.
        localization: Estimated pose and its reliability.
        seconds: Wall-clock time of the computation, s.
    """

    index: int
    localization: Localization
    seconds: float


def prepare(settings: LocalizationSettings, log: LidarLog | None = None) -> LocalizationRun:
    """Read and check the inputs, and initialize the localizer.

    Args:
        settings: Inputs of the run.
        log: Content of the log file if it was read already; None to read it.

    Raises:
        InputError: Log, map, parameters or reference cannot be used, or the log has scans without odometry.
    """
    loaded = None if settings.params is None else load_parameters(settings.params)
    defaults = GLOBAL_PARAMETERS if settings.is_global else LOG_PARAMETERS
    parameters = defaults if loaded is None else loaded.parameters
    grid = load_any_map(settings.map_file)
    if log is None:
        log = read_recording(settings.log, ReadingOptions(settings.lenient))
    odometry = odometry_of_scans(log, settings.log)
    reference = None if settings.reference is None else read_odometry(settings.reference)
    if settings.is_global:
        parameters = replace(parameters, max_particles=max(parameters.max_particles, GLOBAL_MAX_PARTICLES))
    localizer = Localizer(grid, log.lidar, parameters, np.random.default_rng(settings.seed))
    if settings.is_global:
        localizer.initialize_globally()
    elif reference is not None and not parameters.set_initial_pose:
        start = reference.at(np.array([log.scans[0].time]))[0]
        localizer.initialize(Pose.from_array(start), KNOWN_START_COVARIANCE)
    unknown = () if loaded is None else loaded.unknown
    return LocalizationRun(settings, grid, log, odometry, reference, localizer, unknown)


def odometry_of_scans(log: LidarLog, source: Path) -> list[Odometry]:
    """The odometry at every scan of a log.

    Args:
        log: The log.
        source: Path of the log, for the error message.

    Raises:
        InputError: A scan has no odometry.
    """
    odometry = [reading for reading in log.scan_odometry if reading is not None]
    if len(odometry) < len(log.scans):
        raise InputError(source, "", "has scans without odometry, which localization needs")
    return odometry


def load_any_map(path: Path) -> OccupancyGrid:
    """Read a map from a map.yaml, a saved pose graph (.npz) or a wean.dat, recognized by the file name.

    Raises:
        InputError: The file cannot be read, or is not a map in the format of its name.
    """
    if path.name.removesuffix(".gz").endswith(".dat"):
        return load_wean_map(path)
    if path.suffix == ".npz":
        return GraphSlam.from_snapshot(load_graph(path)).grid()
    return load_map(path)


class LocalizationRun:
    """Localization on a log: iterate over `steps`, then ask for the `result`.

    Args:
        settings: Inputs of the run.
        grid: The map.
        log: The scans.
        odometry: [N] odometry at the scans.
        reference: The reference trajectory; None if there is none.
        localizer: The localizer, already initialized.
        unknown_parameters: Keys of the parameter file that are no parameters of amcl.

    Attributes:
        grid: The map.
        log: The scans.
        localizer: The localizer in its state after the last localized scan.
        localized: The scans that have been localized.
    """

    def __init__(
        self,
        settings: LocalizationSettings,
        grid: OccupancyGrid,
        log: LidarLog,
        odometry: list[Odometry],
        reference: Trajectory | None,
        localizer: Localizer,
        unknown_parameters: tuple[str, ...] = (),
    ) -> None:
        self._settings = settings
        self.grid = grid
        self.log = log
        self._odometry = odometry
        self._reference = reference
        self._unknown = unknown_parameters
        self.localizer = localizer
        self.localized: list[LocalizedScan] = []

    def __len__(self) -> int:
        """Number of scans of the log."""
        return len(self.log.scans)

    def steps(self) -> Iterator[LocalizedScan]:
        """Localize scan by scan, yielding each after it was localized."""
        times = increasing_times(np.array([scan.time for scan in self.log.scans])).tolist()
        for index, (scan_time, scan, odometry) in enumerate(zip(times, self.log.scans, self._odometry, strict=True)):
            before = time.perf_counter()
            localization = self.localizer.update(replace(odometry, time=scan_time), replace(scan, time=scan_time))
            self.localized.append(LocalizedScan(index, localization, time.perf_counter() - before))
            yield self.localized[-1]

    @property
    def trajectory(self) -> Trajectory:
        """Estimated poses of base_link at the localized scans, map frame."""
        poses = np.array([scan.localization.pose.as_array() for scan in self.localized]).reshape(-1, 3)
        return Trajectory(np.array([scan.time for scan in self.log.scans[: len(poses)]]), poses)

    def result(self) -> LocalizationResult:
        """Metrics of the localized scans, of which there must be at least one.

        Raises:
            InputError: The reference has no pose at the time of any localized scan.
        """
        errors = self._errors()
        localizations = [scan.localization for scan in self.localized]
        is_lost = [localization.lost_probability > LOST_PROBABILITY_THRESHOLD for localization in localizations]
        updates = [scan.seconds for scan in self.localized if scan.localization.estimate.is_updated]
        x, y, theta = localizations[-1].pose.as_array().tolist()
        return LocalizationResult(
            rmse_m=None if errors is None else root_mean_square(errors),
            median_m=None if errors is None else float(np.median(errors)),
            p99_m=None if errors is None else float(np.quantile(errors, 0.99)),
            lost_fraction=float(np.mean(is_lost)),
            final_pose=(x, y, theta),
            ms_per_update_median=1e3 * float(np.median(updates)) if updates else 0.0,
            particles_mean=float(np.mean([localization.estimate.particle_count for localization in localizations])),
            scans=len(localizations),
            relocalizations=sum(bool(localization.hypotheses) for localization in localizations[1:]),
            skipped=len(self.log.skipped),
            unknown_parameters=self._unknown,
            seed=self._settings.seed,
        )

    def _errors(self) -> Floats | None:
        """[N] m, distances to the reference at the localized scans within its time; None without a reference."""
        if self._reference is None:
            return None
        trajectory = self.trajectory
        inside = (trajectory.times >= self._reference.times[0]) & (trajectory.times <= self._reference.times[-1])
        if not inside.any():
            raise InputError(self._settings.reference or "", "", "has no pose at the time of any scan of the log")
        reference = self._reference.at(trajectory.times[inside])
        return position_errors(trajectory.poses[inside], reference, alignment=IDENTITY)

    def save(self, folder: Path) -> list[Path]:
        """Write trajectory.tum and localization.png.

        Raises:
            InputError: The folder cannot be written to.
        """
        ensure_writable_folder(folder)
        save_tum(self.trajectory, folder / "trajectory.tum")
        write_atomically(folder / "localization.png", self.picture())
        return [folder / "trajectory.tum", folder / "localization.png"]

    def picture(self) -> bytes:
        """A PNG of the map, the last particles, and the trajectory, which is red where the robot was reported lost."""
        picture = MapPicture(self.grid)
        picture.points(self.localizer.particles[:, :2], PARTICLE_COLOUR)
        path = self.trajectory.poses[:, :2]
        for index, scan in enumerate(self.localized[1:]):
            is_lost = scan.localization.lost_probability > LOST_PROBABILITY_THRESHOLD
            picture.line(path[index : index + 2], LOST_COLOUR if is_lost else TRAJECTORY_COLOUR, width=2)
        return picture.png()
