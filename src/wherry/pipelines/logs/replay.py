"""A bag through mapping and localization: what the robot's own stack would have made of what it sensed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from wherry.errors import InputError
from wherry.localization.parameter_files import load_parameters
from wherry.pipelines.logs import localization
from wherry.pipelines.logs import mapping as slam
from wherry.pipelines.logs.localization import LocalizationRun
from wherry.ros.bags.reading import is_bag


@dataclass(frozen=True, slots=True)
class Settings:
    """What to run.

    Attributes:
        bag: Of either ROS.
        out: The folder for results: ``mapping/`` and ``localization/`` in it.
        map_file: A map to localize on; None to map the bag first.
        backend: The method of mapping.
        params: An amcl yaml.
        everywhere: Whether localization begins without knowing where the robot is.
        seed: Of all that is random.
        lenient: Whether to leave out broken messages.
    """

    bag: Path
    out: Path
    map_file: Path | None = None
    backend: str = "graph"
    params: Path | None = None
    everywhere: bool = False
    seed: int = 0
    lenient: bool = False


def prepare(settings: Settings) -> ReplayRun:
    """Read and check what a user has given, before anything is done.

    Raises:
        InputError: The bag, the map, the parameters, the method or the folder cannot be used.
    """
    if not settings.bag.exists():
        raise InputError(settings.bag, "", "No such file or directory")
    if not is_bag(settings.bag):
        raise InputError(settings.bag, "", "is no bag; wherry map and wherry localize take logs of other kinds")
    if settings.map_file is not None:
        return ReplayRun(settings, settings.map_file, localization.prepare(_to_localize(settings, settings.map_file)))
    if settings.params is not None:
        load_parameters(settings.params)  # whatever is wrong with them is told before the bag is mapped
    folder = settings.out / "mapping"
    mapping = slam.prepare(
        slam.MappingSettings(
            log=settings.bag, out=folder, backend=settings.backend, seed=settings.seed, lenient=settings.lenient
        )
    )
    if any(odometry is None for odometry in mapping.log.scan_odometry):
        raise InputError(settings.bag, "", "has no odometry, which localization needs; wherry map can do without")
    return ReplayRun(settings, folder / "map.yaml", mapping)


def _to_localize(settings: Settings, map_file: Path, reference: Path | None = None) -> localization.Settings:
    """What to localize, on which map, and the trajectory to compare it with."""
    return localization.Settings(
        log=settings.bag,
        map_file=map_file,
        params=settings.params,
        reference=reference,
        everywhere=settings.everywhere,
        seed=settings.seed,
        lenient=settings.lenient,
    )


class ReplayRun:
    """A bag that is being replayed: iterate `steps`, then look at the results.

    Args:
        settings: What was asked for.
        map_file: The map that is localized on.
        first: What is ready to run: mapping, which localization follows, or localization at once.

    Attributes:
        out: The folder for results.
        map_file: The map that is localized on.
        mapping: The figures of mapping, if the bag was mapped.
        localization: The figures of localization.
    """

    localization: localization.Result

    def __init__(self, settings: Settings, map_file: Path, first: slam.MappingRun | LocalizationRun) -> None:
        self.out = settings.out
        self.map_file = map_file
        self.mapping: slam.MappingResult | None = None
        self._settings = settings
        self._first = first

    def steps(self) -> Iterator[tuple[str, int, int]]:
        """Run, yielding what is being done, how many scans are, and of how many."""
        run = self._first
        if isinstance(run, slam.MappingRun):
            for done in run.steps():
                yield "mapping", done, run.scans
            self.mapping = run.result
            reference = self.map_file.with_name("trajectory.tum")
            run = localization.prepare(_to_localize(self._settings, self.map_file, reference), run.log)
        for located in run.steps():
            yield "localizing", located.index + 1, len(run)
        self.localization = run.result()
        run.save(self.out / "localization")
