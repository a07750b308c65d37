"""A machine with some switches and a counter: a domain in which every condition can be set up by hand."""

from __future__ import annotations

from wherry.oomdp.attributes import boolean, integer
from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.mdp import Learner, Prediction, Transition
from wherry.oomdp.objects import ObjectClass, State
from wherry.oomdp.terms import attribute_holds

PRESS, PULL = Action("PRESS"), Action("PULL")


def machine_domain(switches: int, *, removable: bool = False) -> Domain:
    """Terms s0, s1, … are the switches; the counter and the lamp are what actions change."""
    names = [f"s{at}" for at in range(switches)]
    machine = ObjectClass(
        "Machine",
        (integer("counter", -100, 100), boolean("lamp"), *map(boolean, names)),
        removable=removable,
    )
    terms = tuple(attribute_holds("Machine", name) for name in names)
    return Domain("machine", (machine,), terms, {"PRESS": (), "PULL": ()})


def state_of(domain: Domain, switches: str, counter: int = 0, lamp: bool = False, name: str = "machine") -> State:
    """One machine with its switches as in a condition: "101"."""
    values = {f"s{at}": sign == "1" for at, sign in enumerate(switches)}
    return State((domain.classes[0](name, counter=counter, lamp=lamp, **values),))


def teach(
    learner: Learner,
    switches: str,
    counter: tuple[int, int],
    lamp: tuple[bool, bool] = (False, False),
    action: Action = PRESS,
    reward: float = 0.0,
    terminated: bool = False,
) -> None:
    """Show the learner that the counter, and the lamp, went from one value to another."""
    before = state_of(learner.domain, switches, counter[0], lamp[0])
    after = state_of(learner.domain, switches, counter[1], lamp[1])
    learner.add_experience(Transition(before, action, after, reward, terminated))


def ask(learner: Learner, switches: str, counter: int = 0, lamp: bool = False, action: Action = PRESS) -> Prediction:
    """What the learner predicts."""
    return learner.predict(state_of(learner.domain, switches, counter, lamp), action)


def counter_of(prediction: Prediction) -> int:
    """The counter that is predicted."""
    assert prediction.most_likely.next_state is not None
    return int(prediction.most_likely.next_state["machine"].counter)
