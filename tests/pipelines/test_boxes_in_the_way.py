"""Deliveries in which a box blocks the only way to another box or to the warehouse."""

from __future__ import annotations

from pathlib import Path

import pytest

from wherry.pipelines.delivery.result import DeliveryResult
from wherry.pipelines.delivery.simulated import DeliverySettings, prepare_delivery
from wherry.trace.records import CellLayout, PerceivedState, Record

BEHIND_A_BOX = """\
wherry-world: 1
name: behind

+---+---+---+---+---+---+
|           |           |
+   +   +   +   +   +   +
|     >       o         |
+   +   +   +---+---+   +
| w         |     o     |
+---+---+---+---+---+---+
"""
WAREHOUSE_BEHIND_A_BOX = """\
wherry-world: 1
name: enclosed

+---+---+---+---+---+---+---+
|            ###            |
+   +   +   +   +   +   +   +
|     >       o             |
+   +   +   +   +   +   +   +
|            ### ###        |
+   +   +   +   +   +   +   +
|### ### ### ###  w         |
+---+---+---+---+---+---+---+
"""


def deliver(world: str, folder: Path, **settings: object) -> tuple[DeliveryResult, list[Record]]:
    """Run a delivery in a drawn world."""
    file, records = folder / "world.txt", list[Record]()
    file.write_text(world, encoding="utf-8")
    run = prepare_delivery(DeliverySettings(world=str(file), out=folder / "out", **settings))  # type: ignore[arg-type]
    return run(records.append), records


def boxes_known(records: list[Record]) -> list[set[str]]:
    """The names of the boxes in each state, without repetitions."""
    names = [
        {item.name for item in record.objects if item.class_name == "Box"}
        for record in records
        if isinstance(record, PerceivedState)
    ]
    return [now for before, now in zip([set(), *names], names, strict=False) if now != before]


def is_done(result: DeliveryResult, boxes: int) -> bool:
    """Whether all boxes are delivered without a collision."""
    return (result.status, result.delivered, result.boxes, result.collisions) == ("delivered", boxes, boxes, 0)


@pytest.fixture(scope="module")
def behind(tmp_path_factory: pytest.TempPathFactory) -> tuple[DeliveryResult, list[Record], Path]:
    folder = tmp_path_factory.mktemp("behind")
    return *deliver(BEHIND_A_BOX, folder), folder / "out"


def test_a_box_behind_another_is_found_once_the_first_is_picked_up(
    behind: tuple[DeliveryResult, list[Record], Path],
) -> None:
    result, records, _ = behind
    assert is_done(result, 2)
    # The second box is known as soon as the first one is in the fork, and each keeps its name.
    assert boxes_known(records) == [{"box1"}, {"box1", "box2"}, {"box2"}, set()]
    assert result.localization_rmse_m is not None
    assert result.localization_rmse_m < 0.03


def test_rules_apply_to_boxes_that_are_found_later(
    behind: tuple[DeliveryResult, list[Record], Path], tmp_path: Path
) -> None:
    again, _ = deliver(BEHIND_A_BOX, tmp_path, rules_file=behind[2] / "rules.json", seed=1)
    assert is_done(again, 2)
    assert again.learning_steps == 0
    assert again.path_ratio is not None
    assert again.path_ratio < 1.3  # cells driven during a survey do not count


def test_cells_behind_a_box_are_surveyed_on_a_given_map_too(
    behind: tuple[DeliveryResult, list[Record], Path], tmp_path: Path
) -> None:
    out = behind[2]
    result, records = deliver(BEHIND_A_BOX, tmp_path, map_file=out / "map.yaml", rules_file=out / "rules.json", seed=2)
    assert is_done(result, 2)
    assert boxes_known(records)[0] == {"box1"}


def test_a_box_that_blocks_the_warehouse_is_carried_during_the_survey(tmp_path: Path) -> None:
    result, records = deliver(WAREHOUSE_BEHIND_A_BOX, tmp_path)
    assert is_done(result, 1)
    warehouses = [len(record.warehouse) for record in records if isinstance(record, CellLayout)]
    assert warehouses == [0, 1]
