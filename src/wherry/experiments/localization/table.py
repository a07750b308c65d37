"""The localization section of the results: the paper's claims, recorded logs, kidnapping, calibration and speed."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from wherry.experiments.data_folder import check_logs
from wherry.experiments.localization import calibration, filter_comparison, kidnapping, recorded, speed
from wherry.experiments.localization.filter_comparison import FilterComparisonSettings
from wherry.experiments.localization.kidnapping import KidnappingSettings
from wherry.experiments.localization.reliability import Reliability, reliability_table
from wherry.experiments.machine import machine_load
from wherry.experiments.mapping.drifting_odometry import BUILDINGS, building_log
from wherry.experiments.results import markdown_table, write_picture
from wherry.localization.lost import LostCalibration
from wherry.views.filter_bars import filter_bars
from wherry.views.learning_curve import as_bytes
from wherry.views.reliability import reliability_diagram

Progress = Callable[[int, int], None]
"""Called with the number of parts done and the number of all parts."""

RELIABILITY_PICTURE, FILTERS_PICTURE = "localization-reliability.svg", "localization-filters.svg"
INTEL_RELIABILITY_PICTURE = "localization-reliability-intel.svg"
WORKERS = 2  # processes, each running one part at a time
RECOVERY_TIMEOUT = 20.0  # s, simulated time after which a kidnapping counts as not recovered


@dataclass(frozen=True, slots=True)
class LocalizationTableSettings:
    """Amount of computation; the defaults are those of the results file.

    Attributes:
        filters: Settings of the comparison of filters.
        kidnapping: Settings of the kidnapping experiment.
        seeds: Number of seeds of every run on recorded logs.
        every: Step between the odd scans of the Intel log that are relocalized, 1 for all.
        updates: Number of filter updates whose time is measured.
        should_calibrate: Whether the calibration is fitted again.
    """

    filters: FilterComparisonSettings = field(default_factory=FilterComparisonSettings)
    kidnapping: KidnappingSettings = field(default_factory=KidnappingSettings)
    seeds: int = 20
    every: int = 1
    updates: int = 60
    should_calibrate: bool = True


def reproduce(data: Path, images: Path, progress: Progress, settings: LocalizationTableSettings | None = None) -> str:
    """Run all parts and return the section as Markdown.

    Args:
        data: Folder of recorded logs.
        images: Folder for the pictures, beside the results file.
        progress: Called at the start and after every part.
        settings: Amount of computation; None for that of the results file.

    Raises:
        InputError: A log or a map is missing or broken.
    """
    buildings = [building_log(name) for name in BUILDINGS]
    check_logs(data, [recorded.INTEL, recorded.WEAN_MAP, *recorded.WEAN_LOGS, *buildings])
    chosen = settings or LocalizationTableSettings()
    sections = [f"## Localization\n\nTimes are processor times of one core, on a machine with a {machine_load()}."]
    progress(0, len(PARTS))
    with ProcessPoolExecutor(WORKERS, get_context("spawn")) as pool:
        running = {pool.submit(part, data, images, chosen): part for part in PARTS}
        for done, _ in enumerate(as_completed(running), 1):
            progress(done, len(PARTS))
        sections += [future.result() for future in running]
    return "\n\n".join(sections) + "\n"


def _filter_comparison(_data: Path, images: Path, settings: LocalizationTableSettings) -> str:
    chosen = settings.filters
    metrics = list(filter_comparison.run(chosen))
    table = markdown_table(
        ["filter", "rmse m", "p99 m", "memory kB", "scans/s", "localized globally", "recovered"],
        [
            [
                row.name,
                f"{row.rmse_m:.3f}",
                f"{row.p99_m:.3f}",
                f"{row.memory_bytes / 1e3:.1f}",
                f"{row.hertz:.0f}",
                f"{row.localized:.0%}",
                f"{row.recovered:.0%}",
            ]
            for row in metrics
        ],
    )
    claims = markdown_table(
        ["claim of section 5.A", "holds", "metrics"],
        [[claim.text, "yes" if claim.holds else "no", claim.evidence] for claim in filter_comparison.claims(metrics)],
    )
    bars = filter_bars(
        [row.name for row in metrics],
        {
            "rmse, m": [row.rmse_m for row in metrics],
            "memory, kB": [row.memory_bytes / 1e3 for row in metrics],
            "scans/s": [row.hertz for row in metrics],
        },
    )
    picture = write_picture(images, FILTERS_PICTURE, as_bytes(bars, "svg"), "Accuracy, memory and speed of the filters")
    text = (
        f"All filters on the same {chosen.repetitions} drives of {chosen.seconds:.0f} s in `{chosen.world}`, among "
        f"{chosen.boxes} unmapped boxes: from a known start, from a global start, and with a kidnapping half-way, "
        "after which a filter has the other half to recover. Scans/s counts the scans that update the filter, on one "
        "core."
    )
    return f"### Section 5.A: the paper's claims\n\n{text}\n\n{table}\n\n{picture}\n\n{claims}"


def _intel(data: Path, images: Path, settings: LocalizationTableSettings) -> str:
    log = recorded.split_log(data / recorded.INTEL)
    runs = [recorded.track(log, seed) for seed in range(settings.seeds)]
    single = recorded.relocalize(log, settings.every)
    never_lost = sum(run.lost_fraction == 0.0 for run in runs)
    always_correct = sum(run.incorrect_fraction == 0.0 for run in runs)
    medians = [run.median_m for run in runs]
    table = markdown_table(
        ["metric", "value"],
        [
            ["tracking: median error m, median of the seeds", f"{np.median(medians):.3f}"],
            ["tracking: median error m, worst seed", f"{max(medians):.3f}"],
            ["tracking: seeds never reported lost", f"{never_lost} of {len(runs)}"],
            [f"tracking: seeds never beyond {recorded.CORRECT_MAX_DISTANCE} m", f"{always_correct} of {len(runs)}"],
            [f"single scan: within {recorded.CORRECT_MAX_DISTANCE} m", f"{single.correct_fraction:.1%}"],
            ["single scan: declared ambiguous", f"{single.ambiguous_fraction:.1%}"],
            ["single scan: either", f"{single.correct_or_ambiguous_fraction:.1%}"],
            ["single scan: processor time s, median", f"{single.seconds_median:.3f}"],
            ["single scan: processor time s, slowest", f"{single.seconds_max:.3f}"],
        ],
    )
    text = (
        "The map is SLAM's of the even scans; the reference is its trajectory, with odometry in between. "
        f"{len(runs)} seeds track the {len(log.odd.scans)} odd scans; {single.scans} of them are relocalized singly."
    )
    reliability = Reliability.of(
        np.concatenate([run.lost_probabilities for run in runs]), np.concatenate([run.is_lost for run in runs])
    )
    introduction = (
        f"With each seed the robot is then kidnapped, and localized for {recorded.SEGMENT_SCANS} more scans. The "
        "calibration of its probability of being lost over all scans:"
    )
    report = _reliability_report(reliability, images, INTEL_RELIABILITY_PICTURE)
    heading = "### Intel lab: the odd scans on the map of the even ones"
    return f"{heading}\n\n{text}\n\n{table}\n\n{introduction}\n\n{report}"


def _wean(data: Path, _images: Path, settings: LocalizationTableSettings) -> str:
    seeds = settings.seeds
    rows = []
    for log in recorded.WEAN_LOGS:
        poses = np.array(list(recorded.final_poses(data / log, data / recorded.WEAN_MAP, range(seeds))))
        agreeing = recorded.largest_group(poses)
        x, y = np.median(poses[:, :2], axis=0)
        rows.append([log.name.removesuffix(".log.gz"), f"{agreeing} of {seeds}", f"{x:.2f}, {y:.2f}"])
    table = markdown_table(["log", f"seeds that end within {recorded.CORRECT_MAX_DISTANCE} m", "x, y m"], rows)
    return f"### Wean Hall from a global start\n\n{table}"


def _kidnapping(_data: Path, images: Path, settings: LocalizationTableSettings) -> str:
    chosen = settings.kidnapping
    result = kidnapping.summarize(list(kidnapping.run(chosen)))
    recovered = int((result.recovery_seconds <= RECOVERY_TIMEOUT).sum())
    table = markdown_table(
        ["metric", "value"],
        [
            ["tracking rmse m", f"{result.tracking_rmse_m:.3f}"],
            ["tracking p99 m", f"{result.tracking_p99_m:.3f}"],
            [f"false alarms in {chosen.tracking_seconds:.0f} s", f"{result.false_alarms}"],
            [f"kidnappings recovered within {RECOVERY_TIMEOUT:.0f} s", f"{recovered} of {chosen.kidnappings}"],
            ["median time to recover s", f"{float(np.median(result.recovery_seconds)):.1f}"],
        ],
    )
    report = _reliability_report(result.reliability, images, RELIABILITY_PICTURE)
    return f"### Kidnapping, and the calibration of the probability of being lost\n\n{table}\n\n{report}"


def _reliability_report(reliability: Reliability, images: Path, name: str) -> str:
    """Metrics, diagram and table of the reliability of the probability of being lost, as Markdown."""
    diagram = reliability_diagram(reliability.bins, "stated probability of being lost", "fraction of scans truly lost")
    picture = write_picture(
        images, name, as_bytes(diagram, "svg"), "Stated probability of being lost against the fraction truly lost"
    )
    table = markdown_table(
        ["metric", "value"],
        [
            ["scans", f"{reliability.cases}"],
            ["truly lost", f"{reliability.base_rate:.2%}"],
            ["expected calibration error", f"{reliability.calibration_error:.4f}"],
            ["Brier score", f"{reliability.brier:.5f}"],
            ["Brier score of always stating the base rate", f"{reliability.base_brier:.5f}"],
        ],
    )
    return f"{table}\n\n{picture}\n\n{reliability_table(reliability, 'being lost')}"


def _calibration(data: Path, _images: Path, settings: LocalizationTableSettings) -> str:
    text = (
        "The coefficients of the probability of being lost (`wherry.localization.lost`) were fitted to kidnapped "
        f"robots in the worlds {' and '.join(world.world for world in calibration.WORLDS)} and on the maps of "
        f"{', '.join(BUILDINGS)}; the two diagrams of this section are of another world and another building."
    )
    if not settings.should_calibrate:
        return f"### Calibration\n\n{text}"
    runs = list(calibration.calibration_runs(data))
    fitted = calibration.calibrate(runs)
    table = markdown_table(
        ["coefficient", "in use", f"fitted again to {sum(len(run.is_lost) for run in runs)} scans"],
        [
            [name.replace("_", " "), f"{value:.2f}", f"{getattr(fitted, name):.2f}"]
            for name, value in asdict(LostCalibration()).items()
        ],
    )
    return f"### Calibration\n\n{text}\n\n{table}"


def _speed(_data: Path, _images: Path, settings: LocalizationTableSettings) -> str:
    rows = [[measured.task, f"{measured.milliseconds:.2f}"] for measured in speed.measure(settings.updates)]
    return f"### Speed\n\n{markdown_table(['task', 'ms, median'], rows)}"


PARTS: tuple[Callable[[Path, Path, LocalizationTableSettings], str], ...] = (
    _wean,
    _kidnapping,
    _calibration,
    _filter_comparison,
    _intel,
    _speed,
)
"""Each part takes the folder of recorded logs, the folder for pictures and the settings, and returns Markdown."""
