"""A recorded bag through mapping, and through localization on the map that it yields."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from wherry.errors import InputError
from wherry.localization.parameter_files import load_parameters
from wherry.pipelines.logs import localization
from wherry.pipelines.logs import mapping as slam
from wherry.pipelines.logs.localization import LocalizationResult, LocalizationRun, LocalizationSettings
from wherry.ros.bags.reading import is_bag


@dataclass(frozen=True, slots=True)
class ReplaySettings:
    """Inputs of a replay.

    Attributes:
        bag: Path of a bag of ROS 1 or ROS 2.
        out: Folder of the results, with subfolders ``mapping/`` and ``localization/``.
        map_file: Path of the map to localize on; None to map the bag first.
        backend: Method of mapping.
        params: Path of a parameter file of amcl.
        is_global: Whether localization starts anywhere on the map.
        seed: Seed of all randomness.
        lenient: Whether to skip broken messages.
    """

    bag: Path
    out: Path
    map_file: Path | None = None
    backend: str = "graph"
    params: Path | None = None
    is_global: bool = False
    seed: int = 0
    lenient: bool = False


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
        return ReplayRun(
            settings, settings.map_file, localization.prepare(_localization_settings(settings, settings.map_file))
        )
    if settings.params is not None:
        load_parameters(settings.params)  # errors in the parameters are reported before the bag is mapped
    folder = settings.out / "mapping"
    mapping = slam.prepare(
        slam.Settings(
            log=settings.bag, out=folder, backend=settings.backend, seed=settings.seed, lenient=settings.lenient
        )
    )
    if any(odometry is None for odometry in mapping.log.scan_odometry):
        raise InputError(settings.bag, "", "has no odometry, which localization needs; wherry map can do without")
    return ReplayRun(settings, folder / "map.yaml", mapping)


def _localization_settings(
    settings: ReplaySettings, map_file: Path, reference: Path | None = None
) -> LocalizationSettings:
    """Settings of localization on a map, with a reference trajectory to compare with."""
    return LocalizationSettings(
        log=settings.bag,
        map_file=map_file,
        params=settings.params,
        reference=reference,
        is_global=settings.is_global,
        seed=settings.seed,
        lenient=settings.lenient,
    )


class ReplayRun:
    """The replay of a bag: iterate over `steps`, then read the results.

    Args:
        settings: Inputs of the replay.
        map_file: Path of the map that localization uses.
        first: The first run: mapping, which localization follows, or localization alone.

    Attributes:
        out: Folder of the results.
        map_file: Path of the map that localization uses.
        mapping: Metrics of mapping, if the bag is mapped.
        localization: Metrics of localization, once it is done.
    """

    localization: LocalizationResult

    def __init__(self, settings: ReplaySettings, map_file: Path, first: slam.MappingRun | LocalizationRun) -> None:
        self.out = settings.out
        self.map_file = map_file
        self.mapping: slam.Result | None = None
        self._settings = settings
        self._first = first

    def steps(self) -> Iterator[tuple[str, int, int]]:
        """Run, yielding the name of the stage, the number of scans done and the number of all scans."""
        run = self._first
        if isinstance(run, slam.MappingRun):
            for done in run.steps():
                yield "mapping", done, run.scans
            self.mapping = run.result
            reference = self.map_file.with_name("trajectory.tum")
            run = localization.prepare(_localization_settings(self._settings, self.map_file, reference), run.log)
        for scan in run.steps():
            yield "localizing", scan.index + 1, len(run)
        self.localization = run.result()
        run.save(self.out / "localization")
