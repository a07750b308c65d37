"""Gazebo Sim with the world of this folder, the bridge to ROS 2, the robot's fixed transforms, and its latch."""

# ros2 launch gazebo.launch.py                                       with a window
# ros2 launch gazebo.launch.py options:="-s --headless-rendering"    without one
# ros2 launch gazebo.launch.py latch:=false                          and work the latch yourself

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, IncludeLaunchDescription
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

HERE = Path(__file__).resolve().parent


def generate_launch_description():
    """What ros2 launch starts."""
    gazebo = PathJoinSubstitution([FindPackageShare("ros_gz_sim"), "launch", "gz_sim.launch.py"])
    return LaunchDescription(
        [
            DeclareLaunchArgument("options", default_value="", description="More options for Gazebo, such as -s."),
            DeclareLaunchArgument("latch", default_value="true", description="Whether wherry works the latch."),
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(gazebo),
                launch_arguments={
                    "gz_args": ["-r ", LaunchConfiguration("options"), " ", str(HERE / "world.sdf")]
                }.items(),
            ),
            Node(
                package="ros_gz_bridge",
                executable="parameter_bridge",
                parameters=[{"config_file": str(HERE / "bridge.yaml"), "use_sim_time": True}],
                output="screen",
            ),
            Node(
                package="robot_state_publisher",
                executable="robot_state_publisher",
                parameters=[
                    {"robot_description": (HERE / "robot.urdf").read_text(encoding="utf-8"), "use_sim_time": True}
                ],
            ),
            ExecuteProcess(
                cmd=["wherry", "ros2", "gazebo-latch", str(HERE / "latch.yaml")],
                condition=IfCondition(LaunchConfiguration("latch")),
                output="screen",
            ),
        ]
    )
