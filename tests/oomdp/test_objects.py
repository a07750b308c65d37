"""States are immutable, equal by content, copied with changes, and read back from JSON."""

from __future__ import annotations

import json
import pickle
from dataclasses import FrozenInstanceError

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wherry.errors import InputError
from wherry.oomdp.attributes import boolean, enumeration, integer, real
from wherry.oomdp.objects import Object, ObjectClass, Scene, State
from wherry.oomdp.state_json import state_from_json

DOOR = ObjectClass(
    "Door", (integer("x", 0, 9), boolean("open"), enumeration("colour", "red", "blue"), real("width", 0))
)
WALL = ObjectClass("Wall", (integer("x"),), static=True)
CLASSES = {"Door": DOOR, "Wall": WALL}

doors = st.builds(
    lambda name, x, is_open, colour, width: DOOR(name, x=x, open=is_open, colour=colour, width=width),
    st.text(max_size=3),
    st.integers(0, 9),
    st.booleans(),
    st.sampled_from(["red", "blue"]),
    st.floats(0, 1e6),
)
states = st.builds(
    lambda objects, xs: State(tuple(objects), Scene(tuple(WALL(f"w{index}", x=x) for index, x in enumerate(xs)))),
    st.lists(doors, max_size=4, unique_by=lambda door: door.name),
    st.lists(st.integers(), max_size=3),
)


def door(name: str = "d", **changes: object) -> Object:
    return DOOR(name, **({"x": 1, "open": False, "colour": "red", "width": 0.9} | changes))


def test_attributes_are_read_by_name() -> None:
    assert (door().x, door().open, door().colour, door().width) == (1, False, "red", 0.9)
    with pytest.raises(AttributeError, match="Door has no attribute 'height'"):
        _ = door().height


@pytest.mark.parametrize(
    "change", [{"x": 10}, {"x": -1}, {"x": 1.5}, {"x": True}, {"open": 1}, {"colour": "green"}, {"width": -0.1}]
)
def test_value_that_the_attribute_does_not_admit_is_refused(change: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=f"{next(iter(change))} cannot be"):
        door(**change)


def test_missing_and_unknown_attributes_are_refused() -> None:
    with pytest.raises(ValueError, match="needs values for"):
        DOOR("d", x=1)
    with pytest.raises(ValueError, match="no attribute height"):
        door().replace(height=2)


def test_states_are_frozen() -> None:
    state = State((door(),))
    with pytest.raises(FrozenInstanceError):
        state.objects = ()  # type: ignore[misc]
    with pytest.raises(FrozenInstanceError):
        state["d"].values = ()  # type: ignore[misc]


def test_states_are_equal_by_content_in_any_order() -> None:
    a, b = door("a"), door("b", x=3)
    assert State((a, b)) == State((b, a))
    assert hash(State((a, b))) == hash(State((b, a)))
    assert State((a,)) != State((a, b))
    assert State((a,), Scene((WALL("w", x=1),))) != State((a,), Scene((WALL("w", x=2),)))


def test_two_objects_with_one_name_are_refused() -> None:
    with pytest.raises(ValueError, match="names of a state's objects must differ"):
        State((door("a"), door("a", x=2)))


def test_copies_with_changes_leave_the_original_unchanged() -> None:
    state = State((door("a"), door("b")))
    edited = state.replace("b", x=7, open=True)
    assert (edited["b"].x, edited["b"].open, edited["a"].x) == (7, True, 1)
    assert state["b"].x == 1
    assert state.without("a").objects == (door("b"),)
    with pytest.raises(KeyError):
        state.replace("c", x=1)


def test_repr_shows_attributes_by_name() -> None:
    assert repr(State((door("a"),))) == "State(Door a(x=1, open=False, colour='red', width=0.9))"


@given(states)
def test_json_and_pickle_round_trip(state: State) -> None:
    restored = state_from_json(json.loads(json.dumps(state.to_json())), CLASSES)
    assert restored == state
    assert hash(restored) == hash(state)
    assert pickle.loads(pickle.dumps(state)) == state  # noqa: S301 - worker processes exchange states


@pytest.mark.parametrize(
    ("data", "field"),
    [
        ([], "objects"),
        ({"objects": 3}, "objects"),
        ({"objects": [3], "scene": []}, "objects[0]"),
        ({"objects": [{"class": "Cat", "name": "d"}], "scene": []}, "objects[0].class"),
        ({"objects": [{"class": "Wall", "x": 1}], "scene": []}, "objects[0].name"),
        ({"objects": [{"class": "Wall", "name": "w", "x": "1"}], "scene": []}, "objects[0]"),
        ({"objects": [{"class": "Wall", "name": "w", "x": 1}] * 2, "scene": []}, "objects"),
        ({"objects": []}, "scene"),
    ],
)
def test_broken_json_is_refused_with_its_field(data: object, field: str) -> None:
    with pytest.raises(InputError) as caught:
        state_from_json(data, CLASSES, "file.json")
    assert (caught.value.source, caught.value.field) == ("file.json", field)


def test_scene_index_is_built_once() -> None:
    keyed = []

    def key(wall: Object) -> int:
        keyed.append(wall.name)
        return int(wall.x) % 2

    scene = Scene(tuple(WALL(f"w{index}", x=index) for index in range(5)))
    for _ in range(3):
        assert [wall.x for wall in scene.index("Wall", key)[1]] == [1, 3]
    assert len(keyed) == 5
