"""Localization of a recorded log on a map, with errors against a reference trajectory if there is one."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from wherry.errors import InputError
from wherry.files import ensure_writable_folder, write_atomically
from wherry.localization.drive_fit import DriveFit, DrivenScan, fits_map
from wherry.localization.fit import MapFit
from wherry.localization.localizer import Localization, Localizer
from wherry.localization.parameter_files import LoadedParameters, load_parameters
from wherry.localization.parameters import (
    GLOBAL_MAX_PARTICLES,
    GLOBAL_PARAMETERS,
    KNOWN_START_COVARIANCE,
    LOG_PARAMETERS,
    LOST_PROBABILITY_THRESHOLD,
    AmclParameters,
)
from wherry.logs.lidar_log import LidarLog
from wherry.logs.options import DEFAULT_READING, ReadingOptions
from wherry.logs.timestamps import increasing_times
from wherry.mapping.graph_slam import GraphSlam
from wherry.mapping.saved_graph import load_graph
from wherry.pipelines.logs.files import check_trajectory_format, save_trajectories
from wherry.pipelines.logs.pictures import draw_localization
from wherry.pipelines.logs.reading import read_recording
from wherry.pipelines.logs.reference import Reference, ReferenceErrors, read_reference
from wherry.pipelines.logs.start_poses import Start, choose_start
from wherry.pipelines.logs.verdicts import AlternativePose, alternative_poses, localization_verdict, lost_probability
from wherry.robot import Odometry
from wherry.space.map_files import load_map
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats
from wherry.space.trajectory import Trajectory
from wherry.space.wean_map import load_wean_map
from wherry.wording import verb_for

MIN_ODOMETRY_SHARE = 0.1  # fraction of the scans that must have odometry
CSV_HEADER = "time,x,y,theta,lost_probability,fit"


@dataclass(frozen=True, slots=True)
class LocalizationSettings:
    """Inputs of a localization run.

    Attributes:
        log: Path of a lidar log (see `logs.read_log`) or of a bag (see `ros.bags.reading.read_bag`).
        map_file: Path of a map.yaml, of a pose graph saved by mapping, or of a wean.dat.
        params: Path of a parameter file of amcl; None for `GLOBAL_PARAMETERS` if the start is global and
            `LOG_PARAMETERS` otherwise.
        reference: Path of the reference trajectory (see `logs.read_odometry`); None if there is none.
        is_global: Whether the robot starts without an initial pose; otherwise see `start_poses.choose_start`.
        seed: Seed of all randomness.
        reading: How the log is read.
        trajectory_format: Format of a trajectory file in addition to trajectory.tum, a key of `TRAJECTORY_FORMATS`.
    """

    log: Path
    map_file: Path
    params: Path | None = None
    reference: Path | None = None
    is_global: bool = False
    seed: int = 0
    reading: ReadingOptions = DEFAULT_READING
    trajectory_format: str = "tum"


@dataclass(frozen=True, slots=True)
class LocalizationResult(ReferenceErrors):
    """Metrics of a localization run; those of `ReferenceErrors` are None without a reference.

    Attributes:
        verdict: Whether the scans fit the map and the robot knows where it is, in a sentence.
        fits_map: Whether the scans fit the map.
        fit: How well the scans fit the map at the estimated poses, 0 to 1; see `localization.fit.MapFit`.
        map_coverage: Fraction of the beams that end where the map is known, 0 to 1.
        map_probability: Probability that the map is right, by the drive as a whole, 0 to 1; see
            `localization.drive_fit.DriveFit`.
        consistent_m: Longest stretch of the drive over which the estimate moved as odometry says and the scans fit the
            map, m.
        lost_probability: Probability at the last scan that the robot is not at the final pose, 0 to 1, which includes
            the doubt about the map; 1 if the scans do not fit it.
        alternative_poses: Other poses at the last scan that the whole run fits, the most probable first.
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

    verdict: str = ""
    fits_map: bool = False
    fit: float = 0.0
    map_coverage: float = 0.0
    map_probability: float = 0.0
    consistent_m: float = 0.0
    lost_probability: float = 1.0
    alternative_poses: tuple[AlternativePose, ...] = ()
    lost_fraction: float = 1.0
    final_pose: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ms_per_update_median: float = 0.0
    particles_mean: float = 0.0
    scans: int = 0
    relocalizations: int = 0
    skipped: int = 0
    unknown_parameters: tuple[str, ...] = ()
    seed: int = 0

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
        InputError: Log, map, parameters or reference cannot be used, or hardly any scan has odometry.
    """
    check_trajectory_format(settings.trajectory_format)
    loaded = None if settings.params is None else load_parameters(settings.params)
    grid = load_any_map(settings.map_file)
    if log is None:
        log = read_recording(settings.log, settings.reading)
    log = with_odometry(log, settings.log)
    times = np.array([scan.time for scan in log.scans])
    reference = None if settings.reference is None else read_reference(settings.reference, times)
    given = None if loaded is None else loaded.parameters
    start = choose_start(log, grid, given, reference, is_global=settings.is_global)
    parameters = given or (GLOBAL_PARAMETERS if start.pose is None else LOG_PARAMETERS)
    localizer = _localizer(grid, log, parameters, start, settings.seed)
    loaded_notes, reference_notes = loaded.notes if loaded else (), reference.notes if reference else ()
    log = replace(log, notes=(*log.notes, *loaded_notes, *reference_notes, *start.notes))
    return LocalizationRun(settings, grid, log, reference, localizer, is_global=start.pose is None, loaded=loaded)


def _localizer(grid: OccupancyGrid, log: LidarLog, parameters: AmclParameters, start: Start, seed: int) -> Localizer:
    """The localizer, initialized at the start pose, or on the whole map."""
    if start.pose is None:
        parameters = replace(parameters, max_particles=max(parameters.max_particles, GLOBAL_MAX_PARTICLES))
    localizer = Localizer(grid, log.lidar, parameters, np.random.default_rng(seed))
    if start.pose is None:
        localizer.initialize_globally()
    elif start.is_from_reference:
        localizer.initialize(start.pose, KNOWN_START_COVARIANCE)
    return localizer


def with_odometry(log: LidarLog, source: Path) -> LidarLog:
    """The log without the scans that have no odometry, which a note states.

    Args:
        log: The log.
        source: Path of the log, for the error.

    Raises:
        InputError: Hardly any scan has odometry.
    """
    covered = [index for index, odometry in enumerate(log.scan_odometry) if odometry is not None]
    total, missing = len(log.scans), len(log.scans) - len(covered)
    if len(covered) < max(1.0, MIN_ODOMETRY_SHARE * total):
        has = f"has odometry for only {len(covered):,} of {total:,} scans" if covered else "has no odometry"
        raise InputError(source, "", f"{has}, which localization needs; wherry map can do without")
    if not missing:
        return log
    first = next(index for index, odometry in enumerate(log.scan_odometry) if odometry is None)
    at = log.scans[first].time - log.scans[0].time
    are_left_out = verb_for(missing, "has no odometry and is", "have no odometry and are")
    note = f"{missing:,} of {total:,} scans {are_left_out} left out, the first at {at:.1f} s."
    return replace(
        log,
        scans=tuple(log.scans[index] for index in covered),
        scan_odometry=tuple(log.scan_odometry[index] for index in covered),
        notes=(*log.notes, note),
    )


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
        log: The scans, all with odometry.
        reference: The reference trajectory; None if there is none.
        localizer: The localizer, already initialized.
        is_global: Whether the localizer searches the whole map for the start.
        loaded: Content of the parameter file; None if there is none.

    Attributes:
        grid: The map.
        log: The scans, all with odometry; its notes include those on parameters and start pose.
        localizer: The localizer in its state after the last localized scan.
        localized: The scans that have been localized.
    """

    def __init__(
        self,
        settings: LocalizationSettings,
        grid: OccupancyGrid,
        log: LidarLog,
        reference: Reference | None,
        localizer: Localizer,
        *,
        is_global: bool,
        loaded: LoadedParameters | None = None,
    ) -> None:
        self._settings = settings
        self.grid = grid
        self.log = log
        self._odometry = odometry_of_scans(log, settings.log)
        self._reference = reference
        self._is_global = is_global
        self._unknown = loaded.unknown if loaded else ()
        self.localizer = localizer
        self.localized: list[LocalizedScan] = []

    def __len__(self) -> int:
        """Number of scans of the log."""
        return len(self.log.scans)

    def steps(self) -> Iterator[LocalizedScan]:
        """Localize scan by scan, yielding each after it was localized."""
        times = increasing_times(np.array([scan.time for scan in self.log.scans])).tolist()
        for index, (scan_time, odometry) in enumerate(zip(times, self._odometry, strict=True)):
            scan = self.log.deskewed(index)
            before = time.perf_counter()
            localization = self.localizer.update(replace(odometry, time=scan_time), replace(scan, time=scan_time))
            self.localized.append(LocalizedScan(index, localization, time.perf_counter() - before))
            yield self.localized[-1]

    @property
    def trajectory(self) -> Trajectory:
        """Estimated poses of base_link at the localized scans, map frame."""
        poses = np.array([scan.localization.pose.as_array() for scan in self.localized]).reshape(-1, 3)
        return Trajectory(np.array([scan.time for scan in self.log.scans[: len(poses)]]), poses)

    @property
    def lost_probabilities(self) -> Floats:
        """[N] probability at each localized scan that the robot is not at the estimated pose, 0 to 1."""
        return np.array([scan.localization.lost_probability for scan in self.localized])

    @property
    def drive_fit(self) -> DriveFit:
        """How well the localized scans, of which there must be at least one, fit the map as a whole."""
        return DriveFit.of(
            [
                DrivenScan(odometry.pose, scan.localization.pose, scan.localization.agreement)
                for odometry, scan in zip(self._odometry, self.localized, strict=False)
                if not scan.localization.estimate.problem
            ]
        )

    def result(self) -> LocalizationResult:
        """Metrics of the localized scans, of which there must be at least one.

        Raises:
            InputError: The reference has no pose at the time of any localized scan.
        """
        errors = ReferenceErrors() if self._reference is None else self._reference.errors(self.trajectory.poses)
        localizations = [scan.localization for scan in self.localized]
        updates = [scan.seconds for scan in self.localized if scan.localization.estimate.is_updated]
        last, drive = localizations[-1], self.drive_fit
        x, y, theta = last.pose.as_array().tolist()
        return LocalizationResult(
            **asdict(errors),
            verdict=localization_verdict(drive, last, is_global=self._is_global),
            fits_map=fits_map(drive),
            fit=drive.fit.value,
            map_coverage=drive.fit.coverage,
            map_probability=drive.map_probability,
            consistent_m=drive.longest,
            lost_probability=lost_probability(drive, last),
            alternative_poses=alternative_poses(last),
            lost_fraction=float(np.mean(self.lost_probabilities > LOST_PROBABILITY_THRESHOLD)),
            final_pose=(x, y, theta),
            ms_per_update_median=1e3 * float(np.median(updates)) if updates else 0.0,
            particles_mean=float(np.mean([localization.estimate.particle_count for localization in localizations])),
            scans=len(localizations),
            relocalizations=sum(bool(localization.hypotheses) for localization in localizations[1:]),
            skipped=len(self.log.skipped),
            unknown_parameters=self._unknown,
            seed=self._settings.seed,
        )

    def as_csv(self) -> str:
        """The poses [s, m, m, rad, map frame], probabilities of being lost and fits of the scans, one per line."""
        rows = [CSV_HEADER]
        for time_of_scan, pose, scan in zip(self.trajectory.times, self.trajectory.poses, self.localized, strict=True):
            localization = scan.localization
            fit = MapFit().with_scan(localization.agreement).value
            x, y, theta = pose
            rows.append(f"{time_of_scan:.6f},{x:.6f},{y:.6f},{theta:.6f},{localization.lost_probability:.6f},{fit:.6f}")
        return "\n".join(rows) + "\n"

    def save(self, folder: Path) -> list[Path]:
        """Write the trajectory, localization.csv and localization.png.

        Raises:
            InputError: The folder cannot be written to.
        """
        ensure_writable_folder(folder)
        trajectories = save_trajectories(self.trajectory, folder, self._settings.trajectory_format)
        write_atomically(folder / "localization.csv", self.as_csv())
        write_atomically(folder / "localization.png", self.picture())
        return [*trajectories, folder / "localization.csv", folder / "localization.png"]

    def picture(self) -> bytes:
        """A PNG of the map, the last particles, and the trajectory, which is red where the robot was reported lost."""
        is_lost = (self.lost_probabilities > LOST_PROBABILITY_THRESHOLD).tolist()
        return draw_localization(self.grid, self.trajectory.poses, is_lost, self.localizer.particles)
