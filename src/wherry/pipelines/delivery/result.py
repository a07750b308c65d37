"""The result of a delivery, for result.json, the report and the exit status."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import StrEnum


class DeliveryStatus(StrEnum):
    """How a delivery ended; the values are those of result.json."""

    DELIVERED = "delivered"
    NOT_DELIVERED = "not delivered"
    STOPPED = "stopped"


EXIT_STATUS = {  # of the command; 130 is the shell's status after Ctrl-C
    DeliveryStatus.DELIVERED: 0,
    DeliveryStatus.NOT_DELIVERED: 1,
    DeliveryStatus.STOPPED: 130,
}


@dataclass(frozen=True, slots=True)
class DeliveryResult:
    """Metrics of a delivery, from the ground truth; None for one that could not be measured.

    Attributes:
        delivered: Number of boxes that the warehouse has taken.
        boxes: Number of boxes in the world.
        unreachable: Number of boxes that no robot could have delivered.
        collisions: Number of contacts of the robot or its load with a wall, an obstacle or another box.
        learning_steps: Number of actions whose outcome the robot could not predict.
        actions: Number of actions.
        path_ratio: Cells driven while following complete plans ÷ smallest number of cells for the same progress.
        localization_rmse_m: Root mean square error of the position after mapping, with the map aligned to the world, m.
        map_error_m: Median distance of the map's occupied cells from the true walls, m.
        sim_seconds: Simulated duration, s.
        wall_seconds: Duration by the wall clock, s.
        real_time_factor: Simulated duration ÷ duration by the wall clock.
        seed: Seed of the run.
        world: Name of the world.
        status: How the delivery ended.
    """

    delivered: int
    boxes: int
    unreachable: int
    collisions: int
    learning_steps: int
    actions: int
    path_ratio: float | None
    localization_rmse_m: float | None
    map_error_m: float | None
    sim_seconds: float
    wall_seconds: float
    real_time_factor: float
    seed: int
    world: str
    status: DeliveryStatus

    def as_json(self) -> dict[str, object]:
        """The attributes, with floats rounded to four decimals."""
        return {name: round(value, 4) if isinstance(value, float) else value for name, value in asdict(self).items()}

    @property
    def metrics(self) -> dict[str, str]:
        """The metrics for display: names in words, values with units."""

        def centimetres(value: float | None) -> str:
            return "not measured" if value is None else f"{100 * value:.1f} cm"

        return {
            "boxes delivered": f"{self.delivered} of {self.boxes}",
            "boxes that cannot be reached": str(self.unreachable),
            "collisions": str(self.collisions),
            "actions": str(self.actions),
            "actions with an unpredictable outcome": str(self.learning_steps),
            "cells driven ÷ fewest possible, while delivering": (
                "not measured" if self.path_ratio is None else f"{self.path_ratio:.2f}"
            ),
            "localization error (RMSE)": centimetres(self.localization_rmse_m),
            "map error (median)": centimetres(self.map_error_m),
            "simulated time": f"{self.sim_seconds:.0f} s",
            "wall-clock time": f"{self.wall_seconds:.1f} s",
        }

    @property
    def verdict(self) -> str:
        """The outcome in a few words, for titles."""
        if self.status is DeliveryStatus.STOPPED:
            return "stopped"
        if self.status is DeliveryStatus.NOT_DELIVERED:
            return "not all delivered"
        if not self.unreachable:
            return "all delivered"
        return "all reachable boxes delivered" if self.delivered else "no box can be reached"

    @property
    def exit_status(self) -> int:
        """Exit status of the command."""
        return EXIT_STATUS[self.status]
