"""Run by the real rclpy in its own environment: drives a robot, and prints what it received as JSON.

Arguments: speed (m/s), duration (s), and "stamped" or "plain" velocities.
"""

import json
import sys
import time

import rclpy
from geometry_msgs.msg import PoseArray, Twist, TwistStamped
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, LaserScan

speed, seconds, stamped = float(sys.argv[1]), float(sys.argv[2]), sys.argv[3] == "stamped"
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL, reliability=ReliabilityPolicy.RELIABLE)
received = {}


def keep(name):
    def append(message):
        received.setdefault(name, []).append(message)

    return append


def stamp(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


rclpy.init()
node = rclpy.create_node("oracle")
node.create_subscription(LaserScan, "/scan", keep("scan"), qos_profile_sensor_data)
node.create_subscription(Odometry, "/odom", keep("odom"), 50)
node.create_subscription(Clock, "/clock", keep("clock"), qos_profile_sensor_data)
node.create_subscription(JointState, "/joint_states", keep("joints"), 50)
node.create_subscription(OccupancyGrid, "/map", keep("map"), LATCHED)
node.create_subscription(PoseArray, "/particlecloud", keep("particles"), 10)
node.create_subscription(Path, "/plan", keep("plan"), 10)
publisher = node.create_publisher(TwistStamped if stamped else Twist, "/cmd_vel", 10)

deadline = time.monotonic() + 40.0
while not {"scan", "odom", "map"} <= received.keys() and time.monotonic() < deadline:
    rclpy.spin_once(node, timeout_sec=0.1)
end = time.monotonic() + seconds
while time.monotonic() < end:
    if speed and "odom" in received:
        message = TwistStamped() if stamped else Twist()
        if stamped:
            message.header.stamp = received["odom"][-1].header.stamp
        (message.twist if stamped else message).linear.x = speed
        publisher.publish(message)
    until = time.monotonic() + 0.05
    while time.monotonic() < until:
        rclpy.spin_once(node, timeout_sec=0.01)
print(  # noqa: T201 - the result
    json.dumps(
        {
            "counts": {name: len(messages) for name, messages in received.items()},
            "scans": {stamp(scan): [float(value) for value in scan.ranges] for scan in received.get("scan", [])[-3:]},
            "scan": [
                (s.header.frame_id, s.angle_min, s.angle_increment, s.range_max) for s in received.get("scan", [])[:1]
            ],
            "odom": {
                stamp(odom): [odom.pose.pose.position.x, odom.pose.pose.orientation.z, odom.twist.twist.linear.x]
                for odom in received.get("odom", [])
            },
            "frames": [(odom.header.frame_id, odom.child_frame_id) for odom in received.get("odom", [])[:1]],
            "joints": [list(state.name) for state in received.get("joints", [])[:1]],
            "map": [
                (grid.info.width, grid.info.height, grid.info.resolution, grid.info.origin.position.x, list(grid.data))
                for grid in received.get("map", [])
            ],
            "particles": [len(cloud.poses) for cloud in received.get("particles", [])[:1]],
        }
    )
)
