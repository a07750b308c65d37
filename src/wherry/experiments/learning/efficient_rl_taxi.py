"""Prints the processor time of a learning step of efficient_rl's DOORMAX on Taxi 5×5, ms.

`wherry bench learning` runs this script with another interpreter, in whose environment efficient_rl 1.0.1 is installed
(with gym 0.25 and numpy 1), so it imports nothing from wherry. Learner, settings and protocol are those of
efficient_rl's own `paper_script`.
"""

from __future__ import annotations

import sys
import time
from types import SimpleNamespace

import numpy as np
from efficient_rl.agents import DOORmax, RmaxBaseClass
from efficient_rl.environment import TaxiEnvironment


def milliseconds_per_step() -> float:
    """Learn until the policy is optimal from the six probes, and return the mean processor time of a step, ms."""
    RmaxBaseClass.time = SimpleNamespace(time=time.thread_time)  # efficient_rl would measure wall-clock time
    environment = TaxiEnvironment(grid_size=5, mode="OO MDP")
    learner = DOORmax(
        nS=environment.nS,
        nA=environment.nA,
        r_max=environment.r_max,
        gamma=0.95,
        delta=0.1,
        k=5,
        eff_types=["assignment", "addition"],
        num_atts=environment.num_atts,
        oo_mdp_dict=environment.oo_mdp_dict,
        env_name="Taxi",
    )
    _, seconds = learner.train(environment, max_episodes=100_000, max_steps=100, show_intermediate=False)
    return 1e3 * float(np.mean(seconds))


if __name__ == "__main__":
    np.random.seed(0)  # noqa: NPY002 - efficient_rl uses numpy's global generator
    sys.stdout.write(f"{milliseconds_per_step()}\n")
