"""The delivery grid fulfils the contract of environments."""

from __future__ import annotations

import pytest

from wherry.domains.delivery import delivery_grid
from wherry.floorplan.world_files import find_world
from wherry.oomdp.mdp import Environment
from wherry_testing.environment_contract import EnvironmentContract


class TestDelivery(EnvironmentContract):
    @pytest.fixture
    def environment(self) -> Environment:
        return delivery_grid(find_world("small"))
