"""Boxes that stand in the only way: to other boxes, to the warehouse, or to both; the referee counts."""

from __future__ import annotations

from pathlib import Path

import pytest

from wherry.pipelines.delivery.score import Result
from wherry.pipelines.delivery.simulated import Settings, prepare
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
name: shut in

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


def deliver(world: str, folder: Path, **settings: object) -> tuple[Result, list[Record]]:
    """Run a delivery in a drawn world."""
    file, records = folder / "world.txt", list[Record]()
    file.write_text(world, encoding="utf-8")
    run = prepare(Settings(world=str(file), out=folder / "out", **settings))  # type: ignore[arg-type]
    return run(records.append), records


def boxes_known(records: list[Record]) -> list[set[str]]:
    """The names of the boxes in each state, without those that do not differ from the one before."""
    names = [
        {thing.name for thing in r.objects if thing.class_name == "Box"}
        for r in records
        if isinstance(r, PerceivedState)
    ]
    return [now for before, now in zip([set(), *names], names, strict=False) if now != before]


def is_done(result: Result, boxes: int) -> bool:
    """Whether the referee has seen all boxes delivered, and nothing touched."""
    return (result.status, result.delivered, result.boxes, result.collisions) == ("delivered", boxes, boxes, 0)


@pytest.fixture(scope="module")
def behind(tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, list[Record], Path]:
    folder = tmp_path_factory.mktemp("behind")
    return *deliver(BEHIND_A_BOX, folder), folder / "out"


def test_a_box_behind_a_box_is_found_once_the_first_has_gone(behind: tuple[Result, list[Record], Path]) -> None:
    result, records, _ = behind
    assert is_done(result, 2)
    # The second one is known as soon as the first one is in the fork; none is ever taken for another.
    assert boxes_known(records) == [{"box1"}, {"box1", "box2"}, {"box2"}, set()]
    assert result.localization_rmse_m is not None
    assert result.localization_rmse_m < 0.03


def test_what_was_learnt_holds_for_boxes_that_are_found_later(
    behind: tuple[Result, list[Record], Path], tmp_path: Path
) -> None:
    again, _ = deliver(BEHIND_A_BOX, tmp_path, rules_file=behind[2] / "rules.json", seed=1)
    assert is_done(again, 2)
    assert again.learning_steps == 0
    assert again.path_ratio is not None
    assert again.path_ratio < 1.3  # what is driven to explore is not driven to deliver


def test_on_a_map_that_was_given_what_lies_behind_a_box_is_looked_at_too(
    behind: tuple[Result, list[Record], Path], tmp_path: Path
) -> None:
    out = behind[2]
    result, records = deliver(BEHIND_A_BOX, tmp_path, map_file=out / "map.yaml", rules_file=out / "rules.json", seed=2)
    assert is_done(result, 2)
    assert boxes_known(records)[0] == {"box1"}


def test_a_box_in_the_way_to_the_warehouse_is_carried_along_while_exploring(tmp_path: Path) -> None:
    result, records = deliver(WAREHOUSE_BEHIND_A_BOX, tmp_path)
    assert is_done(result, 1)
    warehouses = [len(record.warehouse) for record in records if isinstance(record, CellLayout)]
    assert warehouses == [0, 1]
