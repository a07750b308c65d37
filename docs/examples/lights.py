"""A complete small domain: a janitor walks along a corridor and switches the lamps off.

Prints every step, whether it was an experiment, and at the end the learnt rules.
"""

from __future__ import annotations

import numpy as np

from wherry.episodes import GoalAgent, run_episode
from wherry.learning import BayesianLearner
from wherry.oomdp import (
    ON,
    TOUCH,
    Action,
    DeterministicMdp,
    Domain,
    ObjectClass,
    Scene,
    State,
    Transition,
    attribute_holds,
    boolean,
    integer,
    related,
)

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
    actions={"E": (), "W": (), "SWITCH_OFF": ("Lamp",)},  # the lamp is a parameter of the action
)
WALLS = Scene((WALL("west", x=-1, y=0), WALL("east", x=10, y=0)))


def transition(state: State, action: Action) -> Transition:
    """The true dynamics, which the learner has to find out."""
    x, after = state["janitor"].x, state
    if action.name == "SWITCH_OFF" and state[action.arguments[0]].x == x:
        after = state.replace(action.arguments[0], lit=False)
    elif action.name in ("E", "W") and 0 <= (new_x := x + (1 if action.name == "E" else -1)) <= 9:
        after = state.replace("janitor", x=new_x)
    return Transition(state, action, after, reward=-1.0, terminated=lit_lamps(after) == 0)


def lit_lamps(state: State) -> int:
    """The number of lamps that are still lit."""
    return sum(lamp.lit for lamp in state.of_class("Lamp"))


def initial_state(rng: np.random.Generator) -> State:
    """The janitor in the middle, three lamps at random positions."""
    positions = rng.choice(10, 3, replace=False)
    lamps = (LAMP(f"lamp{index}", x=int(x), y=0, lit=True) for index, x in enumerate(positions))
    return State((JANITOR("janitor", x=5, y=0), *lamps), WALLS)


if __name__ == "__main__":
    agent = GoalAgent(BayesianLearner(DOMAIN), lit_lamps)
    mdp = DeterministicMdp(DOMAIN, transition, initial_state)
    for step in run_episode(mdp, agent, np.random.default_rng(0)):
        experiment = " (experiment)" if step.is_exploring else ""
        print(f"{step.action}{experiment}: {step.condition.describe(DOMAIN.term_names)}")  # noqa: T201
    print(*agent.learner.sentences(), sep="\n")  # noqa: T201
