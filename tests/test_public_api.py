"""The public API: the names that each package exports, and their use in documents."""

from __future__ import annotations

import ast
import importlib
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[1]
INTERNAL = ("wherry.commands", "wherry.experiments", "wherry.pipelines")
HEAVY = ("gymnasium", "matplotlib", "mujoco", "numba", "numpy", "pydantic", "scipy", "starlette")

PUBLIC_API = {
    name: tuple(exported.split())
    for name, exported in {
        "wherry.adapters": """
            GymnasiumAdapter GymnasiumTaxi MINIGRID_EFFECT_TYPES MiniGrid gymnasium_taxi_reward
            is_at_goal is_delivered minigrid_domain
        """,
        "wherry.baselines": """
            BASELINES FactoredRmax ModelEntries QLearning Rmax TabularLearner TabularMdp
            TabularQLearning TabularRmax
        """,
        "wherry.domains": """
            BoxState DeliveryHeuristic DeliverySite TaxiGrid all_delivered boxes_left
            delivery_domain delivery_grid delivery_reward delivery_transition taxi_domain taxi_grid
        """,
        "wherry.environments": """
            DeliveryEnvironment ObjectEnvironment TaxiEnvironment
        """,
        "wherry.episodes": """
            Agent ConditionalLearner Decision GoalAgent PolicyAgent Step run_episode
        """,
        "wherry.errors": """
            InputError on_one_line
        """,
        "wherry.evaluation": """
            RelationErrors Relations absolute_trajectory_error align load_relations matching_times position_errors
            relation_errors root_mean_square
        """,
        "wherry.floorplan": """
            Cell Direction FloorPlan Wall built_in_worlds find_world format_world generate_world
            load_world parse_world place_boxes
        """,
        "wherry.gazebo": """
            GENERATIONS GazeboExportSettings GazeboGeneration GazeboLatch GazeboLatchSettings
            export_world load_latch_settings
        """,
        "wherry.learning": """
            BayesianLearner Doormax Job LearnerEntry RULE_LEARNERS Rule RuleLearner UnknownAnswers
            UnknownPairs learners_for load_rules save_rules
        """,
        "wherry.localization": """
            Amcl AmclParameters EkfLocalization GLOBAL_PARAMETERS GridMarkov Hypothesis
            LOG_PARAMETERS LoadedParameters Localization Localizer LostDetector PRECISE_PARAMETERS
            PoseEstimate PoseMode Relocalization Relocalizer ScanAgreement load_parameters
        """,
        "wherry.logs": """
            LidarLog ReadingOptions increasing_times read_log read_odometry read_rows read_trajectory
            with_odometry_file
        """,
        "wherry.mapping": """
            ContradictionKind GraphSlam GraphSlamSettings GraphSnapshot LoopClosure
            OdometryContradiction ParticleSlam ParticleSlamSettings PoseGraph Rejection SLAM_METHODS
            ScanMatchingLocalizer Slam SlamMethod SlamSettings describe_contradictions load_graph
            locate_on_map optimized save_graph
        """,
        "wherry.navigation": """
            Costmap Viewpoint clear_distance drive_line follow_path frontier_cells go_to
            next_viewpoint safe_velocity shortest_path travel_costs turn_to visible_unknown_area
        """,
        "wherry.oomdp": """
            Action Attribute AttributeKind Condition ConditionalModel ConditionalOutcome
            ConditionalPrediction DIRECTIONS DeterministicMdp Domain EFFECT_TYPES Effect EffectType
            EffectsOutcome Environment GivenTask IMPOSSIBLE Learner Model ON Object ObjectClass Outcome
            PAPER_TYPES PerStateModel Prediction Relation RewardFunction Scene State StepReward
            TOUCH TOUCH_EDGE Term TerminationFunction Transition UNKNOWN attribute_holds
            attribute_is boolean enumeration integer property_holds real related state_from_json
        """,
        "wherry.planning": """
            Lrtdp PLANNERS PddlTask Plan Planner PlannerEntry PolicyIteration PredictionCache
            StateSpace Uct ValueIteration a_star cheapest_experiment export_pddl
        """,
        "wherry.realization": """
            BoxTrack CellMap DriveStatus GlobalPoseEstimator MapPoseEstimator Mapper Mission Order
            Pilot PoseEstimator PoseTracker RobotEnvironment SinglePoseEstimator SlamMapper
            SlamPoseEstimator SurveyedWorld Surveyor blocked_directions detect_cylinders
            floor_plan_from_map order_from_plan update_tracks
        """,
        "wherry.robot": """
            Body Odometry Robot Scan Velocity mark_no_return
        """,
        "wherry.ros": """
            BodyParameters Frames MessageError QosProfile Rates RosNames StampedTransform Topic
            Topics decode_laser_scan decode_occupancy_grid decode_odometry decode_transform
            decode_twist encode_laser_scan encode_occupancy_grid encode_odometry encode_transform
            encode_twist load_body load_names robot_description
        """,
        "wherry.ros.bags": """
            BagWriter LogRecorder RecordedRobot RecordedTransport RunRecorder is_bag read_bag
        """,
        "wherry.ros.nodes": """
            AgentNode ExternalMap ExternalMapper ExternalPose LatchCommand LatchState Monitor
            RobotLostError RosRobot SimulatorNode simulator_node
        """,
        "wherry.ros.transports": """
            Ros1Transport Ros2Transport Transport
        """,
        "wherry.simulation": """
            BODY BoxStatus BoxTruth Collision LidarSpecification Referee SceneRenderer SeededWorld
            Simulation WheelOdometryErrors blind_lidar build cell_pose kidnap random_cell_pose random_pose
            reachable_cells robot_urdf seed_world slippery_wheels true_map
        """,
        "wherry.space": """
            CellFrame DistanceField GridMapper IDENTITY OccupancyGrid Pose Trajectory cast_rays
            compose fit_cell_frame load_map load_wean_map merge_odometry relative
            save_map save_trajectory save_tum wrap
        """,
        "wherry.trace": """
            CellLayout LearntModel LearntRule MapUpdate Narration ObjectSnapshot PerceivedState
            Phase Record RobotSnapshot RunStarted Sink StepTaken TraceRecorder combine_sinks
            find_trace load_trace null_sink throttle_snapshots
        """,
        "wherry.views": """
            DeliveryProgress DeliveryReport MapBackground PageServer ReportPicture TraceBroadcast
            draw_snapshot learning_curves player_page render_report rerun_recording serve_editor
            serve_recording serve_run
        """,
    }.items()
}


def public_names(module: ModuleType) -> list[str]:
    """The names in ``__all__`` or, for a single module, those that it defines."""
    if hasattr(module, "__all__"):
        return sorted(module.__all__)
    source = ast.parse(Path(module.__file__ or "").read_text("utf-8"))
    definitions = (ast.ClassDef, ast.FunctionDef)
    return sorted(node.name for node in source.body if isinstance(node, definitions) and not node.name.startswith("_"))


@pytest.mark.parametrize("name", PUBLIC_API)
def test_each_package_exports_exactly_its_public_names(name: str) -> None:
    module = importlib.import_module(name)
    assert public_names(module) == sorted(PUBLIC_API[name])
    for exported in PUBLIC_API[name]:
        assert getattr(module, exported) is not None


def test_every_package_with_exports_is_listed() -> None:
    stubs = (path.relative_to(ROOT / "src").parent for path in (ROOT / "src/wherry").glob("**/__init__.pyi"))
    packages = {".".join(path.parts) for path in stubs}
    assert {name for name in packages if not name.startswith(INTERNAL)} == {
        name for name in PUBLIC_API if (ROOT / "src" / name.replace(".", "/")).is_dir()
    }


def test_importing_packages_imports_nothing_heavy() -> None:
    packages = [name for name in PUBLIC_API if (ROOT / "src" / name.replace(".", "/")).is_dir()]
    packages.remove("wherry.environments")  # registers its ids with Gymnasium
    code = f"import sys, {', '.join(packages)}; print(*(name for name in {HEAVY} if name in sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "\n"


def code_of(path: Path) -> Iterator[str]:
    """The Python code of a module, a notebook or the fenced blocks of a page."""
    text = path.read_text("utf-8")
    if path.suffix == ".md":
        yield from re.findall(r"^```python\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    elif path.suffix == ".ipynb":
        yield from ("".join(cell["source"]) for cell in json.loads(text)["cells"] if cell["cell_type"] == "code")
    else:
        yield text


DOCUMENTS = [
    ROOT / "README.md",
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "docs/how-to").glob("*.md")),
    *sorted((ROOT / "docs/notebooks").glob("*.ipynb")),
    *sorted((ROOT / "docs/examples").glob("*.py")),
]


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_documents_import_only_public_names(path: Path) -> None:
    for code in code_of(path):
        for node in ast.walk(ast.parse(code)):
            if isinstance(node, ast.Import):
                assert not [alias.name for alias in node.names if alias.name.startswith("wherry.")]
            elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("wherry"):
                assert {alias.name for alias in node.names} <= set(PUBLIC_API.get(node.module or "", ())), node.module


def test_the_reference_documents_the_public_packages() -> None:
    listed = re.findall(r"^   (wherry\.[\w.]+)$", (ROOT / "docs/reference.md").read_text("utf-8"), re.MULTILINE)
    assert len(listed) == len(set(listed))
    assert set(listed) == set(PUBLIC_API)
