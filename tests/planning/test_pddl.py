"""PDDL export of given models: predictions that terms do not determine, and goals expressed by values."""

from __future__ import annotations

import pytest

from wherry.oomdp.attributes import integer
from wherry.oomdp.conditional_models import PerStateModel
from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.mdp import UNKNOWN, DeterministicMdp, Outcome, Prediction, Transition
from wherry.oomdp.objects import ObjectClass, State
from wherry.oomdp.relations import Relation
from wherry.oomdp.terms import related
from wherry.planning.pddl import export_pddl
from wherry_testing.fast_downward import optimal_plan
from wherry_testing.small_worlds import DOMAIN, TableModel, state_at


def test_model_that_depends_on_more_than_the_terms_is_refused() -> None:
    """The model distinguishes two positions that no term distinguishes."""
    left = {(0, "left"): ((1.0, 1, 0.0, False),), (1, "left"): ((1.0, 3, 0.0, False),)}
    with pytest.raises(ValueError, match="left: predictions depend on more than the domain's terms"):
        export_pddl(TableModel(left), DOMAIN, state_at(0))


PUSHER, CRATE = (ObjectClass(name, (integer("x", 0, 6),), removable=name == "Crate") for name in ("Agent", "Crate"))
BESIDE = Relation("left_of", lambda agent, crate: agent.x + 1 == crate.x)
PUSHING = Domain("pushing", (PUSHER, CRATE), (related(BESIDE, "Agent", "Crate"),), {"E": (), "EAT": ("Crate",)})


def push(state: State, action: Action) -> Transition:
    """E moves east and pushes a crate in the next cell; EAT removes the crate in the next cell."""
    x, after = state["agent"].x, state
    ahead = next((crate for crate in state.of_class("Crate") if crate.x == x + 1), None)
    if action.name == "EAT" and ahead is not None and ahead.name == action.arguments[0]:
        after = state.without(ahead.name)
    elif action.name == "E" and x < 5:
        after = state.replace("agent", x=x + 1)
        after = after if ahead is None else after.replace(ahead.name, x=ahead.x + 1)
    return Transition(state, action, after, -1.0, terminated=False)


def test_goal_without_a_term_is_expressed_by_values() -> None:
    """The crate has to be pushed to 4, and no term distinguishes the states where it is at 3."""
    start = State((PUSHER("agent", x=0), CRATE("crate", x=2)))
    world = DeterministicMdp(PUSHING, push, lambda rng: start)

    def crate_at_4(outcome: Outcome) -> bool:
        crate = None if outcome.next_state is None else outcome.next_state.get("crate")
        return crate is not None and crate.x == 4

    class WithinCorridor(PerStateModel):
        """The true model, but unknown at the end of the corridor, where the same terms would have another effect."""

        def predict(self, state: State, action: Action) -> Prediction:
            return UNKNOWN if state["agent"].x == 5 else super().predict(state, action)

    task = export_pddl(WithinCorridor(PUSHING, world), PUSHING, start, crate_at_4)
    assert [str(action) for action in optimal_plan(task)] == ["E", "E", "E"]
    assert "(goal_values ?crate_after)" in task.domain
    assert task.problem.count("(goal_values ") == 1
    removal_task = export_pddl(
        WithinCorridor(PUSHING, world),
        PUSHING,
        start,
        lambda outcome: outcome.next_state is not None and outcome.next_state.get("crate") is None,
    )
    assert [str(action) for action in optimal_plan(removal_task)] == ["E", "EAT(crate)"]
