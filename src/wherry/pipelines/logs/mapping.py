"""Mapping of a recorded log, scored by true relations if they are given (paper, section 5)."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from wherry.errors import InputError
from wherry.evaluation import RelationErrors, Relations, load_relations, relation_errors
from wherry.files import ensure_writable_folder, remove_files, write_atomically
from wherry.logs.lidar_log import LidarLog
from wherry.logs.mounts import mount_text
from wherry.logs.odometry_files import with_odometry_file
from wherry.logs.options import DEFAULT_READING, LIDAR_HINT, ReadingOptions
from wherry.mapping.graph_slam import GraphSlam
from wherry.mapping.graph_snapshot import GraphSnapshot
from wherry.mapping.loop_closure import LoopClosure
from wherry.mapping.methods import SLAM_METHODS
from wherry.mapping.odometry_check import describe_contradictions
from wherry.mapping.saved_graph import load_graph, save_graph
from wherry.mapping.scan_matching_localizer import ScanMatchingLocalizer, locate_on_map
from wherry.mapping.settings import SlamSettings
from wherry.mapping.slam import Slam
from wherry.pipelines.logs.files import check_trajectory_format, save_trajectories
from wherry.pipelines.logs.map_quality import MapQuality
from wherry.pipelines.logs.pictures import draw_map
from wherry.pipelines.logs.reading import read_recording
from wherry.pipelines.logs.summary import DriveSummary, MapExtent, as_sentences
from wherry.pipelines.logs.trace import NO_PARTICLES
from wherry.robot import Odometry, Scan
from wherry.ros.bags.log_recorder import LogRecorder
from wherry.space.map_files import save_map
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import IDENTITY, Floats, Pose
from wherry.views.verdicts import doubtful_map, finished_map

WARM_UP_SCANS = 30  # scans that are mapped beforehand, so that all kernels are compiled
RELATION_MARGIN = 1.0  # s by which a relation may be outside of a log's time
DEFAULT_RESOLUTION = 0.05  # m, side of a grid cell
EQUAL_DISTANCE, EQUAL_ANGLE = 0.005, math.radians(0.5)  # m and rad, difference up to which two mounts are the same
MIN_RESOLUTION, MAX_RESOLUTION = 0.005, 1.0  # m, sides of a grid cell


@dataclass(frozen=True, slots=True)
class MappingSettings:
    """Settings of the mapping of a log.

    Attributes:
        log: A lidar log, see `wherry.logs.reading.read_log`, or a ROS bag.
        odometry: File with denser odometry (``t x y θ``) to interpolate poses with; None for the log's own.
        relations: File with true relations to score the trajectory by; None for no score.
        backend: The SLAM method, a key of `SLAM_METHODS`.
        out: Folder for map, picture, trajectory and pose graph; None to write nothing.
        seed: Seed of the method's randomness.
        resolution: Side of a grid cell, m.
        reading: How the log is read.
        trajectory_format: Format of a trajectory file in addition to trajectory.tum, a key of `TRAJECTORY_FORMATS`.
        graph: File with a pose graph to continue from; None to begin a new map.
        start: Approximate first pose of base_link on the map of ``graph``, to within 3 m and 45°; None for the pose at
            which mapping ended.
        localize: Whether to localize the robot on the map of ``graph`` without changing it.
    """

    log: Path
    odometry: Path | None = None
    relations: Path | None = None
    backend: str = "graph"
    out: Path | None = None
    seed: int = 0
    resolution: float = DEFAULT_RESOLUTION
    reading: ReadingOptions = DEFAULT_READING
    trajectory_format: str = "tum"
    graph: Path | None = None
    start: Pose | None = None
    localize: bool = False


@dataclass(frozen=True, slots=True)
class MappingResult:
    """Metrics of a mapped log; the errors are None without relations.

    Attributes:
        verdict: What came out of it, in a sentence.
        translational_error_m: Mean translational error of the relations, m.
        translational_sd_m: Standard deviation of the translational error, m.
        rotational_error_deg: Mean absolute rotational error of the relations, degrees.
        rotational_sd_deg: Standard deviation of the absolute rotational error, degrees.
        relations: Number of relations.
        far_translational_error_m: Mean translational error of the relations more than a minute apart, m; None if there
            are none.
        ms_per_scan_median: Median processor time of adding a scan, ms.
        ms_per_scan_p99: 99th percentile of the processor time of adding a scan, ms.
        seconds: Processor time from the first scan to the finished map without compilation, s.
        closures_accepted: Loop closures that were accepted.
        closures_refused: Loop closures that were attempted and rejected.
        scans: Scans that were mapped.
        skipped: Lines of the log that were left out.
        backend: The SLAM method.
        log: The log's file.
        size_m: Width and height of the map's known part, m.
        free_area_m2: Area of the map's free space, m².
        resolution_m: Side of a grid cell, m.
        distance_m: Length of the robot's way, m.
        duration_s: Time from the first scan to the last, s.
        fit: How well the scans fit the map that was made of them, 0 to 1; see `localization.fit.MapFit`.
        is_doubtful: Whether the map is probably wrong, see `MapQuality`.
        notes: What was decided, assumed or left out, and what the map cannot show, as sentences for people.
    """

    verdict: str
    translational_error_m: float | None
    translational_sd_m: float | None
    rotational_error_deg: float | None
    rotational_sd_deg: float | None
    relations: int
    far_translational_error_m: float | None
    ms_per_scan_median: float
    ms_per_scan_p99: float
    seconds: float
    closures_accepted: int
    closures_refused: int
    scans: int
    skipped: int
    backend: str
    log: str
    size_m: tuple[float, float]
    free_area_m2: float
    resolution_m: float
    distance_m: float
    duration_s: float
    fit: float
    is_doubtful: bool
    notes: tuple[str, ...]


AddScan = Callable[[Scan, Odometry | None], Pose]


def prepare(settings: MappingSettings) -> MappingRun:
    """Read and check all input before mapping begins.

    Raises:
        InputError: A file, the method, the resolution or the folder cannot be used, or the log's first scan cannot be
            located on the map of the graph.
    """
    _check(settings)
    log = read_recording(settings.log, settings.reading)
    relations = None if settings.relations is None else _covered_relations(settings.relations, log)
    if settings.odometry is not None:
        log = with_odometry_file(log, settings.odometry)
    if relations is not None:
        log = replace(log, notes=(*log.notes, *relations.notes))
    slam, add_first = _create_slam(settings, log)
    if settings.out is not None:
        ensure_writable_folder(settings.out)
    return MappingRun(settings, log, relations, slam, add_first)


def _check(settings: MappingSettings) -> None:
    """Raise an `InputError` where options do not fit together or are out of range."""
    for option, given in (("--localize", settings.localize), ("--start", settings.start is not None)):
        if given and settings.graph is None:
            raise InputError(option, "", "needs --continue GRAPH, the map on which the log begins")
    if settings.backend not in SLAM_METHODS:
        raise InputError("--backend", settings.backend, f"is none of {', '.join(SLAM_METHODS)}")
    if settings.graph is not None and not SLAM_METHODS[settings.backend].can_continue:
        able = ", ".join(name for name, method in SLAM_METHODS.items() if method.can_continue)
        raise InputError("--backend", settings.backend, f"cannot continue a pose graph; only {able} can")
    if not MIN_RESOLUTION <= settings.resolution <= MAX_RESOLUTION:
        raise InputError("--resolution", str(settings.resolution), "must lie between 0.005 and 1 m")
    check_trajectory_format(settings.trajectory_format)


def _covered_relations(path: Path, log: LidarLog) -> Relations:
    """The relations between times that the log covers."""
    relations = load_relations(path)
    first, last = log.scans[0].time - RELATION_MARGIN, log.scans[-1].time + RELATION_MARGIN
    inside = ((relations.times >= first) & (relations.times <= last)).all(axis=1)
    if not inside.any():
        raise InputError(path, "", f"has no relation within the log's time, {first:.3f} to {last:.3f} s")
    kept = Relations(relations.times[inside], relations.poses[inside], relations.notes)
    total, beyond = len(relations.times), len(relations.times) - len(kept.times)
    if not beyond:
        return kept
    note = f"{beyond:,} of {total:,} relations of {path} are beyond the log's time: they are left out"
    return replace(kept, notes=(*kept.notes, note))


def _create_slam(settings: MappingSettings, log: LidarLog) -> tuple[Slam, AddScan]:
    """The SLAM method, and the function that adds the log's first scan to it."""
    if settings.graph is None:
        method = SLAM_METHODS[settings.backend]
        slam_settings = SlamSettings(resolution=settings.resolution, empty_range=0.0)
        slam = method.create(log.lidar, np.random.default_rng(settings.seed), slam_settings)
        return slam, slam.add
    return _continued_slam(settings.graph, settings, log)


def _continued_slam(path: Path, settings: MappingSettings, log: LidarLog) -> tuple[Slam, AddScan]:
    """As `_create_slam`, on the map of a saved pose graph."""
    snapshot, scan = load_graph(path), log.deskewed(0)
    if snapshot.tracking is not None and scan.time <= snapshot.tracking.time:
        times = f"taken at {scan.time:.3f} s, but the graph ends at {snapshot.tracking.time:.3f} s"
        raise InputError(settings.log, "first scan", f"time runs backwards: {times}")
    _check_continued(snapshot, settings, log)
    slam = GraphSlam.from_snapshot(snapshot)
    start = slam.pose if settings.start is None else settings.start
    first = locate_on_map(slam, scan, start)
    if first is None:
        place = f"({start.x:.2f} m, {start.y:.2f} m, {math.degrees(start.theta):.0f}°)"
        reason = f"matches the map at no pose or at several near {place}; give its approximate pose with --start"
        raise InputError(settings.log, "first scan", reason)
    if settings.localize:
        localizer = ScanMatchingLocalizer(slam, first)
        return localizer, localizer.add
    return slam, lambda scan, odometry: slam.resume(scan, odometry, first)


def _check_continued(snapshot: GraphSnapshot, settings: MappingSettings, log: LidarLog) -> None:
    """Raise an `InputError` if the log's lidar or the resolution differs from that of a saved graph, which is used."""
    difference = log.lidar.relative_to(snapshot.lidar)
    if math.hypot(difference.x, difference.y) > EQUAL_DISTANCE or abs(difference.theta) > EQUAL_ANGLE:
        reason = f"has the lidar at {mount_text(log.lidar)}, but the graph at {mount_text(snapshot.lidar)}"
        raise InputError(settings.log, "lidar", f"{reason}; {LIDAR_HINT}")
    resolution = snapshot.settings.resolution
    if settings.resolution not in (DEFAULT_RESOLUTION, resolution):
        reason = f"cannot be changed by --continue: the graph's is {resolution:g} m"
        raise InputError("--resolution", str(settings.resolution), reason)


class MappingRun:
    """The mapping of one log: iterate `steps`, then read the `result`.

    Args:
        settings: Settings of the run.
        log: The log.
        relations: True relations to score the trajectory by; None for no score.
        slam: The SLAM method.
        add_first: Adds the log's first scan to the method.

    Attributes:
        settings: Settings of the run.
        log: The log.
        slam: The SLAM method.
        pose: base_link at the last scan in the map frame.
        grid: The finished map, set after the last step.
    """

    grid: OccupancyGrid

    def __init__(
        self,
        settings: MappingSettings,
        log: LidarLog,
        relations: Relations | None,
        slam: Slam,
        add_first: AddScan,
    ) -> None:
        self.settings = settings
        self.log = log
        self.slam = slam
        self.pose = IDENTITY
        self._add_first = add_first
        self._relations = relations
        self._result: MappingResult | None = None

    @property
    def scans(self) -> int:
        """Number of scans of the log."""
        return len(self.log.scans)

    @property
    def result(self) -> MappingResult:
        """The metrics.

        Raises:
            RuntimeError: The `steps` are not finished.
        """
        if self._result is None:
            raise RuntimeError("the log is not mapped yet")
        return self._result

    def steps(self) -> Iterator[int]:
        """Yield the number of mapped scans after each one; then finish the map, score it and write the files.

        After 0 is yielded, all kernels are loaded, or compiled on first use, which takes up to half a minute.
        """
        yield 0
        scans = (self.log.deskewed(index) for index in range(self.scans))
        measurements = list(zip(scans, self.log.scan_odometry, strict=True))
        SLAM_METHODS[self.settings.backend].compile_kernels(self.log.lidar, measurements[:WARM_UP_SCANS])
        taken = np.zeros(self.scans)
        for number, (scan, odometry) in enumerate(measurements):
            before = time.process_time()
            add = self._add_first if number == 0 else self.slam.add
            self.pose = add(scan, odometry)
            taken[number] = time.process_time() - before
            yield number + 1
        before = time.process_time()
        self.slam.finish()
        self.grid = self.slam.grid()
        # The time that callers spend between steps does not count.
        seconds = float(taken.sum()) + time.process_time() - before
        self._result = self._scored(taken * 1e3, seconds)
        if self.settings.out is not None:
            self.save(self.settings.out)

    @property
    def poses(self) -> Floats:
        """base_link at the log's scans after all `steps`, [N, 3] m, m, rad, map frame."""
        # Times of scans may repeat, so poses go by their order; those of a continued map begin with earlier logs.
        return self.slam.trajectory.poses[-self.scans :]

    def record(self, recording: LogRecorder) -> None:
        """Record the log with its trajectory and map, after all `steps`."""
        for index, pose in enumerate(self.poses):
            recording.write_scan(index, Pose.from_array(pose), NO_PARTICLES)
        recording.write_map(self.grid, self.log.scans[-1].time)

    def _scored(self, milliseconds: Floats, seconds: float) -> MappingResult:
        """The metrics, given the processor times of all scans [N] ms and of the whole mapping, s."""
        errors: RelationErrors | None = None
        if self._relations is not None:
            odometry = self.log.odometry if len(self.log.odometry.times) > 1 else None
            errors = relation_errors(self.slam.trajectory, self._relations, odometry)
        far = errors.far_translational_error_m if errors and math.isfinite(errors.far_translational_error_m) else None
        closures = self.slam.loop_closures
        accepted = sum(closure.is_accepted for closure in closures)
        extent, drive = MapExtent.of(self.grid), DriveSummary.of(self.log, self.poses)
        quality = MapQuality.of(self.grid, self.log, self.poses)
        return MappingResult(
            verdict=doubtful_map(quality.doubt)
            if quality.is_doubtful
            else finished_map(extent.size, extent.free_area, self.scans, drive.distance_m, drive.duration_s, accepted),
            translational_error_m=errors.translational_error_m if errors else None,
            translational_sd_m=errors.translational_sd_m if errors else None,
            rotational_error_deg=errors.rotational_error_deg if errors else None,
            rotational_sd_deg=errors.rotational_sd_deg if errors else None,
            relations=errors.relations if errors else 0,
            far_translational_error_m=far,
            ms_per_scan_median=float(np.median(milliseconds)),
            ms_per_scan_p99=float(np.percentile(milliseconds, 99)),
            seconds=seconds,
            closures_accepted=accepted,
            closures_refused=len(closures) - accepted,
            scans=self.scans,
            skipped=len(self.log.skipped),
            backend=self.settings.backend,
            log=str(self.settings.log),
            size_m=extent.size,
            free_area_m2=extent.free_area,
            resolution_m=extent.resolution,
            distance_m=drive.distance_m,
            duration_s=drive.duration_s,
            fit=quality.fit,
            is_doubtful=quality.is_doubtful,
            notes=(*drive.notes, *as_sentences((*quality.notes, *self._contradictions()))),
        )

    def _contradictions(self) -> Iterator[str]:
        """A note if the map does not follow odometry everywhere."""
        first = self.log.scans[0].time  # a continued map has contradictions of earlier logs too
        note = describe_contradictions(
            [one for one in self.slam.odometry_contradictions if one.time >= first], self.scans
        )
        if note:
            yield note

    def save(self, out: Path) -> None:
        """Write map, picture, trajectory and, for graph SLAM, graph.npz and closures.txt, after all `steps`.

        The files of an earlier run that this one does not write are removed, so that all files belong together.

        Raises:
            InputError: The folder cannot be written to.
        """
        ensure_writable_folder(out)
        save_map(self.grid, out / "map.yaml")
        save_trajectories(self.slam.trajectory, out, self.settings.trajectory_format)
        write_atomically(out / "map.png", draw_map(self.grid, self.slam))
        snapshot, graph, closures = self.slam.snapshot(), out / "graph.npz", out / "closures.txt"
        if snapshot is None:
            remove_files([graph, closures])
            return
        save_graph(snapshot, graph)
        write_atomically(closures, "".join(map(_closure_line, snapshot.loop_closures)))


def run(settings: MappingSettings) -> MappingResult:
    """Map a log.

    Raises:
        InputError: As `prepare`.
    """
    mapping = prepare(settings)
    for _ in mapping.steps():
        pass
    return mapping.result


def _closure_line(closure: LoopClosure) -> str:
    """A line of closures.txt, whose format keeps older words: keyscan, response and rival."""
    return (
        f"{closure.time:.3f} keyscan {closure.keyframe} to {closure.target}: {closure.explanation or 'accepted'}"
        f" (response {closure.score:.2f}, rival {closure.second_best_score:.2f}, window {closure.window:.2f} m)\n"
    )
