"""Every loader of users' files, with valid files to begin with and the mutations of their kind.

A new loader gets an entry in `LOADERS`: a function that writes valid files into an empty folder, the function that
loads them, and the check of what it returns.
"""

from __future__ import annotations

import gzip
import io
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
from PIL import Image

from fuzz import invariants
from fuzz.bag_seeds import write_bag
from fuzz.loader import Loader
from fuzz.mutations import (
    BYTES,
    TEXT,
    change_json,
    change_npz,
    change_png,
    change_sqlite,
    change_trace,
    change_yaml,
    gunzip_and,
    unzip_and,
)
from wherry.domains.delivery import delivery_grid
from wherry.evaluation import load_relations
from wherry.floorplan.world_files import find_world, format_world, load_world
from wherry.gazebo.latch_settings import GazeboLatchSettings, format_latch_settings, load_latch_settings
from wherry.learning.registry import RULE_LEARNERS
from wherry.learning.rule_files.files import load_rules, save_rules
from wherry.learning.rules import RuleLearner
from wherry.localization.parameter_files import load_parameters
from wherry.logs.lidar_log import LidarLog
from wherry.logs.odometry_files import with_odometry_file
from wherry.logs.options import ReadingOptions
from wherry.logs.reading import read_log
from wherry.logs.tables import read_odometry, read_trajectory
from wherry.mapping.graph_slam import GraphSlam
from wherry.mapping.saved_graph import load_graph, save_graph
from wherry.robot import Odometry, Scan, Velocity
from wherry.ros.bags.reading import read_bag
from wherry.ros.body_files import default_body_text, load_body
from wherry.ros.names import load_names
from wherry.space.map_files import load_map, save_map
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry.space.wean_map import load_wean_map
from wherry.trace.recordings import TraceRecorder, load_trace
from wherry_testing.runs import short_run


def _writer(name: str, content: str | bytes) -> Callable[[Path], Path]:
    """A function that writes one file."""

    def write(folder: Path) -> Path:
        path = folder / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


def _carmen_log() -> str:
    """A log of each kind of CARMEN's messages."""
    lines = ["# CARMEN log", "PARAM robot_frontlaser_offset 0.2 0 x 0"]
    for step in range(8):
        time, x = 100.0 + 0.5 * step, 0.1 * step
        ranges = " ".join(f"{1.0 + 0.1 * beam + 0.01 * step:.2f}" for beam in range(12))
        lines.append(f"ODOM {x:.3f} 0.5 0.1 0.2 0 0 {time - 0.1} host {time - 0.1}")
        if step % 2:
            lines.append(f"FLASER 12 {ranges} {x + 0.2:.3f} 0.5 0.1 {x:.3f} 0.5 0.1 {time} host {time}")
        else:
            pose = f"{x + 0.2:.3f} 0.5 0.1 {x:.3f} 0.5 0.1 0 0 0.3 0.3 0"
            lines.append(f"ROBOTLASER1 0 -1.5 3.0 0.27 50.0 0.01 0 12 {ranges} 0 {pose} {time} host {time}")
    return "\n".join(lines) + "\n"


def _read_odometry_of_log(path: Path) -> LidarLog:
    """A log with the odometry of a file besides it."""
    with tempfile.TemporaryDirectory() as folder:
        log = read_log(_writer("drive.log", _carmen_log())(Path(folder)))
    return with_odometry_file(log, path)


def _wean_log() -> str:
    """A log of Wean Hall's messages."""
    ranges = " ".join(str(100 + 3 * beam) for beam in range(180))
    lines = [
        f"O {10 * step} 20 0.5 {step}.1\nL {10 * step} 20 0.5 {10 * step + 25} 20 0.5 {ranges} {step}.2"
        for step in range(4)
    ]
    return "\n".join(lines) + "\n"


def _grid() -> OccupancyGrid:
    """A map of all kinds of cells."""
    probability = np.linspace(0.0, 1.0, 12 * 9, dtype=np.float32).reshape(9, 12)
    probability[4] = 0.5
    return OccupancyGrid(probability, 0.05, Pose(-1.0, -2.0, 0.1))


def _save_map(folder: Path, *, mode: Literal["trinary", "scale"]) -> Path:
    """A map as wherry saves it."""
    return save_map(_grid(), folder / "map.yaml", mode)


def _wean_map() -> str:
    """A map in Wean Hall's format."""
    columns = "\n".join(" ".join(["1.000000", "0.25", "-1.0", "0.0"]) for _ in range(6))
    return f"robot_specifications->resolution  10\n\nglobal_map[0]: 6 4\n{columns}\n"


def _write_map(folder: Path) -> Path:
    """A map with colours, as a PNG file."""
    pixels = np.random.default_rng(0).integers(0, 256, (6, 8, 4), np.uint8)
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "PNG")
    (folder / "map.png").write_bytes(file.getvalue())
    return _writer("map.yaml", MAP)(folder)


MAP = """image: map.png
mode: scale
resolution: 5e-2
origin: [-1.0, 2, .5]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.25
"""
AMCL_NAV2 = """/**:
  ros__parameters:
    use_sim_time: true
amcl:
  ros__parameters:
    alpha1: 0.2
    alpha2: 2e-1
    laser_max_range: 100.0
    laser_model_type: "likelihood_field"
    max_beams: 60
    max_particles: 2000
    min_particles: 500
    initial_pose: {x: 1.0, y: 2.0, z: 0.0, yaw: 0.5}
    robot_model_type: "nav2_amcl::DifferentialMotionModel"
    recovery_alpha_fast: 0.0
    z_hit: 0.5
    z_rand: 0.5
map_server:
  ros__parameters:
    yaml_filename: "map.yaml"
"""
AMCL_ROS1 = """odom_alpha1: 0.2
laser_max_range: 12.0
laser_z_hit: 0.95
laser_z_rand: 0.05
kld_err: 0.01
min_particles: 100
initial_pose_x: 1.0
initial_cov_xx: 0.25
laser_model_type: beam
do_beamskip: false
"""
NAMES = """namespace: robot1
frame_prefix: robot1/
topics: {scan: front/scan, cmd_vel: /teleop/cmd_vel}
frames:
  laser: lidar_link
rates: {diagnostics: 2.0}
"""


def _write_graph(folder: Path) -> Path:
    """A pose graph of a short drive along a wall."""
    slam = GraphSlam(Pose(0.1, 0.0, 0.0))
    for step in range(12):
        angles = np.linspace(-1.5, 1.5, 61)
        ranges = np.minimum(2.0 / np.maximum(np.abs(np.sin(angles)), 0.2), 6.0 - 0.3 * step + np.zeros(61))
        scan = Scan(float(step), ranges, -1.5, 0.05, 0.1, 20.0)
        slam.add(scan, Odometry(float(step), Pose(0.3 * step, 0.0, 0.0), Velocity(0.3, 0.0)))
    save_graph(slam.snapshot(), folder / "graph.npz")
    return folder / "graph.npz"


def _write_trace(folder: Path) -> Path:
    """The trace of a short run."""
    with TraceRecorder(folder / "trace.wherry") as record:
        for each in short_run():
            record(each)
    return folder / "trace.wherry"


def _load_rules(path: Path) -> RuleLearner:
    """Rules of the world in which `_rules_writer` learns them."""
    return load_rules(path, delivery_grid(find_world("small")).domain)


def _rules_writer(learner_name: str) -> Callable[[Path], Path]:
    """A function that writes the rules that a learner has after some steps."""

    def write(folder: Path) -> Path:
        environment = delivery_grid(find_world("small"))
        learner = RULE_LEARNERS[learner_name].factory(environment.domain)
        rng = np.random.default_rng(0)
        state = environment.reset(rng)
        for _ in range(60):
            actions = environment.domain.ground_actions(state)
            transition = environment.step(actions[rng.integers(len(actions))])
            learner.add_experience(transition)
            state = environment.reset(rng) if transition.terminated else transition.next_state
        save_rules(learner, folder / "rules.json")
        return folder / "rules.json"

    return write


def _write_bag(folder: Path, *, kind: str, file: bool, compressed: bool) -> Path:
    """Write a bag, and return its folder or, if ``file``, the only file of its data."""
    path = write_bag(folder, kind, compressed=compressed)
    return next(each for each in sorted(path.iterdir()) if each.suffix != ".yaml") if file else path


def _read_bag(path: Path, *, lenient: bool) -> LidarLog:
    """Read a bag."""
    return read_bag(path, ReadingOptions(lenient=lenient))


YAML = {"": (*TEXT, *[change_yaml] * 8)}
LENIENT = ReadingOptions(lenient=True)
MAP_MUTATIONS = {".yaml": YAML[""], ".pgm": (*BYTES, *TEXT), ".png": (*BYTES, *[change_png] * 10)}
TEXT_OR_GZIP = {"": TEXT, ".gz": (gunzip_and(*TEXT, *BYTES), gunzip_and(*TEXT, *BYTES), *BYTES)}
RULE_LOADERS = tuple(
    Loader(
        f"rules-{name}",
        _load_rules,
        invariants.check_rules,
        _rules_writer(name),
        {"": (*TEXT, *[change_json] * 12)},
    )
    for name, entry in RULE_LEARNERS.items()
    if entry.codec is not None
)
BAG_LOADERS = tuple(
    Loader(
        name,
        partial(_read_bag, lenient=lenient),
        invariants.check_log,
        partial(_write_bag, kind=kind, file=file, compressed=compressed),
        {"": BYTES, ".db3": (*[change_sqlite] * 8, *BYTES), ".yaml": YAML[""]},
        "rosbags",
    )
    for name, kind, file, compressed, lenient in (
        ("bag-ros1", "ros1", False, False, False),
        ("bag-ros1-lenient", "ros1", False, False, True),
        ("bag-ros1-bz2", "ros1", False, True, False),
        ("bag-db3-folder", "sqlite", False, False, False),
        ("bag-db3-file", "sqlite", True, False, True),
        ("bag-mcap-folder", "mcap", False, False, False),
        ("bag-mcap-file", "mcap", True, False, True),
    )
)


LOADERS: tuple[Loader, ...] = (
    Loader("carmen", read_log, invariants.check_log, _writer("drive.log", _carmen_log()), TEXT_OR_GZIP),
    Loader(
        "carmen-lenient",
        lambda path: read_log(path, LENIENT),
        invariants.check_log,
        _writer("drive.log", _carmen_log()),
        TEXT_OR_GZIP,
    ),
    Loader(
        "carmen-gz",
        read_log,
        invariants.check_log,
        _writer("drive.log.gz", gzip.compress(_carmen_log().encode(), mtime=0)),
        TEXT_OR_GZIP,
    ),
    Loader("wean-log", read_log, invariants.check_log, _writer("wean.log", _wean_log()), TEXT_OR_GZIP),
    *BAG_LOADERS,
    Loader(
        "odometry",
        read_odometry,
        invariants.check_trajectory,
        _writer("odometry.txt", "# t x y theta\n" + "".join(f"{i}.5 {0.1 * i:.1f} 0.2 0.1\n" for i in range(20))),
        TEXT_OR_GZIP,
    ),
    Loader(
        "tum",
        read_odometry,
        invariants.check_trajectory,
        _writer("poses.tum", "".join(f"{i}.5 {0.1 * i:.1f} 0.2 0 0 0 0.1 0.99\n" for i in range(20))),
        TEXT_OR_GZIP,
    ),
    Loader(
        "trajectory-csv",
        lambda path: read_trajectory(path)[0],
        invariants.check_trajectory,
        _writer("poses.csv", "time [s], x, y, yaw\n" + "".join(f"{i}.5, {0.1 * i:.1f}, 0.2, 0.1\n" for i in range(20))),
        TEXT_OR_GZIP,
    ),
    Loader(
        "odometry-of-log",
        _read_odometry_of_log,
        invariants.check_log,
        _writer("odometry.txt", "".join(f"{100 + 0.1 * i} {0.02 * i:.2f} 0.5 0.1\n" for i in range(40))),
        TEXT_OR_GZIP,
    ),
    Loader(
        "relations",
        load_relations,
        invariants.check_relations,
        _writer("some.relations", "".join(f"{i}.5 {i + 1}.5 0.5 0.1 0 0 0 0.2\n" for i in range(10))),
        TEXT_OR_GZIP,
    ),
    Loader(
        "map-trinary",
        load_map,
        invariants.check_grid,
        lambda folder: save_map(_grid(), folder / "map.yaml"),
        MAP_MUTATIONS,
    ),
    Loader(
        "map-scale",
        load_map,
        invariants.check_grid,
        lambda folder: save_map(_grid(), folder / "map.yaml", "scale"),
        MAP_MUTATIONS,
    ),
    Loader("map-colours", load_map, invariants.check_grid, _write_map, MAP_MUTATIONS),
    Loader("wean-map", load_wean_map, invariants.check_grid, _writer("wean.dat", _wean_map()), TEXT_OR_GZIP),
    Loader(
        "wean-map-gz",
        load_wean_map,
        invariants.check_grid,
        _writer("wean.dat.gz", gzip.compress(_wean_map().encode(), mtime=0)),
        TEXT_OR_GZIP,
    ),
    Loader("amcl-nav2", load_parameters, invariants.check_parameters, _writer("amcl.yaml", AMCL_NAV2), YAML),
    Loader("amcl-ros1", load_parameters, invariants.check_parameters, _writer("amcl.yaml", AMCL_ROS1), YAML),
    Loader("names", load_names, invariants.check_names, _writer("names.yaml", NAMES), YAML),
    Loader("body", load_body, invariants.check_body, _writer("body.yaml", default_body_text()), YAML),
    Loader(
        "latch",
        load_latch_settings,
        invariants.check_latch,
        _writer("latch.yaml", format_latch_settings(GazeboLatchSettings(3, 0.4, 0.6, find_world("small").warehouse))),
        YAML,
    ),
    Loader(
        "world", load_world, invariants.check_plan, _writer("small.txt", format_world(find_world("small"))), {"": TEXT}
    ),
    *RULE_LOADERS,
    Loader(
        "pose-graph",
        load_graph,
        invariants.check_graph,
        _write_graph,
        {"": (*[change_npz] * 12, unzip_and(*BYTES), unzip_and(*BYTES), *BYTES)},
    ),
    Loader("trace", load_trace, invariants.check_records, _write_trace, {"": (*[change_trace] * 12, *BYTES)}),
)
