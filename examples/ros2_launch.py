"""Start `trexton onboard` and the node that publishes its positions:

ros2 launch ros2_launch.py map:=/opt/trexton/hall.npz camera:=/dev/video0 heading:=84.0
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration

ARGUMENTS = {"map": "hall.npz", "camera": "/dev/video0", "heading": "0.0", "frame_id": "map"}


def generate_launch_description():
    value = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    command = ["['trexton', 'onboard', '", value["map"], "', '--camera', '", value["camera"], "']"]
    node = ExecuteProcess(
        cmd=[
            *("python3", str(Path(__file__).with_name("ros2_node.py")), "--ros-args"),
            *("-p", ["heading:=", value["heading"]], "-p", ["frame_id:=", value["frame_id"]]),
            *("-p", ["command:=", *command]),
        ],
        output="screen",
    )
    declared = [
        DeclareLaunchArgument(name, default_value=usual) for name, usual in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, node])
