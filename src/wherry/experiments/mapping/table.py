"""Errors of maps of recorded buildings, and published ones (Kümmerle et al. 2009, table 1; Hess et al. 2016)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from wherry.experiments.data_folder import check_logs
from wherry.experiments.mapping import simulated
from wherry.experiments.mapping.drifting_odometry import BUILDINGS, BuildingResult, building_log, map_building
from wherry.experiments.mapping.speed import measure_external
from wherry.experiments.results import markdown_table
from wherry.floorplan.world_files import find_world
from wherry.mapping.methods import SLAM_METHODS
from wherry.pipelines.logs.mapping import MappingResult, MappingSettings, run

INTEL_LOG = "intel_910_rawodom.clf.gz"
DRIFT_SEEDS = 5  # runs per building, each with its own drift
SIMULATED_SEEDS = 3  # runs in the simulated world


@dataclass(frozen=True, slots=True)
class PublishedError:
    """Published error of a method on the Intel log.

    Attributes:
        method: Name of the method.
        translational_error_m: Mean translational error, m.
        translational_sd_m: Standard deviation of the translational error, m; None if it was not published.
    """

    method: str
    translational_error_m: float
    translational_sd_m: float | None


PUBLISHED = (
    PublishedError("scan matching", 0.220, 0.296),
    PublishedError("RBPF, 50 particles (gmapping)", 0.070, 0.083),
    PublishedError("graph mapping", 0.031, 0.026),
    PublishedError("Cartographer", 0.0229, None),
)


def reproduce(data: Path, progress: Callable[[int, int], None]) -> str:
    """Map the recorded buildings with every method, and a simulated one; return a section of the results in Markdown.

    Args:
        data: Folder with ``intel/`` and ``radish/``.
        progress: Called with the number of finished runs and the number of all runs.

    Raises:
        InputError: A file is missing.
    """
    settings = intel_settings(Path("intel"), "graph")
    intel_files = [path for path in (settings.log, settings.odometry, settings.relations) if path is not None]
    check_logs(data, [*intel_files, *(building_log(name) for name in BUILDINGS)])
    total = len(SLAM_METHODS) + len(BUILDINGS) * DRIFT_SEEDS + SIMULATED_SEEDS
    progress(0, total)
    intel = []
    for backend in SLAM_METHODS:
        intel.append(run(intel_settings(data / "intel", backend)))
        progress(len(intel), total)
    drifting: list[BuildingResult] = []
    for name in BUILDINGS:
        for seed in range(DRIFT_SEEDS):
            drifting.append(map_building(data / building_log(name), name, seed))
            progress(len(intel) + len(drifting), total)
    simulated.warm_up()
    world = find_world(simulated.WORLD)
    explored: list[simulated.ExplorationResult] = []
    for seed in range(SIMULATED_SEEDS):
        explored.append(simulated.explore(world, seed))
        progress(len(intel) + len(drifting) + len(explored), total)
    times = {f"wherry, {result.backend}": result.ms_per_scan_median for result in intel}
    times |= measure_external(data / "intel" / INTEL_LOG)
    return _section(intel, drifting, explored, times)


def _section(
    intel: Sequence[MappingResult],
    drifting: Sequence[BuildingResult],
    explored: Sequence[simulated.ExplorationResult],
    times: Mapping[str, float],
) -> str:
    """The section of the results; ``times`` has the median time per scan of each method, ms."""
    return "\n".join(
        [
            "## SLAM",
            "Intel Research Lab, 910 scans, scored with the relations of Kümmerle et al. 2009. Rows without times are",
            "published results. Times are processor times of one core.",
            "",
            intel_table(intel),
            "",
            "Buildings whose logs have no odometry, with drifting odometry made from their corrected poses,",
            f"{DRIFT_SEEDS} drifts each. Errors are distances from the corrected poses, the result of an earlier SLAM,",
            "after alignment. A loop closure is false if it differs from them by more than 1 m or 5°.",
            "",
            drifting_table(drifting),
            "",
            "A simulated robot explores its world, with sensor noise, drift and boxes. The map is aligned with the",
            "world by the robot's first pose alone; × real time is the duration of the drive over the processor time",
            "of scans and maps.",
            "",
            simulated.table(explored),
            "",
            "Median time of a scan on Intel, of all methods that are installed:",
            "",
            markdown_table(["method", "ms per scan"], [[name, f"{median:.2f}"] for name, median in times.items()]),
        ]
    )


def intel_settings(intel: Path, backend: str) -> MappingSettings:
    """Settings that map the Intel log of the folder ``intel`` and score the map."""
    return MappingSettings(
        intel / INTEL_LOG, intel / "intel_rawodom_dense.txt.gz", intel / "intel.relations.gz", backend
    )


def intel_table(results: Sequence[MappingResult]) -> str:
    """A Markdown table of the published errors, and of the results that were scored."""
    rows = [
        [row.method, _pair(row.translational_error_m, row.translational_sd_m), "", "", "", "", ""] for row in PUBLISHED
    ]
    for result in results:
        if result.translational_error_m is None or result.far_translational_error_m is None:
            continue
        closures = str(result.closures_accepted) if result.closures_accepted else ""
        rows.append(
            [
                f"wherry, {result.backend}",
                _pair(result.translational_error_m, result.translational_sd_m),
                f"{result.far_translational_error_m:.3f}",
                _pair(result.rotational_error_deg, result.rotational_sd_deg),
                closures,
                f"{result.ms_per_scan_median:.2f}",
                f"{result.seconds:.1f}",
            ]
        )
    header = ["method", "error, m", "over 60 s apart, m", "error, °", "closures", "ms per scan", "total, s"]
    return markdown_table(header, rows)


def drifting_table(results: Sequence[BuildingResult]) -> str:
    """A Markdown table with one row per building."""
    rows = []
    for name in dict.fromkeys(result.building for result in results):
        runs = [result for result in results if result.building == name]
        errors = [result.rmse_m for result in runs]
        rows.append(
            [
                name,
                f"{min(result.odometry_rmse_m for result in runs):.1f}–{max(r.odometry_rmse_m for r in runs):.1f}",
                f"{sum(errors) / len(errors):.3f}",
                f"{max(errors):.3f}",
                str(sum(result.closures for result in runs)),
                f"{max(result.worst_closure_m for result in runs):.2f}",
                str(sum(result.false_closures for result in runs)),
            ]
        )
    header = ["building", "odometry rmse, m", "mean rmse, m", "worst rmse, m", "closures", "worst closure, m", "false"]
    return markdown_table(header, rows)


def _pair(mean: float | None, deviation: float | None) -> str:
    """A mean with its standard deviation if it is known; empty without a mean."""
    if mean is None:
        return ""
    return f"{mean:.3f}" if deviation is None else f"{mean:.3f} ± {deviation:.3f}"
