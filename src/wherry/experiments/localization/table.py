"""The localization section of the results: section 5.A's claims, real buildings, kidnapping and calibration."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from wherry.experiments.localization import calibration, kidnapping, recorded
from wherry.experiments.localization import speed as localization_speed
from wherry.experiments.localization import study as localization_study
from wherry.experiments.localization.reliability import Reliability, reliability_table
from wherry.experiments.machine import machine_load
from wherry.experiments.mapping.drifting_odometry import BUILDINGS
from wherry.experiments.results import markdown_table, write_picture
from wherry.localization.lost import Calibration
from wherry.views.filter_bars import filter_bars
from wherry.views.learning_curve import as_bytes
from wherry.views.reliability import reliability_diagram

Progress = Callable[[int, int], None]

RELIABILITY, FILTERS = "localization-reliability.svg", "localization-filters.svg"
RELIABILITY_INTEL = "localization-reliability-intel.svg"
AT_ONCE = 2  # parts, which have nothing to do with each other
SOON = 20.0  # s, simulated, in which a kidnapped robot should have found itself


@dataclass(frozen=True, slots=True)
class Extent:
    """How much is run; the defaults are what the results file shows.

    Attributes:
        study: Section 5.A.
        kidnapping: The simulated hour and the kidnappings.
        seeds: Of every run on recorded logs.
        every: Of the odd Intel scans, how many there are to one that is relocalized.
        updates: Of every filter whose speed is measured.
        calibrate: Whether the calibration is fitted anew.
    """

    study: localization_study.Settings = field(default_factory=localization_study.Settings)
    kidnapping: kidnapping.Settings = field(default_factory=kidnapping.Settings)
    seeds: int = 20
    every: int = 1
    updates: int = 60
    calibrate: bool = True


def reproduce(data: Path, images: Path, progress: Progress, extent: Extent | None = None) -> str:
    """Run everything and return it as Markdown.

    Args:
        data: The folder of recorded logs.
        images: The folder for pictures, beside the results file; `RELIABILITY` and `FILTERS` go there.
        progress: Told how many parts are done, of how many.
        extent: How much to run; all of it by default.

    Raises:
        InputError: A log or a map is missing or broken.
    """
    chosen = extent or Extent()
    sections = [f"## Localization\n\nTimes are a core's, on a machine with a {machine_load()}."]
    progress(0, len(PARTS))
    with ProcessPoolExecutor(AT_ONCE, get_context("spawn")) as pool:
        running = {pool.submit(part, data, images, chosen): part for part in PARTS}
        for done, _ in enumerate(as_completed(running), 1):
            progress(done, len(PARTS))
        sections += [future.result() for future in running]
    return "\n\n".join(sections) + "\n"


def _study(_data: Path, images: Path, extent: Extent) -> str:
    settings = extent.study
    rows = list(localization_study.run(settings))
    table = markdown_table(
        ["filter", "rmse m", "p99 m", "memory kB", "scans/s", "found from anywhere", "recovered"],
        [
            [
                row.name,
                f"{row.rmse_m:.3f}",
                f"{row.p99_m:.3f}",
                f"{row.memory_bytes / 1e3:.1f}",
                f"{row.hertz:.0f}",
                f"{row.found:.0%}",
                f"{row.recovered:.0%}",
            ]
            for row in rows
        ],
    )
    claims = markdown_table(
        ["claim of section 5.A", "holds", "figures"],
        [[claim.text, "yes" if claim.holds else "no", claim.figures] for claim in localization_study.claims(rows)],
    )
    bars = filter_bars(
        [row.name for row in rows],
        {
            "rmse, m": [row.rmse_m for row in rows],
            "memory, kB": [row.memory_bytes / 1e3 for row in rows],
            "scans/s": [row.hertz for row in rows],
        },
    )
    picture = write_picture(images, FILTERS, as_bytes(bars, "svg"), "Accuracy, memory and speed of the filters")
    text = (
        f"All filters on the same {settings.repetitions} drives of {settings.seconds:.0f} s in `{settings.world}`, "
        f"among {settings.boxes} boxes that are not on the map; from a known start, from anywhere, and with a "
        "kidnapping half-way, after which a filter has the other half to recover. Scans/s is how many of those that "
        "are weighed a core can take in."
    )
    return f"### Section 5.A: the paper's claims\n\n{text}\n\n{table}\n\n{picture}\n\n{claims}"


def _intel(data: Path, images: Path, extent: Extent) -> str:
    halves = recorded.halves(data / recorded.INTEL)
    runs = [recorded.track(halves, seed) for seed in range(extent.seeds)]
    single = recorded.relocalize(halves, extent.every)
    never = sum(run.lost == 0.0 for run in runs)
    near = sum(run.beyond == 0.0 for run in runs)
    medians = [run.median_m for run in runs]
    table = markdown_table(
        ["figure", "value"],
        [
            ["tracking: median error m, median of the seeds", f"{np.median(medians):.3f}"],
            ["tracking: median error m, worst seed", f"{max(medians):.3f}"],
            ["tracking: seeds never believed lost", f"{never} of {len(runs)}"],
            [f"tracking: seeds never beyond {recorded.FOUND} m", f"{near} of {len(runs)}"],
            [f"one scan: within {recorded.FOUND} m", f"{single.found:.1%}"],
            ["one scan: declared ambiguous", f"{single.ambiguous:.1%}"],
            ["one scan: either", f"{single.found_or_ambiguous:.1%}"],
            ["one scan: s of a core, median", f"{single.seconds_median:.3f}"],
            ["one scan: s of a core, slowest", f"{single.seconds_worst:.3f}"],
        ],
    )
    text = (
        "The map is SLAM's of the even scans; the reference its trajectory, with odometry in between. "
        f"{len(runs)} seeds track the {len(halves.odd)} odd scans; {single.scans} of them are relocalized alone."
    )
    reliability = Reliability.of(np.concatenate([r.stated for r in runs]), np.concatenate([r.truly_lost for r in runs]))
    believing = (
        f"Each seed is then carried off to another place, for {recorded.LEG} scans more. How far its “I am lost” was "
        "to be believed, in all:"
    )
    lost = _how_far_to_believe(reliability, images, RELIABILITY_INTEL)
    return f"### Intel lab: the odd scans on the map of the even ones\n\n{text}\n\n{table}\n\n{believing}\n\n{lost}"


def _wean(data: Path, _images: Path, extent: Extent) -> str:
    seeds = extent.seeds
    rows = []
    for log in recorded.WEAN_LOGS:
        finals = np.array(list(recorded.final_poses(data / log, data / recorded.WEAN_MAP, range(seeds))))
        together = recorded.most_together(finals)
        x, y = np.median(finals[:, :2], axis=0)
        rows.append([log.name.removesuffix(".log.gz"), f"{together} of {seeds}", f"{x:.2f}, {y:.2f}"])
    table = markdown_table(["log", f"seeds that end within {recorded.FOUND} m", "x, y m"], rows)
    return f"### Wean Hall from anywhere\n\n{table}"


def _kidnapping(_data: Path, images: Path, extent: Extent) -> str:
    settings = extent.kidnapping
    result = kidnapping.summarize(list(kidnapping.run(settings)))
    figures = markdown_table(
        ["figure", "value"],
        [
            ["tracking rmse m", f"{result.tracking_rmse_m:.3f}"],
            ["tracking p99 m", f"{result.tracking_p99_m:.3f}"],
            [f"false alarms in {settings.seconds:.0f} s", f"{result.false_alarms}"],
            [
                f"kidnappings recovered within {SOON:.0f} s",
                f"{int((result.recovered <= SOON).sum())} of {settings.kidnappings}",
            ],
            ["median time to recover s", f"{float(np.median(result.recovered)):.1f}"],
        ],
    )
    believing = _how_far_to_believe(result.reliability, images, RELIABILITY)
    return f"### Kidnapping, and how far to believe “I am lost”\n\n{figures}\n\n{believing}"


def _how_far_to_believe(reliability: Reliability, images: Path, name: str) -> str:
    """Diagram, figures and table."""
    diagram = reliability_diagram(reliability.tenths, "probability of being lost", "share of scans truly lost")
    picture = write_picture(images, name, diagram.encode(), "How often the robot was lost when it said so")
    figures = markdown_table(
        ["figure", "value"],
        [
            ["scans", f"{reliability.cases}"],
            ["truly lost", f"{reliability.base_rate:.2%}"],
            ["expected calibration error", f"{reliability.calibration_error:.4f}"],
            ["Brier score", f"{reliability.brier:.5f}"],
            ["Brier score of who always states the share of lost scans", f"{reliability.base_brier:.5f}"],
        ],
    )
    return f"{figures}\n\n{picture}\n\n{reliability_table(reliability, 'being lost')}"


def _calibration(data: Path, _images: Path, extent: Extent) -> str:
    used = Calibration()
    text = (
        "The coefficients of the probability of being lost (`wherry.localization.lost`) were fitted to robots that "
        f"were carried off in the worlds {' and '.join(world.world for world in calibration.WORLDS)} and on the maps "
        f"of {', '.join(BUILDINGS)}; the two diagrams of this section are of another world and another building."
    )
    if not extent.calibrate:
        return f"### Calibration\n\n{text}"
    runs = list(calibration.runs(data))
    again = calibration.calibrate(runs)
    table = markdown_table(
        ["coefficient", "in use", f"fitted anew to {sum(len(run.lost) for run in runs)} scans"],
        [[name, f"{value:.2f}", f"{getattr(again, name):.2f}"] for name, value in asdict(used).items()],
    )
    return f"### Calibration\n\n{text}\n\n{table}"


def _speed(_data: Path, _images: Path, extent: Extent) -> str:
    rows = [[speed.task, f"{speed.milliseconds:.2f}"] for speed in localization_speed.measure(extent.updates)]
    return f"### Speed\n\n{markdown_table(['task', 'ms, median'], rows)}"


PARTS: tuple[Callable[[Path, Path, Extent], str], ...] = (_wean, _kidnapping, _calibration, _study, _intel, _speed)
"""Each takes the folder of recorded logs, the folder for pictures and how much to run, and returns Markdown."""
