"""A hall with one box, for tests of robots."""

from __future__ import annotations

import numpy as np

from wherry.floorplan.world_files import parse_world
from wherry.simulation import Simulation, build

HALL = """\
wherry-world: 1
name: hall

+---+---+---+---+---+---+---+---+
|                            ###|
+   +   +   +   +   +   +   +   +
|     >                         |
+   +   +   +   +   +   +   +   +
|                     o         |
+   +   +   +   +   +   +   +   +
| w   w                         |
+---+---+---+---+---+---+---+---+
"""


def hall(drawing: str = HALL) -> Simulation:
    """Simulate a drawing, with each box in the centre of its cell."""
    plan = parse_world(drawing, source="hall")
    return build(plan, np.random.default_rng(0), box_offsets=np.zeros((len(plan.boxes), 2)))
