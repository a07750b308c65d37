from .body_files import BodyParameters, load_body
from .decoding import (
    MessageError,
    decode_laser_scan,
    decode_occupancy_grid,
    decode_odometry,
    decode_transform,
    decode_twist,
)
from .description import robot_description
from .encoding import (
    encode_laser_scan,
    encode_occupancy_grid,
    encode_odometry,
    encode_transform,
    encode_twist,
)
from .names import Frames, Rates, RosNames, Topics, load_names
from .topics import QosProfile, Topic
from .transforms import StampedTransform

__all__ = [
    "BodyParameters",
    "Frames",
    "MessageError",
    "QosProfile",
    "Rates",
    "RosNames",
    "StampedTransform",
    "Topic",
    "Topics",
    "decode_laser_scan",
    "decode_occupancy_grid",
    "decode_odometry",
    "decode_transform",
    "decode_twist",
    "encode_laser_scan",
    "encode_occupancy_grid",
    "encode_odometry",
    "encode_transform",
    "encode_twist",
    "load_body",
    "load_names",
    "robot_description",
]
