"""A complete small domain: a janitor walks along a corridor and switches the lamps off.

Run it, and it shows every step, whether it was an experiment, and in the end what was learnt.
"""

from __future__ import annotations

import numpy as np

from wherry.episodes import GoalAgent, run_episode
from wherry.learning.bayes import BayesianLearner
from wherry.oomdp.attributes import boolean, integer
from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.mdp import DeterministicMdp, Transition
from wherry.oomdp.objects import ObjectClass, Scene, State
from wherry.oomdp.relations import ON, TOUCH
from wherry.oomdp.terms import attribute_holds, related

CELL = (integer("x", 0, 9), integer("y", 0, 0))
JANITOR, LAMP = ObjectClass("Janitor", CELL), ObjectClass("Lamp", (*CELL, boolean("lit")))
WALL = ObjectClass("Wall", (integer("x"), integer("y")), static=True)
DOMAIN = Domain(
    name="lights",
    classes=(JANITOR, LAMP, WALL),
    terms=(
        related(TOUCH["E"], "Janitor", "Wall"),
        related(TOUCH["W"], "Janitor", "Wall"),
        related(ON, "Janitor", "Lamp"),
        attribute_holds("Lamp", "lit"),
    ),
    actions={"E": (), "W": (), "SWITCH_OFF": ("Lamp",)},  # which lamp is the action's parameter
)
WALLS = Scene((WALL("west", x=-1, y=0), WALL("east", x=10, y=0)))


def what_happens(state: State, action: Action) -> Transition:
    """What is true, and what the learner is to find out."""
    x, after = state["janitor"].x, state
    if action.name == "SWITCH_OFF" and state[action.arguments[0]].x == x:
        after = state.replace(action.arguments[0], lit=False)
    elif action.name in ("E", "W") and 0 <= (step := x + (1 if action.name == "E" else -1)) <= 9:
        after = state.replace("janitor", x=step)
    return Transition(state, action, after, reward=-1.0, terminated=lit(after) == 0)


def lit(state: State) -> int:
    """How many lamps are still on."""
    return sum(lamp.lit for lamp in state.of_class("Lamp"))


def begin(rng: np.random.Generator) -> State:
    """The janitor in the middle, three lamps anywhere."""
    lamps = (LAMP(f"lamp{at}", x=int(x), y=0, lit=True) for at, x in enumerate(rng.choice(10, 3, replace=False)))
    return State((JANITOR("janitor", x=5, y=0), *lamps), WALLS)


if __name__ == "__main__":
    agent = GoalAgent(BayesianLearner(DOMAIN), lit)
    for step in run_episode(DeterministicMdp(DOMAIN, what_happens, begin), agent, np.random.default_rng(0)):
        print(step.condition, step.action, "(an experiment)" if step.is_learning else "")  # noqa: T201
    print(*agent.learner.sentences(), sep="\n")  # noqa: T201
