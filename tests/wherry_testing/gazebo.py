"""A stand-in for a Gazebo Sim server and its bridge: it speaks what they speak, and knows of no latch.

The models' places and the joints are MuJoCo's. A joint does as Gazebo's DetachableJoint since 6.15: it begins attached,
ignores in silence what is so already, and tells its state when it changes, once.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any

from wherry.gazebo.latch import OPEN, close_topic, pose_topic, state_topic, take_in_topic
from wherry.pipelines.delivery.simulator import node_of
from wherry.robot import Odometry, Scan
from wherry.ros import messages as ros
from wherry.ros.encoding import encode_header, encode_pose
from wherry.ros.names import load_names
from wherry.ros.nodes.simulator import SimulatorNode
from wherry.ros.transports.protocol import Transport
from wherry.simulation import Simulation
from wherry.simulation.physics import Physics
from wherry.space.pose import Pose

NO_LATCH = load_names(remappings=["latch/command:=/nobody/command", "latch/state:=/nobody/state"])


class Gazebo:
    """A world, for `SimulatorNode`.

    Args:
        simulation: Its physics.
        transport: The bridge's.
    """

    def __init__(self, simulation: Simulation, transport: Transport) -> None:
        self.simulation = simulation
        self.transport = transport
        self.attached = set(self.boxes)
        self.taken_in: list[int] = []
        self.before_step: Callable[[], None] = lambda: None
        self.asked: deque[tuple[str, int]] = deque()  # is done between two steps of the physics
        transport.subscribe(OPEN, lambda _: self.asked.extend(("detach", box) for box in self.boxes))
        for box in self.boxes:
            for verb, topic in (("attach", close_topic(box)), ("take in", take_in_topic(box))):
                transport.subscribe(topic, partial(self._ask, verb, box))

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
        """The rest of the robot's driver software, with this as its world."""
        node = node_of(self.simulation, self.transport, NO_LATCH, rate)
        node._world = self
        return node

    def advance(self) -> None:
        if self.time < 2.0:  # publishers that the world brings along
            self.asked.extend(("detach", box) for box in self.boxes)
        while self.asked:
            self.work(*self.asked.popleft())
        self.before_step()
        self.simulation.advance()
        self.tell()

    def measure(self) -> list[Scan | Odometry]:
        return self.simulation.measure()

    def tell(self) -> None:
        """Where the models are."""
        header = encode_header(self.time, "world")
        places = {"wherry": self.physics.robot_pose}
        places |= {f"box_{box}": Pose(*self.physics.box_positions[box, :2].tolist()) for box in self.boxes}
        for model, place in places.items():
            self.transport.publish(pose_topic(model), ros.PoseStamped(header, encode_pose(place)))

    def _ask(self, verb: str, box: int, message: ros.Empty) -> None:
        del message
        self.asked.append((verb, box))

    def work(self, verb: str, box: int) -> None:
        if verb == "take in":
            self.taken_in.append(box)
            self.physics.take_in(box)
        elif (verb == "attach") != (box in self.attached):
            self.attached ^= {box}
            self._hold(verb, box)
            told = {"attach": "attached", "detach": "detached"}[verb]
            self.transport.publish(state_topic(box), ros.String(told))

    def _hold(self, verb: str, box: int) -> None:
        if verb == "attach":
            self.physics.hold(box)
        else:
            self.physics.release(box)
        self.simulation._held = box if verb == "attach" else None  # for the referee
