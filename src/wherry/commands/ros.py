"""``wherry ros1`` and ``wherry ros2``: the simulated robot for any ROS stack, and the agent on any ROS robot."""

from __future__ import annotations

import contextlib
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wherry.commands.common import (
    BoxesOption,
    LearnerOption,
    MapOption,
    OutputOptions,
    QuietOption,
    RulesOption,
    SeedOption,
    WorldArgument,
    console_for,
    help_without_command,
    name_completion,
    print_json,
)
from wherry.commands.option_groups import with_option_groups
from wherry.commands.recording import RecordOption, recorded_transport
from wherry.commands.watching import PageOptions, trace_sink

if TYPE_CHECKING:
    import threading
    from collections.abc import Iterator

    from rich.console import Console

    from wherry.pipelines.delivery.ros import RosDeliverySettings, RosDeliverySummary
    from wherry.ros.names import RosNames
    from wherry.ros.nodes.robot import RosRobot
    from wherry.ros.transports.protocol import Transport
    from wherry.space.occupancy import OccupancyGrid

LaunchArguments = Annotated[
    list[str] | None,
    typer.Argument(metavar="[NAME:=NEW]...", help="Remappings, and other arguments that roslaunch appends."),
]


@dataclass(frozen=True)
class _NameOptions:
    """The file of names, and the prefix of topic names."""

    names: Annotated[
        Path | None,
        typer.Option("--names", help="A YAML file with namespace, frame_prefix, topics, frames and rates."),
    ] = None
    namespace: Annotated[str, typer.Option(envvar="ROS_NAMESPACE", help="Prefix of every relative topic name.")] = ""


@dataclass(frozen=True)
class _PrefixOptions:
    """The prefix of frame names."""

    frame_prefix: Annotated[str, typer.Option(help="Prefix of every frame name but the map's.")] = ""


@dataclass(frozen=True)
class _ConnectionOptions:
    """Remapped topics, and the network interface."""

    remap: Annotated[list[str] | None, typer.Option("--remap", help="NAME:=NEW for a topic; may be repeated.")] = None
    interface: Annotated[
        str,
        typer.Option(
            help="ROS 2: a network interface, such as eth0; ROS 1: an address, as ROS_IP. By default loopback."
        ),
    ] = ""


# Dataclasses inherit fields from the last base to the first, which is the order of the options in the help.


@dataclass(frozen=True)
class TopicOptions(_ConnectionOptions, _NameOptions):
    """Options of a node that uses topics only: their names, and the network interface."""


@dataclass(frozen=True)
class NodeOptions(_ConnectionOptions, _PrefixOptions, _NameOptions):
    """Options of a node: names of topics and frames, and the network interface."""


@dataclass(frozen=True)
class DeliverOptions:
    """Options of a delivery: the order, the robot, and the providers of map and pose."""

    warehouse: Annotated[
        list[str] | None,
        typer.Option(
            help="Centre X,Y of a warehouse cell, m, relative to the robot's start, x ahead; may be repeated."
        ),
    ] = None
    cell_size: Annotated[float, typer.Option(help="The cells' side, m.")] = 0.6
    map_file: MapOption = None
    rules: RulesOption = None
    learner: LearnerOption = "bayes"
    body: Annotated[Path | None, typer.Option(help="A YAML file with the robot's shape and limits.")] = None
    mapping: Annotated[
        str,
        typer.Option(help="Provider of the map: own, or ros for /map.", autocompletion=name_completion(("own", "ros"))),
    ] = "own"
    localization: Annotated[
        str,
        typer.Option(
            help="Provider of the pose: own, or ros for map → odom on /tf, or /amcl_pose.",
            autocompletion=name_completion(("own", "ros")),
        ),
    ] = "own"
    wait: Annotated[float, typer.Option(min=0, help="Seconds to wait for the robot, a map, a pose.")] = 30.0
    use_sim_time: Annotated[
        bool | None,
        typer.Option(
            "--use-sim-time/--use-real-time",
            help="Whether the robot's clock is /clock; by default, if a node publishes it.",
        ),
    ] = None
    stamped: Annotated[bool, typer.Option("--stamped", help="Send TwistStamped (ROS 2).")] = False
    seed: SeedOption = 0


def ros_app(ros_version: int) -> typer.Typer:
    """The commands of ROS 1 or ROS 2."""
    app = typer.Typer(
        invoke_without_command=True,
        callback=help_without_command,
        rich_markup_mode=None,
        help=f"Run the simulated robot, the agent or a monitor as a ROS {ros_version} node.",
    )
    _add_simulate(app, ros_version)
    _add_deliver(app, ros_version)
    _add_monitor(app, ros_version)
    if ros_version == 2:
        _add_gazebo_latch(app)
    return app


# ---- simulate


def _add_simulate(app: typer.Typer, ros_version: int) -> None:
    @app.command()
    @with_option_groups
    def simulate(
        world: WorldArgument,
        arguments: LaunchArguments = None,
        boxes: BoxesOption = None,
        rate: Annotated[float, typer.Option(help="Simulated seconds per second.")] = 1.0,
        duration: Annotated[float | None, typer.Option(min=0, help="Simulated seconds after which to end.")] = None,
        seed: SeedOption = 0,
        *,
        node: NodeOptions,
        record: RecordOption = None,
        output: OutputOptions,
    ) -> None:
        """Simulate a robot that publishes /scan, /odom, /tf and /clock and obeys /cmd_vel, until Ctrl-C."""
        from wherry.pipelines.delivery.simulator import SimulatorSettings, build_simulation, referee_summary
        from wherry.ros.nodes.simulator import simulator_node

        node_name, names = parse_names(arguments, "wherry_simulator", node)
        simulation = build_simulation(SimulatorSettings(world=world, boxes=boxes, seed=seed, rate=rate))
        console = output.console()
        with (
            open_transport(ros_version, node_name, node.namespace, node.interface) as transport,
            recorded_transport(record, transport, names) as recorded,
            _termination_event() as terminated,  # innermost, so that SIGTERM does not interrupt the recording
        ):

            def is_over() -> bool:
                return terminated.is_set() or (duration is not None and simulation.time >= duration)

            _publish_description(transport, names)
            console.print(f"{simulation.plan.name} at {rate:g} × real time; Ctrl-C ends it.", highlight=False)
            simulator_node(simulation, recorded, names, rate).run(is_over)
        summary = referee_summary(simulation)
        console.print(
            f"{summary['sim_seconds']:.1f} s, {summary['delivered']} of {summary['boxes']} boxes delivered, "
            f"{summary['collisions']} collisions",
            highlight=False,
        )
        if output.as_json:
            print_json(summary)


def _publish_description(transport: Transport, names: RosNames) -> None:
    """Publish the robot's URDF, and that time is simulated."""
    from wherry.ros.description import robot_description
    from wherry.simulation.model import robot_urdf

    transport.announce_sim_time()
    transport.publish_robot_description(names.topics.robot_description, robot_description(robot_urdf()))


# ---- deliver


def _add_deliver(app: typer.Typer, ros_version: int) -> None:
    @app.command()
    @with_option_groups
    def deliver(
        arguments: LaunchArguments = None,
        *,
        task: DeliverOptions,
        node: NodeOptions,
        out: Annotated[Path | None, typer.Option(help="Folder to write map and rules to.")] = None,
        record: RecordOption = None,
        page: PageOptions,
        output: OutputOptions,
    ) -> None:
        """Run the agent on a ROS robot: explore, map, learn, and deliver every box."""
        from wherry.files import ensure_writable_folder
        from wherry.pipelines.delivery.ros import save
        from wherry.ros.body_files import load_body
        from wherry.ros.nodes.robot import RosRobot
        from wherry.views.terminal import print_rules

        node_name, names = parse_names(arguments, "wherry_agent", node)
        settings = parse_delivery(task)
        body = load_body(task.body)
        if out is not None:
            ensure_writable_folder(out)
        console = output.console()
        _compile_kernels(console)
        with (
            open_transport(ros_version, node_name, node.namespace, node.interface) as connection,
            recorded_transport(record, connection, names) as transport,
            RosRobot(transport, names, body, stamped=task.stamped) as robot,
        ):
            console.print("Waiting for the robot.")
            robot.wait_until_ready(task.wait, use_sim_time=task.use_sim_time)
            summary, grid = _deliver(robot, transport, names, settings, out, page, console)
        if out is not None:
            save(out, grid, settings.learner)
        print_rules(console, settings.learner.sentences())
        if output.as_json:
            print_json(asdict(summary))
        raise typer.Exit(1 if summary.remaining else 0)


def parse_delivery(task: DeliverOptions) -> RosDeliverySettings:
    """Check the options, and read map and rules.

    Raises:
        InputError: An option or a file is not valid.
    """
    from wherry.pipelines.delivery.agent import delivery_learner
    from wherry.pipelines.delivery.ros import RosDeliverySettings, parse_order, parse_provider
    from wherry.space.map_files import load_map

    return RosDeliverySettings(
        mapping=parse_provider("--mapping", task.mapping),
        localization=parse_provider("--localization", task.localization),
        order=parse_order(task.warehouse or (), task.cell_size),
        learner=delivery_learner(task.learner, task.rules),
        grid=None if task.map_file is None else load_map(task.map_file),
        timeout=task.wait,
        seed=task.seed,
    )


def _compile_kernels(console: Console) -> None:
    from wherry.kernels import are_kernels_cached
    from wherry.pipelines.delivery.simulated import warm_up

    if not are_kernels_cached():
        console.print("Compiling the inner loops, which takes half a minute and happens once.")
        warm_up()


def _deliver(
    robot: RosRobot,
    transport: Transport,
    names: RosNames,
    settings: RosDeliverySettings,
    out: Path | None,
    page: PageOptions,
    console: Console,
) -> tuple[RosDeliverySummary, OccupancyGrid]:
    """Run the agent on a robot that is ready; publish, record and show its trace."""
    from wherry.pipelines.delivery.ros import NavigationStack, Provider, run
    from wherry.ros.nodes.agent import AgentNode
    from wherry.ros.nodes.errors import RobotLostError
    from wherry.trace.records import combine_sinks
    from wherry.views.terminal import DeliveryProgress

    mapping, localization = settings.mapping, settings.localization
    stack = NavigationStack(
        robot, transport, names, mapping=mapping, localization=localization, timeout=settings.timeout
    )
    with (
        AgentNode(
            robot,
            transport,
            names,
            publishes_map=mapping is Provider.OWN,
            publishes_pose=localization is Provider.OWN,
        ) as node,
        trace_sink("wherry: ROS", out, console, page) as sink,
        DeliveryProgress(console, 0) as progress,
    ):
        if settings.grid is not None:
            node.publish_map(settings.grid)
        try:
            return run(robot, stack, settings, combine_sinks(node, progress, sink))
        except RobotLostError as error:
            typer.echo(f"wherry: {error}", err=True)
            raise typer.Exit(1) from error


# ---- monitor


def _add_monitor(app: typer.Typer, ros_version: int) -> None:
    @app.command()
    @with_option_groups
    def monitor(
        duration: Annotated[float, typer.Option(min=0, help="Seconds to listen.")] = 60.0,
        *,
        node: TopicOptions,
        output: OutputOptions,
    ) -> None:
        """Measure missing messages and the latency from scan to velocity."""
        import time

        from wherry.ros.names import load_names
        from wherry.ros.nodes.monitor import Monitor
        from wherry.views.metrics_tables import ROS_TRAFFIC_METRICS
        from wherry.views.terminal import print_metrics

        resolved = load_names(node.names, namespace=node.namespace, remappings=node.remap or ())
        console = output.console()
        with open_transport(ros_version, "wherry_monitor", node.namespace, node.interface) as transport:
            listener = Monitor(transport, resolved)
            console.print(f"Listening for {duration:g} s; Ctrl-C ends it.", highlight=False)
            with contextlib.suppress(KeyboardInterrupt):
                time.sleep(duration)
            statistics = listener.statistics()
        print_metrics(console, f"ROS {ros_version}, received", statistics, ROS_TRAFFIC_METRICS)
        if output.as_json:
            print_json(statistics)
        raise typer.Exit(0 if statistics["scans"] else 1)


# ---- gazebo-latch


def _add_gazebo_latch(app: typer.Typer) -> None:
    @app.command()
    @with_option_groups
    def gazebo_latch(
        settings_file: Annotated[
            Path, typer.Argument(metavar="LATCH.YAML", help="The file of an export; its launch file runs this command.")
        ],
        *,
        node: TopicOptions,
        quiet: QuietOption = False,
    ) -> None:
        """Operate Gazebo's detachable joints as the latch that the agent uses, until Ctrl-C."""
        from wherry.gazebo.latch import GazeboLatch
        from wherry.gazebo.latch_settings import load_latch_settings
        from wherry.ros.names import load_names

        settings = load_latch_settings(settings_file)
        resolved = load_names(node.names, namespace=node.namespace, remappings=node.remap or ())
        console = console_for(as_json=False, quiet=quiet)
        with (
            open_transport(2, "wherry_gazebo_latch", node.namespace, node.interface) as transport,
            _termination_event() as terminated,
        ):
            console.print(f"A latch for {settings.boxes} boxes, once Gazebo runs; Ctrl-C ends it.", highlight=False)
            GazeboLatch(settings, transport, resolved).run(terminated.is_set)


# ---- nodes


def parse_names(arguments: list[str] | None, node_name: str, node: NodeOptions) -> tuple[str, RosNames]:
    """Return a node's name and the names of its topics and frames.

    Args:
        arguments: Arguments that roslaunch appends to a command line: ``__name:=``, ``__log:=``, and remappings.
        node_name: Name of the node if there is no ``__name:=``.
        node: The command's options.

    Raises:
        InputError: A name is not valid.
    """
    from wherry.ros.names import load_names

    remappings = list(node.remap or ())
    for argument in arguments or ():
        key, _, value = argument.partition(":=")
        if key == "__name" and value:
            node_name = value
        elif not key.startswith("__"):
            remappings.append(argument)
    names = load_names(node.names, namespace=node.namespace, frame_prefix=node.frame_prefix, remappings=remappings)
    return node_name, names


@contextlib.contextmanager
def _termination_event() -> Iterator[threading.Event]:
    """An event that SIGINT (Ctrl-C) and SIGTERM (a launch file that ends) set."""
    import signal
    import threading

    terminated = threading.Event()
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, lambda *_: terminated.set()) for number in numbers]
    try:
        yield terminated
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


def open_transport(ros_version: int, name: str, namespace: str, interface: str) -> Transport:
    """Connect a node to ROS 1 or ROS 2."""
    if ros_version == 1:
        from wherry.ros.transports.ros1 import Ros1Transport

        return Ros1Transport(name, namespace, interface)
    from wherry.ros.transports.ros2 import Ros2Transport

    return Ros2Transport(interface) if interface else Ros2Transport()
