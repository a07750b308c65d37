"""Messages encoded from wherry's values."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wherry.ros import messages as ros
from wherry.ros.decoding import decode_pose
from wherry.ros.encoding import encode_path, encode_pose, encode_pose_array, encode_stamp
from wherry.space.pose import Pose


def test_stamps_are_rounded_to_nanoseconds() -> None:
    assert encode_stamp(0.05) == ros.Time(0, 50_000_000)
    assert encode_stamp(2.9999999999) == ros.Time(3, 0)


def test_headings_are_counter_clockwise_about_z() -> None:
    quaternion = encode_pose(Pose(theta=math.pi / 2)).orientation
    assert (quaternion.x, quaternion.y) == (0.0, 0.0)
    assert quaternion.z == pytest.approx(math.sqrt(0.5))
    assert quaternion.w == pytest.approx(math.sqrt(0.5))


def test_the_poses_of_a_path_are_oriented_towards_the_next_point() -> None:
    path = encode_path(np.array([[0, 0], [1, 0], [1, 1]], np.float32), 1.0, "map")
    headings = [decode_pose(stamped.pose).theta for stamped in path.poses]
    assert headings == pytest.approx([0.0, math.pi / 2, math.pi / 2])
    assert len(encode_path(np.empty((0, 2)), 1.0, "map").poses) == 0
    assert decode_pose(encode_path(np.array([[2.0, 3.0]]), 1.0, "map").poses[0].pose) == Pose(2.0, 3.0, 0.0)


def test_particles_are_encoded_as_poses() -> None:
    message = encode_pose_array(np.array([[1, 2, 0.5], [3, 4, -0.5]], np.float32), 2.0, "map")
    assert [decode_pose(pose).x for pose in message.poses] == [1.0, 3.0]
    assert decode_pose(message.poses[1]).theta == pytest.approx(-0.5)
