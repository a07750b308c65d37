"""A ROS 1 node independent of wherry: it publishes on request, and reports what it receives.

Run by Debian's Python in its own process; requests are lines of JSON on standard input, answers and received messages
lines of JSON on standard output.
"""

import importlib
import json
import sys
import threading
import time

import genpy
import rospy
import tf2_ros
from sensor_msgs.msg import LaserScan

OUTPUT_LOCK = threading.Lock()


def report(**values):
    with OUTPUT_LOCK:
        print(json.dumps(values), flush=True)  # noqa: T201


def message_class(type_name):
    package, name = type_name.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


def plain(value):
    if hasattr(value, "__slots__"):
        return {name: plain(getattr(value, name)) for name in value.__slots__}
    if isinstance(value, list | tuple | bytes):
        return [plain(one) for one in value]
    return value


def wait_for_connection(end):
    deadline = time.monotonic() + 1.0
    while not end.get_num_connections() and time.monotonic() < deadline:
        time.sleep(0.01)


class Node:
    def __init__(self):
        self.publishers = {}
        self.listener = None
        self.relayed = None

    def listen(self, request):
        topic = request["topic"]

        def callback(message):
            report(topic=topic, at=time.monotonic(), message=plain(message))

        kind = message_class(request["type"])
        listener = rospy.Subscriber(topic, kind, callback, queue_size=1000, buff_size=1 << 22, tcp_nodelay=True)
        wait_for_connection(listener)

    def send(self, request):
        topic, kind = request["topic"], message_class(request["type"])
        if topic not in self.publishers:
            self.publishers[topic] = rospy.Publisher(topic, kind, queue_size=1000, latch=request["latch"])
            wait_for_connection(self.publishers[topic])
        message = kind()
        genpy.message.fill_message_args(message, [request["message"]])
        self.publishers[topic].publish(message)

    def stop_sending(self, request):
        self.publishers.pop(request["topic"]).unregister()

    def relay(self, request):
        """Forward the scans of a topic to another one, in mode "pass", or faulty: "silent", "nan" or "frame"."""
        if self.relayed is None:
            publisher = rospy.Publisher(request["to"], LaserScan, queue_size=100, tcp_nodelay=True)
            rospy.Subscriber(
                request["topic"],
                LaserScan,
                lambda scan: self.pass_on(scan, publisher),
                queue_size=100,
                tcp_nodelay=True,
            )
        self.relayed = request["mode"]

    def pass_on(self, scan, publisher):
        if self.relayed == "nan":
            scan.angle_increment = float("nan")
        if self.relayed == "frame":
            scan.header.frame_id = "camera"
        if self.relayed != "silent":
            publisher.publish(scan)

    def parameter(self, request):
        return rospy.get_param(request["name"])

    def transform(self, request):
        if self.listener is None:
            self.buffer = tf2_ros.Buffer()
            self.listener = tf2_ros.TransformListener(self.buffer)
        deadline = time.monotonic() + request["timeout"]
        while True:
            try:
                at = rospy.Time(*request["at"])
                found = self.buffer.lookup_transform(request["target"], request["source"], at).transform
                break
            except Exception as error:
                if time.monotonic() > deadline:
                    return str(error)
                time.sleep(0.05)
        shift, turn = found.translation, found.rotation
        return [shift.x, shift.y, shift.z, turn.x, turn.y, turn.z, turn.w]


def main():
    rospy.init_node(sys.argv[1], disable_rostime=True, disable_rosout=True)
    node = Node()
    for line in sys.stdin:
        request = json.loads(line)
        report(answer=getattr(node, request["do"].replace(" ", "_"))(request))


main()
