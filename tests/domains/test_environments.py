"""The grids keep to the contract that the robot keeps to."""

from __future__ import annotations

import pytest

from environment_contract import EnvironmentContract
from wherry.domains.delivery import delivery_grid
from wherry.floorplan import find_world
from wherry.oomdp.mdp import Environment


class TestDelivery(EnvironmentContract):
    @pytest.fixture
    def environment(self) -> Environment:
        return delivery_grid(find_world("small"))
