"""The domains as Gymnasium environments; importing this package registers them.

::

    import gymnasium
    import wherry.environments

    gymnasium.make("wherry/Taxi-v0", size=10)
    gymnasium.make("wherry/Delivery-v0", world="rooms", boxes=3, render_mode="ansi")

Where nothing can be imported first, ``gymnasium.make("wherry.environments:wherry/Taxi-v0")`` does it.
"""

from __future__ import annotations

from types import MappingProxyType

from gymnasium.envs.registration import register, registry

LONGEST_EPISODES = MappingProxyType({"Taxi": 200, "Delivery": 1000})
"""After how many steps an episode is cut off, by the environment's name."""

for _name, _steps in LONGEST_EPISODES.items():
    if f"wherry/{_name}-v0" not in registry:
        register(
            f"wherry/{_name}-v0",
            entry_point=f"wherry.environments.grids:{_name}Environment",
            max_episode_steps=_steps,
        )
