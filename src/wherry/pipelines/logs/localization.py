"""Localization on a log: where the robot was on a map, how sure that is, and how far it is from a reference."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from wherry.errors import InputError
from wherry.files import make_folder, write_atomically
from wherry.localization.localizer import Localization, Localizer
from wherry.localization.parameter_files import load_parameters
from wherry.localization.parameters import AmclParameters
from wherry.logs.carmen import LidarLog, read_log, read_odometry
from wherry.mapping.saved_graph import load_graph
from wherry.robot import Odometry
from wherry.ros.bags.reading import is_bag, read_bag
from wherry.space.map_files import load_map
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose
from wherry.space.trajectory import Trajectory, save_tum
from wherry.space.wean_map import load_wean_map

LOST = 0.5  # probability of being lost from which on a robot is said to be lost
GLOBAL_PARTICLES = 50_000  # at most, when the robot may be anywhere; KLD sampling soon needs fewer
# Odometry is better than nav2 assumes: 4° and 0.15 m off per metre, 0.15 rad and 0.07 m per radian, as in mapping.
# Rooms are not as they were when they were mapped: a scan of which little fits must not outweigh where odometry leads.
LOG_PARAMETERS = AmclParameters(
    alpha1=0.0225, alpha2=0.005, alpha3=0.0225, alpha4=0.0025, turn_slip=0.07, z_hit=0.1, z_rand=0.9
)
# From anywhere more noise does better: it keeps what is nearly right alive until the place is known.
GLOBAL_PARAMETERS = AmclParameters(alpha1=0.1, alpha2=0.1, alpha3=0.1, alpha4=0.1)
FASTEST_SCANS = 0.005  # s a scan; no lidar is faster, so a log's clock that says so stands still
SPACING_WITHOUT_CLOCK = 1.0  # s
INITIAL_POSE_COVARIANCE = np.diag([0.1**2, 0.1**2, 0.05**2])  # m, m, rad, where a reference gives the start


@dataclass(frozen=True, slots=True)
class Settings:
    """What to run.

    Attributes:
        log: A lidar log, see `logs.read_log`, or a bag, see `bags.read_bag`.
        map_file: A map.yaml, a pose graph saved by mapping, or a wean.dat.
        params: An amcl yaml; None for LOG_PARAMETERS, or GLOBAL_PARAMETERS where
            the robot may be anywhere.
        reference: The true trajectory, see `logs.read_odometry`; None if there is none.
        everywhere: Whether the robot may be anywhere at first; otherwise it starts at the initial pose of ``params``,
            or where the reference begins, or at the map's origin.
        seed: Of all that is random.
        lenient: Whether to leave out broken lines of the log.
    """

    log: Path
    map_file: Path
    params: Path | None = None
    reference: Path | None = None
    everywhere: bool = False
    seed: int = 0
    lenient: bool = False


@dataclass(frozen=True, slots=True)
class Result:
    """What came out; distances only where there is a reference.

    Attributes:
        rmse_m: Root mean square of the distances to the reference.
        median_m: Their median.
        p99_m: Their 99th percentile.
        lost_fraction: Share of the scans at which the robot was probably lost.
        final_pose: x m, y m, θ rad, map frame.
        ms_per_update_median: ms a scan that the filter weighed.
        particles_mean: Over the scans.
        scans: How many there were.
        relocalizations: How often the filter was started anew.
        skipped: Lines of the log that were left out.
        unknown_parameters: Keys of ``params`` that mean nothing to amcl.
        seed: As set.
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
        """For JSON."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class Located:
    """One scan, localized.

    Attributes:
        index: Of the scan.
        found: Where the robot is believed to be.
        seconds: s that it took.
    """

    index: int
    found: Localization
    seconds: float


def prepare(settings: Settings, log: LidarLog | None = None) -> LocalizationRun:
    """Read and check everything that a user has given, before anything is done.

    Args:
        settings: What to run.
        log: What the log's file holds, if it was read already.

    Raises:
        InputError: Log, map, parameters or reference cannot be used, or the log has scans without odometry.
    """
    loaded = None if settings.params is None else load_parameters(settings.params)
    own = GLOBAL_PARAMETERS if settings.everywhere else LOG_PARAMETERS
    parameters = own if loaded is None else loaded.parameters
    grid = load_any_map(settings.map_file)
    if log is None:
        read = read_bag if is_bag(settings.log) else read_log
        log = read(settings.log, lenient=settings.lenient)
    odometry = [now for now in log.scan_odometry if now is not None]
    if len(odometry) < len(log.scans):
        raise InputError(settings.log, "", "has scans without odometry, which localization needs")
    reference = None if settings.reference is None else read_odometry(settings.reference)
    if settings.everywhere:
        parameters = replace(parameters, max_particles=max(parameters.max_particles, GLOBAL_PARTICLES))
    localizer = Localizer(grid, log.lidar, parameters, np.random.default_rng(settings.seed))
    if settings.everywhere:
        localizer.initialize_globally()
    elif reference is not None and not parameters.set_initial_pose:
        start = reference.at(np.array([log.scans[0].time]))[0]
        localizer.initialize(Pose.from_array(start), INITIAL_POSE_COVARIANCE)
    unknown = () if loaded is None else loaded.unknown
    return LocalizationRun(settings, grid, log, odometry, reference, localizer, unknown)


def load_any_map(path: Path) -> OccupancyGrid:
    """Read a map.yaml, a saved pose graph (.npz) or a wean.dat, told apart by their names.

    Raises:
        InputError: The file cannot be read, or is no map of its kind.
    """
    if path.name.removesuffix(".gz").endswith(".dat"):
        return load_wean_map(path)
    if path.suffix == ".npz":
        return load_graph(path).grid()
    return load_map(path)


def advancing_times(times: Floats) -> Floats:
    """[N] s that grow from scan to scan, for logs whose stamps are coarse or stand still.

    Without a clock nobody could tell driving from a jump. Scans with one stamp are spread evenly to the next stamp; a
    log in which hardly any time passes is taken for one of a scan a second.

    Args:
        times: [N] s, as logged. Where all grow, or some run backwards, they are left alone.
    """
    steps = np.diff(times)
    if (steps > 0.0).all() or (steps < 0.0).any():
        return times
    count = len(times)
    if times[-1] - times[0] < FASTEST_SCANS * count:
        counted: Floats = times[0] + SPACING_WITHOUT_CLOCK * np.arange(count)
        return counted
    first = np.concatenate([[0], 1 + np.flatnonzero(steps > 0.0)])
    spacing = (times[-1] - times[0]) / first[-1]
    ends = np.append(times[first], times[-1] + spacing * (count - first[-1]))
    advancing: Floats = np.interp(np.arange(count), np.append(first, count), ends)
    return advancing


class LocalizationRun:
    """A run over a log: iterate `steps`, then ask for the `result`.

    Args:
        settings: What was asked for.
        grid: The map.
        log: The scans.
        odometry: [N] at the scans.
        reference: The true trajectory, if there is one.
        localizer: Started.
        unknown_parameters: Keys that were not understood.

    Attributes:
        grid: The map.
        log: The scans.
        localizer: As it is after the steps so far.
        located: What came of each scan so far.
    """

    def __init__(
        self,
        settings: Settings,
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
        self.located: list[Located] = []

    def __len__(self) -> int:
        """How many scans there are."""
        return len(self.log.scans)

    def steps(self) -> Iterator[Located]:
        """Localize scan by scan."""
        times = advancing_times(np.array([scan.time for scan in self.log.scans])).tolist()
        for index, (at, scan, odometry) in enumerate(zip(times, self.log.scans, self._odometry, strict=True)):
            before = time.perf_counter()
            found = self.localizer.update(replace(odometry, time=at), replace(scan, time=at))
            self.located.append(Located(index, found, time.perf_counter() - before))
            yield self.located[-1]

    @property
    def trajectory(self) -> Trajectory:
        """Where the robot was at the scans so far."""
        poses = np.array([located.found.pose.as_array() for located in self.located]).reshape(-1, 3)
        return Trajectory(np.array([scan.time for scan in self.log.scans[: len(poses)]]), poses)

    def result(self) -> Result:
        """The figures, of the scans so far; at least one."""
        errors = self._errors()
        found = [located.found for located in self.located]
        updates = [located.seconds for located in self.located if located.found.estimate.updated]
        x, y, theta = found[-1].pose.as_array().tolist()
        return Result(
            rmse_m=None if errors is None else float(np.sqrt(np.mean(np.square(errors)))),
            median_m=None if errors is None else float(np.median(errors)),
            p99_m=None if errors is None else float(np.quantile(errors, 0.99)),
            lost_fraction=float(np.mean([one.lost_probability > LOST for one in found])),
            final_pose=(x, y, theta),
            ms_per_update_median=1e3 * float(np.median(updates)) if updates else 0.0,
            particles_mean=float(np.mean([one.estimate.particles for one in found])),
            scans=len(found),
            relocalizations=sum(bool(one.hypotheses) for one in found[1:]),
            skipped=len(self.log.skipped),
            unknown_parameters=self._unknown,
            seed=self._settings.seed,
        )

    def _errors(self) -> Floats | None:
        """[N] m to the reference at the scans within its time."""
        if self._reference is None:
            return None
        trajectory = self.trajectory
        inside = (trajectory.times >= self._reference.times[0]) & (trajectory.times <= self._reference.times[-1])
        if not inside.any():
            raise InputError(self._settings.reference or "", "", "has no pose at the time of any scan of the log")
        offset = trajectory.poses[inside, :2] - self._reference.at(trajectory.times[inside])[:, :2]
        distance: Floats = np.hypot(offset[:, 0], offset[:, 1])
        return distance

    def save(self, folder: Path) -> list[Path]:
        """Write trajectory.tum and localization.png.

        Raises:
            InputError: The folder cannot be written to.
        """
        make_folder(folder)
        save_tum(self.trajectory, folder / "trajectory.tum")
        write_atomically(folder / "localization.png", self.picture())
        return [folder / "trajectory.tum", folder / "localization.png"]

    def picture(self) -> bytes:
        """A PNG: the map, the way in green, red where the robot was probably lost, the last particles in red."""
        grid = self.grid
        grey = np.rint(255.0 * (1.0 - grid.probability[::-1])).astype(np.uint8)
        image = Image.fromarray(grey).convert("RGB")
        draw = ImageDraw.Draw(image)

        def pixels(points: Floats) -> list[tuple[float, float]]:
            cells = grid.origin.inverse.transform(points) / grid.resolution
            return [(float(x), float(grey.shape[0] - y)) for x, y in cells]

        way = pixels(self.trajectory.poses[:, :2])
        draw.point(pixels(self.localizer.amcl.particles[:, :2]), fill=(220, 40, 40))
        for located, start, end in zip(self.located[1:], way, way[1:], strict=False):
            lost = located.found.lost_probability > LOST
            draw.line([start, end], fill=(230, 60, 60) if lost else (30, 150, 60), width=2)
        encoded = BytesIO()
        image.save(encoded, "PNG")
        return encoded.getvalue()
