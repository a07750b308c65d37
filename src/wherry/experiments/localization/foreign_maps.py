"""Right and wrong maps: recorded logs, localized globally on maps of their own and of other buildings.

Each log is localized on its own map, on changed, mirrored and scaled copies of it, and on the maps of other sites.
The coefficients of `wherry.localization.drive_fit.MapEvidence` are fitted to the drives in which neither the log nor
the map is of a building that is held out.
"""

from __future__ import annotations

import gzip
import math
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from wherry.experiments.data_folder import check_logs
from wherry.experiments.localization import recorded
from wherry.experiments.localization.calibration import logistic_regression, map_of_even_scans
from wherry.experiments.mapping.drifting_odometry import building_log
from wherry.experiments.results import markdown_table
from wherry.localization.drive_fit import DriveFit, DrivenScan, MapEvidence, fits_map
from wherry.localization.localizer import Localizer
from wherry.localization.parameters import GLOBAL_PARAMETERS, LOST_PROBABILITY_THRESHOLD
from wherry.logs.lidar_log import LidarLog
from wherry.logs.options import ReadingOptions
from wherry.logs.reading import read_log
from wherry.logs.timestamps import increasing_times
from wherry.pipelines.logs.localization import odometry_of_scans
from wherry.space.map_files import load_map
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry.space.wean_map import load_wean_map

Progress = Callable[[int, int], None]
"""Called with the number of drives done and the number of all drives."""

BUILDINGS = ("aces", "csail", "fhw", "belgioioso", "orebro", "edmonton")  # with corrected poses, below radish/
FREIBURG = Path("fr079/fr079_1464_corrected.clf.gz")
NAV2_MAPS = ("depot", "warehouse")  # below maps/
HELD_OUT = ("wean", "csail", "belgioioso", "depot")  # buildings without part in the fit of the coefficients
MAX_SCANS = 80  # scans of a drive
MAX_DRIVEN = 40.0  # m, length of a drive
WEAN_STEP = 4  # scans of Wean Hall, which are 4 cm apart, from one that is localized to the next
REMOVED_FRACTION, BLOCK = 0.3, 2.0  # fraction of the blocks whose walls are removed, and m, their side
SCALES = (0.85, 1.1)
OTHER_SITES = 4  # other sites, the next ones in the list, on whose maps a log is localized
LENGTHS = (2.5, 5.0, 10.0, 20.0, math.inf)  # m driven, after which the map is judged
WORKERS = 2  # processes
RIDGE = 0.1  # regularization of the coefficients


@dataclass(frozen=True)
class Site:
    """A map, and the scans of its building that it was not made of.

    Attributes:
        name: Name of the map.
        grid: The map.
        logs: Logs of the building by name, with the scans that are localized; none for a building without a log.
    """

    name: str
    grid: OccupancyGrid
    logs: dict[str, LidarLog]


@dataclass(frozen=True)
class Case:
    """A log on a map.

    Attributes:
        log_name: Name of the log.
        building: Name of the log's building.
        log: The log.
        map_name: Name of the map, or what was done to the building's own.
        grid: The map.
        is_right: Whether it is the map of the building.
    """

    log_name: str
    building: str
    log: LidarLog
    map_name: str
    grid: OccupancyGrid
    is_right: bool

    @property
    def is_held_out(self) -> bool:
        """Whether the log or the map is of a building that is held out."""
        return self.building in HELD_OUT or self.map_name in HELD_OUT


@dataclass(frozen=True, slots=True)
class Outcome:
    """A drive, or its beginning, on a map.

    Attributes:
        case: Log and map; the names and flags of `Case`.
        limit: Length at which the drive was cut off, m; inf for a whole one.
        drive: How the drive fits the map.
        lost_probability: Probability of being lost at its end, given that the map is right.
    """

    case: Case
    limit: float
    drive: DriveFit
    lost_probability: float


def reproduce(data: Path, progress: Progress) -> str:
    """Run all drives, and return the section as Markdown.

    Args:
        data: Folder of recorded logs.
        progress: Called at the start and after every drive.

    Raises:
        InputError: A log or a map is missing or broken.
    """
    maps = [f"maps/{name}" for name in ("depot.yaml", "depot.pgm", "warehouse.yaml", "warehouse.pgm.gz")]
    logs = [recorded.INTEL, FREIBURG, *map(building_log, BUILDINGS), recorded.WEAN_MAP, *recorded.WEAN_LOGS]
    check_logs(data, [*logs, *maps])
    chosen = list(cases(list(sites(data))))
    progress(0, len(chosen))
    with ProcessPoolExecutor(WORKERS, get_context("spawn")) as pool:
        running = [pool.submit(outcomes, case) for case in chosen]
        for done, _ in enumerate(as_completed(running), 1):
            progress(done, len(running))
        return markdown([outcome for future in running for outcome in future.result()])


def sites(data: Path) -> Iterator[Site]:
    """Maps of the even scans with the odd scans, Wean Hall with its own map, and the maps of nav2.

    Raises:
        InputError: A log or a map is missing or broken.
    """
    for name, path in (*((name, building_log(name)) for name in BUILDINGS), ("fr079", FREIBURG)):
        log = read_log(data / path, ReadingOptions(lenient=True))
        poses = np.array([reading.pose.as_array() for reading in odometry_of_scans(log, data / path)])
        yield Site(name, map_of_even_scans(log, poses), {name: _part(log, slice(1, None, 2))})
    intel = read_log(data / recorded.INTEL)
    yield Site("intel", recorded.split_log(data / recorded.INTEL).grid, {"intel": _part(intel, slice(1, None, 2))})
    wean = {f"wean{number}": read_log(data / path) for number, path in enumerate(recorded.WEAN_LOGS, 1)}
    thinned = {name: _part(log, slice(0, None, WEAN_STEP)) for name, log in wean.items()}
    yield Site("wean", load_wean_map(data / recorded.WEAN_MAP), thinned)
    with tempfile.TemporaryDirectory() as folder:
        for name in NAV2_MAPS:
            yield Site(name, load_map(_unpacked(data / "maps", name, Path(folder))), {})


def _part(log: LidarLog, chosen: slice) -> LidarLog:
    """A log with some of its scans only, `MAX_SCANS` at most."""
    return replace(log, scans=log.scans[chosen][:MAX_SCANS], scan_odometry=log.scan_odometry[chosen][:MAX_SCANS])


def _unpacked(maps: Path, name: str, folder: Path) -> Path:
    """Copy a map whose image may be compressed, and return the path of its map.yaml."""
    image, packed = maps / f"{name}.pgm", maps / f"{name}.pgm.gz"
    (folder / image.name).write_bytes(gzip.decompress(packed.read_bytes()) if packed.exists() else image.read_bytes())
    (folder / f"{name}.yaml").write_bytes((maps / f"{name}.yaml").read_bytes())
    return folder / f"{name}.yaml"


def cases(all_sites: list[Site]) -> Iterator[Case]:
    """Every log on its own map, as it is and changed, and on those of other sites."""
    for index, site in enumerate(all_sites):
        others = [*all_sites[index + 1 :], *all_sites[:index]][:OTHER_SITES]
        for name, log in site.logs.items():
            yield Case(name, site.name, log, "own", site.grid, is_right=True)
            yield Case(name, site.name, log, "walls removed", without_walls(site.grid), is_right=True)
            yield Case(name, site.name, log, "mirrored", mirrored(site.grid), is_right=False)
            for scale in SCALES:
                yield Case(name, site.name, log, f"scaled by {scale:g}", scaled(site.grid, scale), is_right=False)
            for other in others:
                yield Case(name, site.name, log, other.name, other.grid, is_right=False)


def mirrored(grid: OccupancyGrid) -> OccupancyGrid:
    """The map as seen from below."""
    return replace(grid, probability=np.ascontiguousarray(grid.probability[:, ::-1]))


def scaled(grid: OccupancyGrid, factor: float) -> OccupancyGrid:
    """The map enlarged by a factor around the origin of its frame."""
    origin = Pose(factor * grid.origin.x, factor * grid.origin.y, grid.origin.theta)
    return replace(grid, resolution=factor * grid.resolution, origin=origin)


def without_walls(grid: OccupancyGrid) -> OccupancyGrid:
    """The map without the walls of `REMOVED_FRACTION` of its square blocks, where the space is free instead."""
    side = round(BLOCK / grid.resolution)
    rows, columns = (math.ceil(length / side) for length in grid.shape)
    is_chosen = np.random.default_rng(0).random((rows, columns)) < REMOVED_FRACTION
    is_removed = np.kron(is_chosen, np.ones((side, side), np.bool_))[: grid.shape[0], : grid.shape[1]]
    return replace(grid, probability=np.where(grid.occupied & is_removed, np.float32(0.02), grid.probability))


def outcomes(case: Case) -> list[Outcome]:
    """Localize a log globally, and judge the map after every length of the drive."""
    localizer = Localizer(case.grid, case.log.lidar, GLOBAL_PARAMETERS, np.random.default_rng(0))
    localizer.initialize_globally()
    times = increasing_times(np.array([scan.time for scan in case.log.scans])).tolist()
    scans: list[DrivenScan] = []
    found, limits, driven = [], list(LENGTHS), 0.0
    lost = 1.0
    for time, scan, reading in zip(times, case.log.scans, case.log.scan_odometry, strict=True):
        if reading is None:
            continue
        driven += reading.pose.distance_to(scans[-1].odometry) if scans else 0.0
        while scans and driven > limits[0]:
            found.append(Outcome(_named(case), limits.pop(0), DriveFit.of(scans), lost))
        if driven > MAX_DRIVEN:
            break
        localization = localizer.update(replace(reading, time=time), replace(scan, time=time))
        lost = localization.lost_probability
        scans.append(DrivenScan(reading.pose, localization.pose, localization.agreement))
    return [*found, Outcome(_named(case), math.inf, DriveFit.of(scans), lost)]


def _named(case: Case) -> Case:
    """The case without log and map, which are large."""
    no_map = OccupancyGrid(np.zeros((1, 1), np.float32), 1.0, Pose())
    return replace(case, log=replace(case.log, scans=(), scan_odometry=()), grid=no_map)


def fit_evidence(found: list[Outcome]) -> MapEvidence:
    """Fit the coefficients to drives at whose end the filter has settled, with equal weight of right and wrong maps."""
    used = [outcome for outcome in found if outcome.lost_probability < LOST_PROBABILITY_THRESHOLD]
    features = np.array([[1.0, *asdict(outcome.drive.features).values()] for outcome in used])
    is_right = np.array([outcome.case.is_right for outcome in used])
    balance = np.where(is_right, 0.5 / is_right.mean(), 0.5 / (1.0 - is_right.mean()))
    return MapEvidence(*logistic_regression(features, is_right, balance, ridge=RIDGE).tolist())


def markdown(found: list[Outcome]) -> str:
    """The section of the results."""
    text = (
        "Each log is localized with `--global` on a map of its own (of its even scans, if the log is of odd scans), on "
        f"the same map with the walls of {REMOVED_FRACTION:.0%} of its {BLOCK:g} m blocks removed, mirrored and "
        f"scaled, and on the maps of {OTHER_SITES} other sites; at most {MAX_SCANS} scans and {MAX_DRIVEN:g} m. P is "
        "the probability that the map is right (`wherry.localization.drive_fit`)."
    )
    held = (
        f"Held out are the logs and maps of {', '.join(HELD_OUT)}. The coefficients in use were fitted without them, "
        "but to longer drives (60 m), also from known starts and among people; so few drives as here do not determine "
        "them well. "
        "Wean Hall's corridors are mirror images of themselves, and its logs too short to tell."
    )
    parts = (_by_log(found), _by_length(found), held, _coefficients(found))
    return "\n\n".join((f"## Right and wrong maps\n\n{text}", *parts)) + "\n"


def _by_log(found: list[Outcome]) -> str:
    """Fit, longest stretch and probability of every log, after whole drives."""
    rows = []
    whole = [outcome for outcome in found if math.isinf(outcome.limit)]
    for name in dict.fromkeys(outcome.case.log_name for outcome in whole):
        of_log = {outcome.case.map_name: outcome for outcome in whole if outcome.case.log_name == name}
        wrong = [outcome for outcome in of_log.values() if not outcome.case.is_right]
        scaled_or_mirrored = [one for one in wrong if one.case.map_name.startswith(("mirrored", "scaled"))]
        others = [one for one in wrong if not one.case.map_name.startswith(("mirrored", "scaled"))]
        groups = [[of_log["own"]], [of_log["walls removed"]], scaled_or_mirrored, others]
        rows.append([name, f"{of_log['own'].drive.distance:.0f}", *(_summary(group) for group in groups)])
    header = ["log", "driven m", "own map", "walls removed", "mirrored, scaled", "other sites"]
    return "Fit · longest consistent stretch m · P, the largest of each:\n\n" + markdown_table(header, rows)


def _summary(group: list[Outcome]) -> str:
    """The largest fit, stretch and probability of some outcomes, which need not be of one."""
    drives = [outcome.drive for outcome in group]
    fit, longest = max(drive.fit.value for drive in drives), max(drive.longest for drive in drives)
    return f"{fit:.2f} · {longest:.0f} · {max(drive.map_probability for drive in drives):.2f}"


def _by_length(found: list[Outcome]) -> str:
    """Verdicts after every length of the drive, of buildings that are held out and of the others."""
    rows = []
    for limit in LENGTHS:
        cells = []
        for is_held_out in (False, True):
            for is_right in (True, False):
                chosen = [one for one in found if one.limit == limit and one.case.is_right == is_right]
                chosen = [one for one in chosen if one.case.is_held_out == is_held_out]
                refused = sum(not fits_map(one.drive) for one in chosen)
                probability = np.mean([one.drive.map_probability for one in chosen]) if chosen else math.nan
                cells.append(f"{refused} of {len(chosen)} ({probability:.2f})")
        rows.append([f"{limit:g} m" if math.isfinite(limit) else "whole drive", *cells])
    header = ["driven", "right maps refused", "wrong maps refused", "held out: right", "held out: wrong"]
    return "Maps that the scans are said not to fit, and the mean P:\n\n" + markdown_table(header, rows)


def _coefficients(found: list[Outcome]) -> str:
    """Coefficients in use and fitted again."""
    fitted = asdict(fit_evidence([outcome for outcome in found if not outcome.case.is_held_out]))
    rows = [
        [name.replace("_", " "), f"{value:.2f}", f"{fitted[name]:.2f}"] for name, value in asdict(MapEvidence()).items()
    ]
    return markdown_table(["coefficient", "in use", "fitted again"], rows)
