from __future__ import annotations

import math

import pytest

from wherry.errors import InputError
from wherry.pipelines.delivery.simulator import SimulatorSettings, build_simulation, referee_summary


def test_number_of_boxes_can_be_set() -> None:
    assert len(build_simulation(SimulatorSettings("small", boxes=1)).plan.boxes) == 1


@pytest.mark.parametrize(
    "settings",
    [
        SimulatorSettings("small", boxes=-1),
        SimulatorSettings("small", rate=0.0),
        SimulatorSettings("small", rate=math.nan),
    ],
)
def test_invalid_settings_are_rejected(settings: SimulatorSettings) -> None:
    with pytest.raises(InputError):
        build_simulation(settings)


def test_nothing_is_delivered_at_first() -> None:
    simulation = build_simulation(SimulatorSettings("small", boxes=1))
    assert referee_summary(simulation) == {"sim_seconds": 0.0, "boxes": 1, "delivered": 0, "collisions": 0}
