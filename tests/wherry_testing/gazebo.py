"""A stand-in for a Gazebo Sim server and its bridge, with their topics and without a latch node.

Poses and joints are MuJoCo's. A joint behaves as Gazebo's DetachableJoint since 6.15: it begins attached, ignores
requests that change nothing, and publishes its state once when it changes.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from wherry.gazebo.latch_settings import GazeboLatchSettings, format_latch_settings
from wherry.gazebo.latch_topics import ATTACHED, DETACHED, OPEN, close_topic, pose_topic, removal_topic, state_topic
from wherry.robot import Odometry, Scan
from wherry.ros import messages as ros
from wherry.ros.encoding import encode_header, encode_pose
from wherry.ros.names import load_names
from wherry.ros.nodes.simulator import SimulatorNode, simulator_node
from wherry.ros.transports.protocol import Transport
from wherry.simulation import Simulation
from wherry.simulation.physics import Physics
from wherry.space.pose import Pose

NEAR = """\
wherry-world: 1
name: near

+---+---+---+---+
|     o         |
+   +   +   +   +
|     >   o   w |
+---+---+---+---+
"""
NO_LATCH = load_names(remappings=["latch/command:=/unused/command", "latch/state:=/unused/state"])


class FakeGazebo:
    """A `SimulatedWorld` with Gazebo's joints and topics.

    Args:
        simulation: Simulation with the world's physics.
        transport: The bridge's connection to ROS.

    Attributes:
        attached: Boxes whose joint is attached.
        removed: Boxes that were moved out of the building.
        before_step: Called before each step of the physics.
    """

    def __init__(self, simulation: Simulation, transport: Transport) -> None:
        self.simulation = simulation
        self.transport = transport
        self.attached = set(self.boxes)
        self.removed: list[int] = []
        self.before_step: Callable[[], None] = lambda: None
        self._requests: deque[tuple[str, int]] = deque()  # carried out between two steps of the physics
        transport.subscribe(OPEN, lambda _: self._requests.extend(("detach", box) for box in self.boxes))
        for box in self.boxes:
            for request, topic in (("attach", close_topic(box)), ("remove", removal_topic(box))):
                transport.subscribe(topic, partial(self._on_request, request, box))

    @property
    def boxes(self) -> range:
        return range(len(self.simulation.plan.boxes))

    @property
    def robot(self) -> Any:
        return self.simulation.robot

    @property
    def time(self) -> float:
        return self.simulation.time

    @property
    def physics(self) -> Physics:
        return self.simulation.physics

    def node(self, rate: float) -> SimulatorNode:
        """The robot's driver node without its latch."""
        node = simulator_node(self.simulation, self.transport, NO_LATCH, rate)
        node._world = self
        return node

    def advance(self) -> None:
        if self.time < 2.0:  # the world opens its joints itself
            self._requests.extend(("detach", box) for box in self.boxes)
        while self._requests:
            self.execute(*self._requests.popleft())
        self.before_step()
        self.simulation.advance()
        self.publish_poses()

    def measure(self) -> list[Scan | Odometry]:
        return self.simulation.measure()

    def publish_poses(self) -> None:
        """Publish the models' poses."""
        header = encode_header(self.time, "world")
        poses = {"wherry": self.physics.robot_pose}
        poses |= {f"box_{box}": Pose(*self.physics.box_positions[box, :2].tolist()) for box in self.boxes}
        for model, pose in poses.items():
            self.transport.publish(pose_topic(model), ros.PoseStamped(header, encode_pose(pose)))

    def _on_request(self, request: str, box: int, message: ros.Empty) -> None:
        del message
        self._requests.append((request, box))

    def execute(self, request: str, box: int) -> None:
        if request == "remove":
            self.removed.append(box)
            self.physics.take_in(box)
        elif (request == "attach") != (box in self.attached):
            self.attached ^= {box}
            self._hold(request, box)
            state = ATTACHED if request == "attach" else DETACHED
            self.transport.publish(state_topic(box), ros.String(state))

    def _hold(self, request: str, box: int) -> None:
        if request == "attach":
            self.physics.hold(box)
        else:
            self.physics.release(box)
        self.simulation._held = box if request == "attach" else None  # as the referee reads it


class RunningGazebo:
    """The stand-in in a thread."""

    def __init__(self, gazebo: FakeGazebo, rate: float) -> None:
        self.gazebo = gazebo
        self.over = threading.Event()
        self.thread = threading.Thread(target=gazebo.node(rate).run, args=(self.over.is_set,))
        self.thread.start()

    def stop(self) -> None:
        self.over.set()
        self.thread.join()


def settings_file(tmp_path: Path, settings: GazeboLatchSettings) -> str:
    """Write the latch's settings; returns the file's path."""
    path = tmp_path / "latch.yaml"
    path.write_text(format_latch_settings(settings))
    return str(path)
