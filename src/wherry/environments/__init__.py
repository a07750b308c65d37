"""The domains as Gymnasium environments; importing this package registers them.

::

    import gymnasium
    import wherry.environments

    gymnasium.make("wherry/Taxi-v0", size=10)
    gymnasium.make("wherry/Delivery-v0", world="rooms", boxes=3, render_mode="ansi")

Without an import, ``gymnasium.make("wherry.environments:wherry/Taxi-v0")`` registers them too.
"""

from __future__ import annotations

from types import MappingProxyType

import lazy_loader
from gymnasium.envs.registration import register, registry

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

MAX_EPISODE_STEPS = MappingProxyType({"Taxi": 200, "Delivery": 1000})  # steps after which an episode is truncated

for _name, _steps in MAX_EPISODE_STEPS.items():
    if f"wherry/{_name}-v0" not in registry:
        register(
            f"wherry/{_name}-v0",
            entry_point=f"wherry.environments.grids:{_name}Environment",
            max_episode_steps=_steps,
        )
