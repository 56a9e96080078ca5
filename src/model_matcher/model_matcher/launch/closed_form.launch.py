"""The whole graph on rendered images: renderer, recovery, matcher, and the emulator beside them.

ros2 launch model_matcher closed_form.launch.py scene:=l_shape_v1 models:="['l_shape']" rviz:=true
"""

from typing import List  # noqa: UP035  (launch knows this List, not the built-in one)

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

ARGUMENTS = {
    'namespace': ('', 'Namespace of all nodes'),
    'scene': ('l_shape_v1', 'Scene file, or the name of a scene of csg_renderer'),
    'models': ("['l_shape']", 'Model files, folders, or names of models of csg_renderer'),
    'rate': ('2.0', 'Stereo pairs a second'),
    'noise': ('1.0', 'Sensor noise, grey levels'),
    'turntable': ('0.0', 'Turn of the scene between pairs, degrees'),
    'respawn': ('true', 'Start a node again that has died'),
    'rviz': ('false', 'true to open RViz'),
}


def generate_launch_description():
    """The launch description, as ros2 launch asks for it."""
    share = FindPackageShare('model_matcher')
    value = {name: LaunchConfiguration(name) for name in ARGUMENTS}

    def node(package, executable, config, parameters=None):
        file = PathJoinSubstitution([FindPackageShare(package), 'config', config])
        return Node(
            package=package,
            executable=executable,
            namespace=value['namespace'],
            respawn=value['respawn'],
            parameters=[file, parameters or {}],
            # Half a second lets the dead one's topics go.
            respawn_delay=0.5,
            output='screen',
            # Threads of OpenBLAS are of no use to small matrices and slow the start down.
            additional_env={'OPENBLAS_NUM_THREADS': '1'},
        )

    return LaunchDescription(
        [
            *[
                DeclareLaunchArgument(name, default_value=default, description=text)
                for name, (default, text) in ARGUMENTS.items()
            ],
            node(
                'csg_renderer',
                'renderer_node',
                'renderer.yaml',
                {
                    'scene': ParameterValue(value['scene'], value_type=str),
                    **{name: ParameterValue(value[name], value_type=float) for name in ('rate', 'noise', 'turntable')},
                },
            ),
            node('stereo_recovery', 'recovery_node', 'recovery.yaml'),
            node(
                'model_matcher',
                'matcher_node',
                'matcher.yaml',
                {'models': ParameterValue(value['models'], value_type=List[str])},  # noqa: UP006
            ),
            node('dap_emulator', 'emulator_node', 'emulator.yaml'),
            Node(
                package='rviz2',
                executable='rviz2',
                condition=IfCondition(value['rviz']),
                arguments=['-d', PathJoinSubstitution([share, 'config', 'recognise.rviz'])],
            ),
        ]
    )
