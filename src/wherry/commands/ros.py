"""``wherry ros1`` and ``wherry ros2``: the simulator for any ROS stack, the agent on any ROS robot."""

from __future__ import annotations

import contextlib
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wherry.commands.common import (
    BoxesOption,
    JsonOption,
    LearnerOption,
    MapOption,
    QuietOption,
    RulesOption,
    SeedOption,
    WorldArgument,
    console_for,
    help_without_command,
    one_of,
    print_json,
)
from wherry.commands.recording import RecordOption, recorded_transport
from wherry.commands.watching import DEFAULT_HOST, DEFAULT_PORT, HostOption, PortOption, ViewOption, trace_sink

if TYPE_CHECKING:
    import threading
    from collections.abc import Iterator

    from wherry.ros.names import RosNames
    from wherry.ros.transports.protocol import Transport

NamesOption = Annotated[
    Path | None, typer.Option("--names", help="A YAML file with namespace, frame_prefix, topics, frames and rates.")
]
NamespaceOption = Annotated[str, typer.Option(envvar="ROS_NAMESPACE", help="Before every relative topic name.")]
PrefixOption = Annotated[str, typer.Option(help="Before every frame but the map's.")]
RemapOption = Annotated[list[str] | None, typer.Option("--remap", help="NAME:=NEW for a topic; may be repeated.")]
LaunchArguments = Annotated[
    list[str] | None, typer.Argument(metavar="[NAME:=NEW]...", help="Remappings, and what else roslaunch appends.")
]
InterfaceOption = Annotated[
    str, typer.Option(help="ROS 2: a network interface, such as eth0. ROS 1: an address, as ROS_IP. Else loopback.")
]


def ros_app(generation: int) -> typer.Typer:
    """The commands of one generation of ROS."""
    app = typer.Typer(
        invoke_without_command=True,
        callback=help_without_command,
        rich_markup_mode=None,
        help=f"Speak ROS {generation}.",
    )
    _add_simulate(app, generation)
    _add_deliver(app, generation)
    _add_monitor(app, generation)
    if generation == 2:
        _add_gazebo_latch(app)
    return app


def _add_simulate(app: typer.Typer, generation: int) -> None:
    @app.command()
    def simulate(
        world: WorldArgument,
        arguments: LaunchArguments = None,
        boxes: BoxesOption = None,
        rate: Annotated[float, typer.Option(help="Simulated seconds a second.")] = 1.0,
        duration: Annotated[float | None, typer.Option(min=0, help="Simulated seconds after which to end.")] = None,
        seed: SeedOption = 0,
        names: NamesOption = None,
        namespace: NamespaceOption = "",
        frame_prefix: PrefixOption = "",
        remap: RemapOption = None,
        interface: InterfaceOption = "",
        record: RecordOption = None,
        as_json: JsonOption = False,
        quiet: QuietOption = False,
    ) -> None:
        """A simulated robot with /scan, /odom, /tf and /clock that obeys /cmd_vel; until Ctrl-C."""
        from wherry.pipelines.delivery import simulator as ros_simulation
        from wherry.ros.names import load_names

        name, remappings = from_launch(arguments, "wherry_simulator", remap)
        settings = ros_simulation.Settings(world=world, boxes=boxes, seed=seed, rate=rate)
        called = load_names(names, namespace=namespace, frame_prefix=frame_prefix, remappings=remappings)
        simulation = ros_simulation.prepare(settings)
        console = console_for(as_json=as_json, quiet=quiet)

        with (
            open_transport(generation, name, namespace, interface) as transport,
            recorded_transport(record, transport, called) as recorded,
            _asked_to_end() as asked,  # innermost: a recording alone would end with the signal, and say nothing
        ):

            def is_over() -> bool:
                return asked.is_set() or (duration is not None and simulation.time >= duration)

            _describe_robot(transport, called)
            console.print(f"{simulation.plan.name} at {rate:g} × real time; Ctrl-C ends it.", highlight=False)
            ros_simulation.node_of(simulation, recorded, called, rate).run(is_over)
        result = ros_simulation.verdict(simulation)
        console.print(
            f"{result['sim_seconds']:.1f} s, {result['delivered']} of {result['boxes']} boxes delivered, "
            f"{result['collisions']} collisions",
            highlight=False,
        )
        if as_json:
            print_json(result)


def _add_deliver(app: typer.Typer, generation: int) -> None:
    @app.command()
    def deliver(
        arguments: LaunchArguments = None,
        warehouse: Annotated[
            list[str] | None,
            typer.Option(help="X,Y of a cell of the warehouse, m, as seen from the start, x ahead; may be repeated."),
        ] = None,
        cell_size: Annotated[float, typer.Option(help="The cells' side, m.")] = 0.6,
        map_file: MapOption = None,
        rules: RulesOption = None,
        learner: LearnerOption = "bayes",
        body: Annotated[Path | None, typer.Option(help="A YAML file with the robot's shape and limits.")] = None,
        mapping: Annotated[
            str, typer.Option(help="Whose map: own, or ros for /map.", autocompletion=one_of(("own", "ros")))
        ] = "own",
        localization: Annotated[
            str,
            typer.Option(
                help="Whose pose: own, or ros for map → odom on /tf, or /amcl_pose.",
                autocompletion=one_of(("own", "ros")),
            ),
        ] = "own",
        wait: Annotated[float, typer.Option(min=0, help="Seconds to wait for the robot, a map, a pose.")] = 30.0,
        use_sim_time: Annotated[
            bool | None,
            typer.Option("--use-sim-time/--use-real-time", help="Without it: whether anybody publishes /clock."),
        ] = None,
        stamped: Annotated[bool, typer.Option("--stamped", help="Send TwistStamped (ROS 2).")] = False,
        seed: SeedOption = 0,
        names: NamesOption = None,
        namespace: NamespaceOption = "",
        frame_prefix: PrefixOption = "",
        remap: RemapOption = None,
        interface: InterfaceOption = "",
        out: Annotated[Path | None, typer.Option(help="Where to write map and rules.")] = None,
        record: RecordOption = None,
        view: ViewOption = False,
        host: HostOption = DEFAULT_HOST,
        port: PortOption = DEFAULT_PORT,
        as_json: JsonOption = False,
        quiet: QuietOption = False,
    ) -> None:
        """The agent on a robot of ROS: it explores, maps, learns what its actions do, and delivers every box."""
        from wherry.files import make_folder
        from wherry.kernels import are_compiled
        from wherry.pipelines.delivery import ros as ros_delivery
        from wherry.pipelines.delivery import simulated as delivery
        from wherry.pipelines.delivery.agent import delivery_learner
        from wherry.ros.body_files import load_body
        from wherry.ros.names import load_names
        from wherry.ros.nodes.agent import AgentNode
        from wherry.ros.nodes.robot import RobotLostError, RosRobot
        from wherry.space.map_files import load_map
        from wherry.trace.records import combine_sinks
        from wherry.views.terminal import DeliveryProgress, print_rules

        name, remappings = from_launch(arguments, "wherry_agent", remap)
        called = load_names(names, namespace=namespace, frame_prefix=frame_prefix, remappings=remappings)
        owns_map = ros_delivery.is_own("--mapping", mapping)
        owns_pose = ros_delivery.is_own("--localization", localization)
        order = ros_delivery.order_from(warehouse or (), cell_size)
        knowledge = delivery_learner(learner, rules)
        grid = None if map_file is None else load_map(map_file)
        shape = load_body(body)
        if out is not None:
            make_folder(out)
        console = console_for(as_json=as_json, quiet=quiet)
        if not are_compiled():
            console.print("Compiling the inner loops; that takes half a minute, and is done once.")
            delivery.warm_up()
        with (
            open_transport(generation, name, namespace, interface) as connection,
            recorded_transport(record, connection, called) as transport,
            RosRobot(transport, called, shape, stamped=stamped) as robot,
        ):
            console.print("Waiting for the robot.")
            robot.wait_until_ready(wait, use_sim_time=use_sim_time)
            stack = ros_delivery.Stack(robot, transport, called, wait, owns_map=owns_map, owns_pose=owns_pose)
            with (
                AgentNode(robot, transport, called, owns_map=owns_map, owns_pose=owns_pose) as node,
                trace_sink("wherry: ROS", out, console, view=view, host=host, port=port) as sink,
                DeliveryProgress(console, 0) as progress,
            ):
                if grid is not None:
                    node.tell_map(grid)
                told = combine_sinks(node, progress, sink)
                try:
                    figures, ready = ros_delivery.run(robot, stack, order, knowledge, grid, told, seed)
                except RobotLostError as error:
                    typer.echo(f"wherry: {error}", err=True)
                    raise typer.Exit(1) from error
        if out is not None:
            ros_delivery.write(out, ready, knowledge)
        print_rules(console, knowledge.sentences())
        if as_json:
            print_json(asdict(figures))
        raise typer.Exit(1 if figures.remaining else 0)


def _add_monitor(app: typer.Typer, generation: int) -> None:
    @app.command()
    def monitor(
        duration: Annotated[float, typer.Option(min=0, help="Seconds to listen.")] = 60.0,
        names: NamesOption = None,
        namespace: NamespaceOption = "",
        remap: RemapOption = None,
        interface: InterfaceOption = "",
        as_json: JsonOption = False,
        quiet: QuietOption = False,
    ) -> None:
        """Listen to a robot and its agent: messages that are missing, and the time from a scan to a velocity."""
        import time

        from wherry.ros.names import load_names
        from wherry.ros.nodes.monitor import Monitor
        from wherry.views.metrics_tables import ROS_TRAFFIC_METRICS
        from wherry.views.terminal import print_metrics

        called = load_names(names, namespace=namespace, remappings=remap or ())
        console = console_for(as_json=as_json, quiet=quiet)
        with open_transport(generation, "wherry_monitor", namespace, interface) as transport:
            listener = Monitor(transport, called)
            console.print(f"Listening for {duration:g} s; Ctrl-C ends it.", highlight=False)
            with contextlib.suppress(KeyboardInterrupt):
                time.sleep(duration)
            figures = listener.figures()
        print_metrics(console, f"ROS {generation}, heard", figures, ROS_TRAFFIC_METRICS)
        if as_json:
            print_json(figures)
        raise typer.Exit(0 if figures["scans"] else 1)


def _add_gazebo_latch(app: typer.Typer) -> None:
    @app.command()
    def gazebo_latch(
        site: Annotated[Path, typer.Argument(metavar="LATCH.YAML", help="Of an export; its launch file starts this.")],
        names: NamesOption = None,
        namespace: NamespaceOption = "",
        remap: RemapOption = None,
        interface: InterfaceOption = "",
        quiet: QuietOption = False,
    ) -> None:
        """Make Gazebo's detachable joints the latch that the agent works; until Ctrl-C."""
        from wherry.gazebo.latch import GazeboLatch, load_site
        from wherry.ros.names import load_names

        world = load_site(site)
        called = load_names(names, namespace=namespace, remappings=remap or ())
        console = console_for(as_json=False, quiet=quiet)
        with open_transport(2, "wherry_gazebo_latch", namespace, interface) as transport, _asked_to_end() as asked:
            console.print(f"A latch for {world.boxes} boxes, once Gazebo runs; Ctrl-C ends it.", highlight=False)
            GazeboLatch(world, transport, called).run(asked.is_set)


def from_launch(arguments: list[str] | None, name: str, remap: list[str] | None) -> tuple[str, list[str]]:
    """What roslaunch appends to a node's command line: ``__name:=``, which names the node, ``__log:=``, remappings.

    Returns:
        The node's name, and all remappings.
    """
    remappings = list(remap or ())
    for argument in arguments or ():
        key, _, value = argument.partition(":=")
        if key == "__name" and value:
            name = value
        elif not key.startswith("__"):
            remappings.append(argument)
    return name, remappings


def _describe_robot(transport: Transport, names: RosNames) -> None:
    """Tell the ROS system what the robot looks like, and that time is simulated."""
    from wherry.ros.description import robot_description
    from wherry.simulation.model import robot_urdf

    transport.announce_sim_time()
    transport.publish_robot_description(names.topics.robot_description, robot_description(robot_urdf()))


@contextlib.contextmanager
def _asked_to_end() -> Iterator[threading.Event]:
    """Set once somebody presses Ctrl-C, or a launch file ends the node."""
    import signal
    import threading

    asked = threading.Event()
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, lambda *_: asked.set()) for number in numbers]
    try:
        yield asked
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


def open_transport(generation: int, name: str, namespace: str, interface: str) -> Transport:
    """Become a node."""
    if generation == 1:
        from wherry.ros.transports.ros1 import Ros1Transport

        return Ros1Transport(name, namespace, interface)
    from wherry.ros.transports.ros2 import LOOPBACK, Ros2Transport

    return Ros2Transport(interface or LOOPBACK)
