"""A map of a recorded log, scored by relations where there are some (paper, section 5)."""

from __future__ import annotations

import io
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from wherry.errors import InputError
from wherry.evaluation import RelationErrors, Relations, load_relations, relation_errors
from wherry.files import make_folder, write_atomically
from wherry.logs.carmen import LidarLog, read_log, read_odometry
from wherry.mapping.backends import BACKENDS, MapSettings
from wherry.mapping.graph_slam import GraphSlam, GraphSlamSettings
from wherry.mapping.localizer import MapLocalizer, place_on_map
from wherry.mapping.pose_graph import optimized
from wherry.mapping.saved_graph import load_graph, save_graph
from wherry.mapping.slam import Slam
from wherry.ros.bags.log_recorder import LogRecorder
from wherry.ros.bags.reading import is_bag, read_bag
from wherry.space.map_files import save_map
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import IDENTITY, Floats, Pose
from wherry.space.trajectory import Trajectory, save_tum

WARM_UP = 30  # scans
MARGIN = 1.0  # s that a relation may lie outside a log
NO_PARTICLES = np.empty((0, 3))
TRAJECTORY_COLOUR = (31, 84, 196)
ACCEPTED_COLOUR = (24, 140, 60)
REFUSED_COLOUR = (214, 120, 110)
LEAST_WIDTH, LEAST_TEXT = 480, 14  # pixels, of a picture and of the words under it
BARS = (1, 2, 5, 10, 20, 50, 100)  # m that the bar under a map may be long


@dataclass(frozen=True, slots=True)
class Settings:
    """What to map, and how.

    Attributes:
        log: The lidar log.
        odometry: Denser odometry (``t x y θ``), to interpolate poses with.
        relations: True relations to score the trajectory by.
        backend: A key of `BACKENDS`.
        out: The folder for map, picture, trajectory and pose graph; None to write nothing.
        seed: Of what is random in the method.
        resolution: m, a grid cell's side.
        lenient: Whether broken lines of the log are left out.
        graph: A pose graph saved by mapping, to go on from; None to begin anew.
        start: Where the log begins on that graph's map, to within 3 m and 45°; None for where mapping ended.
        localize: Whether to follow the robot on that graph's map, and leave the map as it is.
    """

    log: Path
    odometry: Path | None = None
    relations: Path | None = None
    backend: str = "graph"
    out: Path | None = None
    seed: int = 0
    resolution: float = 0.05
    lenient: bool = False
    graph: Path | None = None
    start: Pose | None = None
    localize: bool = False


@dataclass(frozen=True, slots=True)
class Result:
    """What came of it; the errors are None without relations.

    Attributes:
        translational_error_m: Mean length of the relations' translational errors.
        translational_sd_m: Its standard deviation.
        rotational_error_deg: Mean absolute rotational error.
        rotational_sd_deg: Its standard deviation.
        relations: How many there were.
        far_translational_error_m: The first one, over relations more than a minute apart; None if there are none.
        ms_per_scan_median: Of the processor time that adding a scan took.
        ms_per_scan_p99: Likewise, the 99th percentile.
        seconds: Of processor time, from the first scan to the finished map, once everything is compiled.
        closures_accepted: Loops that were closed.
        closures_refused: Loops that were tried and refused.
        scans: How many were mapped.
        skipped: Lines of the log that were left out.
        backend: The method.
        log: The file.
    """

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


def prepare(settings: Settings) -> MappingRun:
    """Read and check everything that a user has given, before anything is done.

    Raises:
        InputError: A file, the backend, the resolution or the folder cannot be used, or the log begins nowhere on the
            map that is to be gone on with.
    """
    for option, given in (("--localize", settings.localize), ("--start", settings.start is not None)):
        if given and settings.graph is None:
            raise InputError(option, "", "needs --continue GRAPH: the map that the log begins on")
    if settings.graph is not None and settings.backend != "graph":
        raise InputError("--backend", settings.backend, "cannot go on from a pose graph: graph can")
    if settings.backend not in BACKENDS:
        raise InputError("--backend", settings.backend, f"is none of {', '.join(BACKENDS)}")
    if not 0.005 <= settings.resolution <= 1.0:
        raise InputError("--resolution", str(settings.resolution), "must lie between 0.005 and 1 m")
    read = read_bag if is_bag(settings.log) else read_log
    log = read(settings.log, lenient=settings.lenient)
    relations = None if settings.relations is None else _covered(settings.relations, log)
    odometry = log.odometry
    if settings.odometry is not None:
        odometry = merged_odometry(log.odometry, read_odometry(settings.odometry))
    slam, first = _begun(settings, log)
    if settings.out is not None:
        make_folder(settings.out)
    return MappingRun(settings, log, relations, odometry, slam, first)


def _covered(path: Path, log: LidarLog) -> Relations:
    """The relations between instants that the log covers; of others a trajectory says nothing."""
    relations = load_relations(path)
    first, last = log.scans[0].time - MARGIN, log.scans[-1].time + MARGIN
    inside = ((relations.times >= first) & (relations.times <= last)).all(axis=1)
    if not inside.any():
        raise InputError(path, "", f"has no relation within the log's time, {first:.3f} to {last:.3f} s")
    return Relations(relations.times[inside], relations.poses[inside])


def _begun(settings: Settings, log: LidarLog) -> tuple[Slam, Pose | None]:
    """What maps the log, and where on its map the log begins if it has one already."""
    if settings.graph is None:
        common = MapSettings(resolution=settings.resolution, empty_range=0.0)
        return BACKENDS[settings.backend](log.lidar, np.random.default_rng(settings.seed), common), None
    slam = load_graph(settings.graph)
    if slam.front is not None and log.scans[0].time <= slam.front.time:
        times = f"at {log.scans[0].time:.3f} s, the graph ends at {slam.front.time:.3f} s"
        raise InputError(settings.log, "first scan", f"time runs backwards: it was taken {times}")
    start = slam.pose if settings.start is None else settings.start
    first = place_on_map(slam, log.scans[0], start)
    if first is None:
        place = f"({start.x:.2f} m, {start.y:.2f} m, {math.degrees(start.theta):.0f}°)"
        reason = f"fits the map nowhere around {place}, or in several places; say with --start where it is"
        raise InputError(settings.log, "first scan", reason)
    return (MapLocalizer(slam, first) if settings.localize else slam), first


def merged_odometry(own: Trajectory, dense: Trajectory) -> Trajectory:
    """A log's own odometry and denser odometry in the same frame as one; at equal times the log's own counts."""
    times = np.concatenate([own.times, dense.times])
    poses = np.vstack([own.poses, dense.poses])
    _, first = np.unique(times, return_index=True)
    return Trajectory(times[first], poses[first])


class MappingRun:
    """A log that is being mapped.

    Args:
        settings: What to do.
        log: The log.
        relations: To score by, if there are any.
        odometry: To interpolate poses with.
        slam: What maps it.
        first: base_link at the first scan, if there is a map already to go on with.

    Attributes:
        result: After all `steps`, what came of it.
        pose: base_link in the map frame at the last scan.
    """

    def __init__(
        self,
        settings: Settings,
        log: LidarLog,
        relations: Relations | None,
        odometry: Trajectory,
        slam: Slam,
        first: Pose | None,
    ) -> None:
        self.settings = settings
        self.log = log
        self.result: Result | None = None
        self.pose = IDENTITY
        self._relations = relations
        self._interpolation = odometry if len(odometry.times) > 1 else None
        self.slam = slam
        self._first = first

    @property
    def scans(self) -> int:
        """How many steps there will be."""
        return len(self.log.scans)

    def steps(self) -> Iterator[int]:
        """Map scan by scan, yielding how many are done; then finish the map, score it and write the files.

        After the first yield, of 0, compiled code is loaded, or made if this is the first time: up to half a minute.
        """
        yield 0
        self._warm_up()
        taken = np.zeros(self.scans)
        for number, (scan, odometry) in enumerate(zip(self.log.scans, self.log.scan_odometry, strict=True)):
            before = time.process_time()
            if number == 0 and self._first is not None and isinstance(self.slam, GraphSlam):
                self.pose = self.slam.resume(scan, odometry, self._first)
            else:
                self.pose = self.slam.add(scan, odometry)
            taken[number] = time.process_time() - before
            yield number + 1
        began = time.process_time()
        if isinstance(self.slam, GraphSlam):
            self.slam.finish()
        grid = self.slam.grid()
        seconds = float(taken.sum()) + time.process_time() - began  # what the watchers do meanwhile does not count
        self.result = self._scored(taken * 1e3, seconds)
        if self.settings.out is not None:
            self._write(self.settings.out, grid)

    def record(self, recording: LogRecorder) -> None:
        """Record the log with the trajectory and the map, once all `steps` are done."""
        for index, pose in enumerate(self.slam.trajectory.at(np.array([scan.time for scan in self.log.scans]))):
            recording.write_scan(index, Pose.from_array(pose), NO_PARTICLES)
        recording.write_map(self.slam.grid(), self.log.scans[-1].time)

    def _warm_up(self) -> None:
        """Have everything compiled that mapping calls, by mapping a few scans, so that the clock measures mapping."""
        slam = BACKENDS[self.settings.backend](self.log.lidar, np.random.default_rng(0), MapSettings())
        if isinstance(slam, GraphSlam):
            slam = GraphSlam(self.log.lidar, GraphSlamSettings(submap_scans=4, closure_every=1))
        for scan, odometry in zip(self.log.scans[:WARM_UP], self.log.scan_odometry, strict=False):
            slam.add(scan, odometry)
        slam.grid()
        if isinstance(slam, GraphSlam):
            optimized(slam.graph)

    def _scored(self, milliseconds: Floats, seconds: float) -> Result:
        """The result."""
        errors: RelationErrors | None = None
        if self._relations is not None:
            errors = relation_errors(self.slam.trajectory, self._relations, self._interpolation)
        far = errors.far_translational_error_m if errors and math.isfinite(errors.far_translational_error_m) else None
        closures = self.slam.closures if isinstance(self.slam, GraphSlam) else []
        accepted = sum(closure.accepted for closure in closures)
        return Result(
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
        )

    def _write(self, out: Path, grid: OccupancyGrid) -> None:
        """Write map.pgm, map.yaml, map.png, trajectory.tum and, of graph SLAM, graph.npz and closures.txt."""
        save_map(grid, out / "map.yaml")
        save_tum(self.slam.trajectory, out / "trajectory.tum")
        write_atomically(out / "map.png", map_picture(grid, self.slam))
        if isinstance(self.slam, GraphSlam):
            save_graph(self.slam, out / "graph.npz")
            lines = [
                f"{closure.time:.3f} keyscan {closure.node} to {closure.target}: {closure.refused or 'accepted'}"
                f" (response {closure.response:.2f}, rival {closure.rival:.2f}, window {closure.window:.2f} m)\n"
                for closure in self.slam.closures
            ]
            write_atomically(out / "closures.txt", "".join(lines))


def run(settings: Settings) -> Result:
    """Map a log.

    Raises:
        InputError: A file, the backend, the resolution or the folder cannot be used.
    """
    mapping = prepare(settings)
    for _ in mapping.steps():
        pass
    assert mapping.result is not None  # noqa: S101 - steps() ends by setting it
    return mapping.result


def map_picture(grid: OccupancyGrid, slam: Slam) -> bytes:
    """A PNG of a map with the way on it and, of graph SLAM, the closed and the refused loops; a legend is below.

    Args:
        grid: The map; a small one is enlarged.
        slam: What made it.
    """
    scale = math.ceil(LEAST_WIDTH / max(grid.shape))
    grey = (255 * (1.0 - grid.probability[::-1])).astype(np.uint8).repeat(scale, axis=0).repeat(scale, axis=1)
    height, width = grey.shape[0], max(grey.shape[1], LEAST_WIDTH)  # the legend needs some room
    text = max(LEAST_TEXT, width // 60)
    image = Image.new("RGB", (width, height + 2 * text), "white")
    image.paste(Image.fromarray(grey))
    draw = ImageDraw.Draw(image)

    def pixels(points: Floats) -> list[tuple[float, float]]:
        cells = grid.origin.inverse.transform(points) / grid.resolution * scale
        return [(float(x), float(height - y)) for x, y in cells]

    legend = [("way", TRAJECTORY_COLOUR)]
    if isinstance(slam, GraphSlam):
        for closure in sorted(slam.closures, key=lambda closure: closure.accepted):
            ends = slam.nodes[[closure.target, closure.node], :2]
            draw.line(pixels(ends), fill=ACCEPTED_COLOUR if closure.accepted else REFUSED_COLOUR)
        accepted = sum(closure.accepted for closure in slam.closures)
        legend.append((f"{accepted} closed loops", ACCEPTED_COLOUR))
        legend.append((f"{len(slam.closures) - accepted} refused", REFUSED_COLOUR))
    draw.line(pixels(slam.trajectory.poses[:, :2]), fill=TRAJECTORY_COLOUR, width=2)
    _draw_legend(draw, (width, height), text, legend, scale / grid.resolution)
    buffer = io.BytesIO()
    image.save(buffer, format="PNG")
    return buffer.getvalue()


def _draw_legend(
    draw: ImageDraw.ImageDraw,
    corner: tuple[int, int],
    text: int,
    legend: Sequence[tuple[str, tuple[int, int, int]]],
    pixels_per_metre: float,
) -> None:
    """Write under a map what its colours mean, and draw how long some metres are.

    Args:
        draw: Of the picture.
        corner: The map's lower right corner, in pixels.
        text: Its size, in pixels.
        legend: What there is, in which colour.
        pixels_per_metre: The map's scale.
    """
    width, top = corner
    font, middle = ImageFont.load_default(text), top + text
    x = float(text)
    for name, colour in legend:
        draw.line([(x, middle), (x + text, middle)], fill=colour, width=3)
        draw.text((x + 1.4 * text, middle), name, fill="black", font=font, anchor="lm")
        x += 3.0 * text + draw.textlength(name, font=font)
    metres = max((length for length in BARS if length * pixels_per_metre < width / 5), default=BARS[0])
    right = width - text
    draw.line([(right - metres * pixels_per_metre, middle), (right, middle)], fill="black", width=3)
    end = right - metres * pixels_per_metre - 0.4 * text
    draw.text((end, middle), f"{metres} m", fill="black", font=font, anchor="rm")
