"""Transforms in space agree with rotation matrices, and the tree is followed as tf2 does."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from wherry.robot import Scan
from wherry.ros.frame_names import is_world_frame, listed_frames, resolve_frame
from wherry.ros.transform_tree import MAX_LINKS, TransformTree
from wherry.ros.transforms import Mount, MountError, RigidTransform
from wherry.space.pose import Pose

coordinates = st.floats(-5.0, 5.0)


@st.composite
def rigid_transforms(draw: st.DrawFn) -> RigidTransform:
    values = np.array([draw(st.floats(-1.0, 1.0)) for _ in range(4)])
    norm = float(np.linalg.norm(values))
    x, y, z, w = (values / norm).tolist() if norm > 0.1 else (0.0, 0.0, 0.0, 1.0)
    return RigidTransform((draw(coordinates), draw(coordinates), draw(coordinates)), (x, y, z, w))


def matrix(transform: RigidTransform) -> NDArray[np.float64]:
    """The homogeneous matrix of a transform."""
    x, y, z, w = transform.rotation
    result = np.eye(4)
    result[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    result[:3, 3] = transform.translation
    return result


@given(rigid_transforms(), rigid_transforms())
def test_composition_and_inversion_are_those_of_matrices(a: RigidTransform, b: RigidTransform) -> None:
    np.testing.assert_allclose(matrix(a @ b), matrix(a) @ matrix(b), atol=1e-9)
    np.testing.assert_allclose(matrix(a.inverse), np.linalg.inv(matrix(a)), atol=1e-9)


@given(st.lists(st.tuples(rigid_transforms(), st.booleans()), min_size=1, max_size=6))
def test_a_chain_of_links_in_any_direction_is_composed(links: list[tuple[RigidTransform, bool]]) -> None:
    tree, expected = TransformTree(), np.eye(4)
    for number, (transform, is_reversed) in enumerate(links):
        expected = expected @ matrix(transform)
        if is_reversed:
            tree.add(f"f{number + 1}", f"f{number}", transform.inverse)
        else:
            tree.add(f"f{number}", f"f{number + 1}", transform)
    found = tree.lookup("f0", f"f{len(links)}")
    assert found is not None
    np.testing.assert_allclose(matrix(found), expected, atol=1e-8)


def test_frames_that_are_not_connected_have_no_transform() -> None:
    tree = TransformTree()
    tree.add("a", "b", RigidTransform())
    tree.add("c", "d", RigidTransform())
    assert tree.lookup("a", "d") is None
    assert tree.lookup("a", "missing") is None
    assert tree.lookup("a", "a") == RigidTransform()
    assert tree.frames == {"a", "b", "c", "d"}


@pytest.mark.parametrize("name", ["odom", "map", "world", "robot1/odom", "robot1_odom", "odom_combined", "a/b/map"])
def test_frames_of_the_world_are_known_by_their_names(name: str) -> None:
    assert is_world_frame(name)
    tree = TransformTree()
    tree.add(name, "base_link", RigidTransform())
    tree.add(name, "laser", RigidTransform())
    assert tree.lookup("base_link", "laser") is None


@pytest.mark.parametrize("name", ["odometer", "mapper_link", "base_link", "worldly", "odom_wheel_link"])
def test_other_frames_are_not_of_the_world(name: str) -> None:
    assert not is_world_frame(name)


def test_a_loop_that_agrees_is_accepted() -> None:
    tree = TransformTree()
    tree.add("base", "mast", RigidTransform((1.0, 0.0, 0.0)))
    tree.add("mast", "laser", RigidTransform((0.0, 1.0, 0.0)))
    tree.add("laser", "base", RigidTransform((-1.0, -1.0, 0.0)))
    assert tree.lookup("base", "laser") == RigidTransform((1.0, 1.0, 0.0))


def test_a_contradiction_elsewhere_does_not_matter() -> None:
    tree = TransformTree()
    tree.add("base", "laser", RigidTransform((1.0, 0.0, 0.0)))
    tree.add("base", "arm", RigidTransform())
    tree.add("arm", "hand", RigidTransform())
    tree.add("base", "hand", RigidTransform((9.0, 0.0, 0.0)))
    assert tree.lookup("base", "laser") == RigidTransform((1.0, 0.0, 0.0))
    with pytest.raises(MountError, match="contradicts"):
        tree.lookup("base", "hand")


def test_vibration_is_not_motion() -> None:
    tree = TransformTree()
    for step in range(10):
        tree.add("base", "laser", RigidTransform((0.2 + 0.001 * (step % 3), 0.0, 0.1 * step)))
    found = tree.lookup("base", "laser")
    assert found is not None
    assert found.translation == (0.2, 0.0, 0.0)
    tree.add("base", "laser", RigidTransform((0.25, 0.0, 0.0)))
    with pytest.raises(MountError, match=r"the transform base → laser moves by 0\.05 m and 0°"):
        tree.lookup("base", "laser")


def test_the_number_of_links_is_limited() -> None:
    tree = TransformTree()
    for number in range(MAX_LINKS + 10):
        tree.add("base", f"frame_{number}", RigidTransform())
    assert len(tree.links) == MAX_LINKS


@pytest.mark.parametrize(
    ("name", "frames", "prefix", "expected"),
    [
        ("laser", ["laser", "robot1/laser"], "robot1", "laser"),
        ("/laser", ["laser"], "", "laser"),
        ("laser", ["robot1/laser"], "", "robot1/laser"),
        ("robot1/laser", ["laser"], "", "laser"),
        ("laser", ["robot1/laser", "robot2/laser"], "", None),
        ("laser", ["robot1/laser", "robot2/laser"], "robot2", "robot2/laser"),
        ("laser", ["front_laser"], "", None),
        ("", ["laser"], "", None),
    ],
)
def test_frames_are_found_with_and_without_prefix(
    name: str, frames: list[str], prefix: str, expected: str | None
) -> None:
    assert resolve_frame(name, frames, prefix) == expected


def test_lists_of_frames_are_short() -> None:
    assert listed_frames(["b", "a"]) == "a, b"
    assert listed_frames([]) == "none"
    assert "\n" not in listed_frames(["a\nb" * 100])
    assert len(listed_frames(["a\nb" * 100])) <= 40
    assert listed_frames(f"f{number}" for number in range(9)) == "f0, f1, f2, f3, … (9 frames)"


@given(st.floats(-3.1, 3.1), st.floats(-3.1, 3.1), st.booleans())
def test_a_level_mount_turns_beams_to_where_they_point(yaw: float, beam: float, is_upside_down: bool) -> None:
    turned = RigidTransform((0.3, -0.2, 0.5), (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)))
    if is_upside_down:
        turned = turned @ RigidTransform(rotation=(1.0, 0.0, 0.0, 0.0))
    expected = matrix(turned) @ [2 * math.cos(beam), 2 * math.sin(beam), 0.0, 1.0]
    mount = Mount.from_transform(turned)
    scan = mount.upright(Scan(0.0, np.array([2.0, np.nan]), beam, 0.1, 0.1, 10.0))
    np.testing.assert_allclose(mount.pose.transform(scan.points()), [expected[:2]], atol=1e-9)
    assert mount.is_upside_down == is_upside_down


def test_a_mount_reads_as_the_option_that_states_it() -> None:
    assert str(Mount(Pose(0.1, -0.25, math.pi / 2))) == "0.100,-0.250,90.0"
