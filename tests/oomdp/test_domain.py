"""Terms, deixis and parametrized actions on a minimal domain."""

from __future__ import annotations

import pytest

from wherry.oomdp.attributes import boolean, enumeration, integer, real
from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.objects import ObjectClass, Scene, State
from wherry.oomdp.relations import ON, TOUCH, Relation
from wherry.oomdp.terms import attribute_holds, attribute_is, property_holds, related

ROBOT = ObjectClass("Robot", (integer("x"), integer("y")))
LAMP = ObjectClass("Lamp", (integer("x"), integer("y"), boolean("lit")))
WALL = ObjectClass("Wall", (integer("x"), integer("y")), static=True)
NEAR = Relation("near", lambda a, b: abs(a.x - b.x) + abs(a.y - b.y) <= 1)
TERMS = (
    related(TOUCH["N"], "Robot", "Wall"),
    related(NEAR, "Robot", "Wall"),
    related(ON, "Robot", "Lamp"),
    attribute_holds("Lamp", "lit"),
)
DOMAIN = Domain("lamps", (ROBOT, LAMP, WALL), TERMS, {"N": (), "SWITCH": ()})
STATE = State(
    (
        ROBOT("robot", x=1, y=1),
        LAMP("near", x=1, y=1, lit=False),
        LAMP("far", x=4, y=4, lit=True),
    ),
    Scene((WALL("w0", x=1, y=2), WALL("w1", x=5, y=5))),
)


def test_term_of_the_whole_state_holds_for_some_object() -> None:
    assert DOMAIN.term_names == ("touch_N(robot, wall)", "near(robot, wall)", "on(robot, lamp)", "lamp.lit")
    assert str(DOMAIN.cond(STATE)) == "1111"
    assert str(DOMAIN.cond(STATE.replace("robot", x=4, y=4))) == "0011"


def test_term_of_an_object_holds_for_that_object() -> None:
    assert str(DOMAIN.cond(STATE, STATE["near"])) == "1110"
    assert str(DOMAIN.cond(STATE, STATE["far"])) == "1101"
    assert DOMAIN.cond(STATE, STATE["robot"]) == DOMAIN.cond(STATE)


def test_this_and_some_object_coincide_where_there_is_one() -> None:
    state = STATE.without("far")
    assert DOMAIN.cond(state, state["near"]) == DOMAIN.cond(state)


def test_conditions_are_those_of_the_state_and_every_object() -> None:
    assert DOMAIN.conditions(STATE) == (0b1111, 0b1011, 0b0111, 0b1111)  # the state, then far, near, robot


def test_action_arguments_bind_terms() -> None:
    domain = Domain("lamps", DOMAIN.classes, TERMS, {"N": (), "SWITCH": ("Lamp",)})
    assert domain.size == 5
    assert domain.ground_actions(STATE) == (Action("N"), Action("SWITCH", ("far",)), Action("SWITCH", ("near",)))
    switch = Action("SWITCH", ("far",))
    assert str(switch) == "SWITCH(far)"
    assert str(domain.cond(STATE, None, switch)) == "11010"  # terms about lamps refer to the argument, the far lamp
    assert str(domain.cond(STATE, STATE["far"], switch)) == "11011"  # in which "this" is the argument
    assert str(domain.cond(STATE, STATE["near"], switch)) == "11100"
    assert str(domain.cond(STATE, STATE["near"])) == "11100"


def test_relation_within_a_class_is_between_this_object_and_another() -> None:
    domain = Domain("stack", DOMAIN.classes, (related(TOUCH["N"], "Lamp", "Lamp"), related(ON, "Lamp", "Lamp")), {})
    state = STATE.replace("far", x=1, y=2)  # north of the near lamp
    assert str(domain.cond(state)) == "10"
    assert str(domain.cond(state, state["near"])) == "10"
    assert str(domain.cond(state, state["far"])) == "00"
    assert str(domain.cond(state.without("near"))) == "00"  # a lamp is not on itself


def test_terms_about_reals_and_enumerations() -> None:
    room = ObjectClass("Room", (real("degrees"), enumeration("use", "office", "store")))
    terms = property_holds("Room", "warm", lambda item: item.degrees >= 20), attribute_is("Room", "use", "store")
    domain = Domain("rooms", (room,), terms, {})
    state = State((room("hall", degrees=20.0, use="office"), room("shed", degrees=4.5, use="store")))
    assert domain.term_names == ("warm(room)", "room.use = store")
    assert [str(domain.cond(state, this)) for this in (None, state["hall"], state["shed"])] == ["11", "10", "01"]


def test_action_with_two_parameters_of_one_class_is_refused() -> None:
    with pytest.raises(ValueError, match="SWAP has two parameters of one class"):
        Domain("lamps", DOMAIN.classes, TERMS, {"SWAP": ("Lamp", "Lamp")})


@pytest.mark.parametrize(
    ("terms", "actions"), [((related(ON, "Robot", "Cat"),), {"N": ()}), (TERMS, {"SWITCH": ("Cat",)})]
)
def test_unknown_classes_are_refused(terms: tuple, actions: dict) -> None:
    with pytest.raises(ValueError, match="unknown classes: Cat"):
        Domain("lamps", DOMAIN.classes, terms, actions)
