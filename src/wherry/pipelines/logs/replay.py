"""Replay of a bag: mapping of its scans, and then localization of them on the map."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from wherry.errors import InputError
from wherry.localization.parameter_files import load_parameters
from wherry.logs.options import DEFAULT_READING, ReadingOptions
from wherry.pipelines.logs import localization, mapping
from wherry.pipelines.logs.localization import LocalizationResult, LocalizationRun, LocalizationSettings
from wherry.pipelines.logs.mapping import MappingResult, MappingRun, MappingSettings
from wherry.pipelines.logs.summary import DriveSummary
from wherry.ros.bags.reading import is_bag


@dataclass(frozen=True, slots=True)
class ReplaySettings:
    """Inputs of a replay.

    Attributes:
        bag: Path of a bag of ROS 1 or ROS 2.
        out: Folder of the results, with subfolders ``mapping/`` and ``localization/``.
        map_file: Path of the map to localize on; None to map the bag first.
        backend: Name of the mapping method, see `mapping.methods.SLAM_METHODS`.
        params: Path of a parameter file of amcl; None for the defaults of `LocalizationSettings`.
        is_global: Whether localization starts without an initial pose.
        seed: Seed of all randomness.
        reading: How the bag is read.
        trajectory_format: Format of trajectory files in addition to trajectory.tum, a key of `TRAJECTORY_FORMATS`.
    """

    bag: Path
    out: Path
    map_file: Path | None = None
    backend: str = "graph"
    params: Path | None = None
    is_global: bool = False
    seed: int = 0
    reading: ReadingOptions = DEFAULT_READING
    trajectory_format: str = "tum"


def prepare(settings: ReplaySettings) -> ReplayRun:
    """Read and check all inputs before anything is computed.

    Raises:
        InputError: The bag, the map, the parameters, the method or the folder cannot be used.
    """
    if not settings.bag.exists():
        raise InputError(settings.bag, "", "No such file or directory")
    if not is_bag(settings.bag):
        raise InputError(settings.bag, "", "is not a bag; wherry map and wherry localize read logs of other formats")
    if settings.map_file is not None:
        localization_run = localization.prepare(_localization_settings(settings, settings.map_file))
        return ReplayRun(settings.out, settings.map_file, None, lambda: localization_run)
    if settings.params is not None:
        load_parameters(settings.params)  # errors in the parameters are reported before the bag is mapped
    folder = settings.out / "mapping"
    mapping_run = mapping.prepare(
        MappingSettings(
            log=settings.bag,
            out=folder,
            backend=settings.backend,
            seed=settings.seed,
            reading=settings.reading,
            trajectory_format=settings.trajectory_format,
        )
    )
    localization.with_odometry(mapping_run.log, settings.bag)  # checked before the bag is mapped
    map_file = folder / "map.yaml"
    localization_settings = _localization_settings(settings, map_file, reference=folder / "trajectory.tum")
    return ReplayRun(
        settings.out, map_file, mapping_run, lambda: localization.prepare(localization_settings, mapping_run.log)
    )


def _localization_settings(
    settings: ReplaySettings, map_file: Path, reference: Path | None = None
) -> LocalizationSettings:
    """Settings of localization on a map, with errors against a reference trajectory if there is one."""
    return LocalizationSettings(
        log=settings.bag,
        map_file=map_file,
        params=settings.params,
        reference=reference,
        is_global=settings.is_global,
        seed=settings.seed,
        reading=settings.reading,
        trajectory_format=settings.trajectory_format,
    )


class ReplayRun:
    """The replay of a bag: iterate over `steps`, then read the results.

    Args:
        out: Folder of the results.
        map_file: Path of the map that localization uses.
        mapping_run: Mapping of the bag, which comes first; None if the map exists already.
        prepare_localization: Prepares localization once the map exists.

    Attributes:
        out: Folder of the results.
        map_file: Path of the map that localization uses.
        mapping: Metrics of mapping; None if the bag is not mapped.
        localization: Metrics of localization, set after the last step.
        drive: The drive as localization has it, and the notes on the bag, set after the last step.
    """

    localization: LocalizationResult
    drive: DriveSummary

    def __init__(
        self,
        out: Path,
        map_file: Path,
        mapping_run: MappingRun | None,
        prepare_localization: Callable[[], LocalizationRun],
    ) -> None:
        self.out = out
        self.map_file = map_file
        self.mapping: MappingResult | None = None
        self._mapping_run = mapping_run
        self._prepare_localization = prepare_localization

    def steps(self) -> Iterator[tuple[str, int, int]]:
        """Run, yielding the name of the stage, the number of scans done and the number of all scans."""
        if self._mapping_run is not None:
            for done in self._mapping_run.steps():
                yield "mapping", done, self._mapping_run.scans
            self.mapping = self._mapping_run.result
        run = self._prepare_localization()
        for scan in run.steps():
            yield "localizing", scan.index + 1, len(run)
        self.localization = run.result()
        self.drive = DriveSummary.of(run.log, run.trajectory.poses)
        run.save(self.out / "localization")
