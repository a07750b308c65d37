"""The shortest delivery in a corridor, where it can be counted by hand."""

from __future__ import annotations

from wherry.floorplan.plan import Cell
from wherry.floorplan.world_files import parse_world
from wherry.pipelines.delivery.shortest_delivery import shortest_delivery

CORRIDOR = """wherry-world: 1
name: corridor
cell: 0.6

+---+---+---+---+---+
| w   >   o       o |
+---+---+---+---+---+
"""


def test_shortest_delivery_in_a_corridor() -> None:
    plan = parse_world(CORRIDOR, "corridor")
    # To the near box and back, then to the far box and back, since the robot cannot pass a box with a load.
    assert shortest_delivery(plan, Cell(1, 0), [Cell(2, 0), Cell(4, 0)], has_load=False) == 1 + 2 + 4 + 4
    assert shortest_delivery(plan, Cell(4, 0), [Cell(4, 0)], has_load=False) == 4
    assert shortest_delivery(plan, Cell(4, 0), [], has_load=True) == 4
    assert shortest_delivery(plan, Cell(0, 0), [], has_load=True) == 0


def test_a_robot_behind_a_box_with_a_full_fork_cannot_deliver() -> None:
    plan = parse_world(CORRIDOR, "corridor")
    assert shortest_delivery(plan, Cell(4, 0), [Cell(2, 0)], has_load=True) is None
