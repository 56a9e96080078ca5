r"""recovery_node, matcher_node and tracker_node on your stereo camera.

ros2 launch model_matcher recognise.launch.py models:="['/robot/models/part.csg']" \
        left_image:=/stereo/left/image_rect left_info:=/stereo/left/camera_info \
        right_image:=/stereo/right/image_rect right_info:=/stereo/right/camera_info
"""

from typing import List  # noqa: UP035  (launch knows this List, not the built-in one)

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, PythonExpression
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

ARGUMENTS = {
    'namespace': ('', 'Namespace of all nodes'),
    'models': ("['l_shape']", 'Model files, folders, or names of models of csg_renderer'),
    'left_image': ('left/image_rect', 'Topic of the left image'),
    'left_info': ('left/camera_info', 'Topic of its camera_info'),
    'right_image': ('right/image_rect', 'Topic of the right image'),
    'right_info': ('right/camera_info', 'Topic of its camera_info'),
    'side_by_side': ('false', 'true when both images come as the halves of one'),
    'image': ('image_rect', 'Topic of that one'),
    'image_transport': ('raw', 'compressed when the images come as JPEG or PNG, on topics that end in /compressed'),
    'image_bits': ('16', 'How many of its 16 bits the camera fills, where images have 16'),
    'rectify': ('false', 'true when the images are raw; then only recovery_node looks at them, and nothing is tracked'),
    'tf': ('false', 'true to broadcast the poses of followed objects on /tf'),
    'use_sim_time': ('false', 'true when a bag or a simulator publishes /clock'),
    'respawn': ('true', 'Start a node again that has died'),
    'rviz': ('false', 'true to open RViz'),
    'frame': ('camera_left_optical_frame', 'The frame in which RViz shows things: that of the left images'),
}


def generate_launch_description():
    """The launch description, as ros2 launch asks for it."""
    share = FindPackageShare('model_matcher')
    value = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    models = ParameterValue(value['models'], value_type=List[str])  # noqa: UP006
    rectified = PythonExpression(["'", value['rectify'], "' != 'true'"])
    topics = [
        ('left/image_rect', value['left_image']),
        ('left/camera_info', value['left_info']),
        ('right/image_rect', value['right_image']),
        ('right/camera_info', value['right_info']),
        ('image_rect', value['image']),
    ]
    images = {
        'side_by_side': ParameterValue(value['side_by_side'], value_type=bool),
        'image_transport': value['image_transport'],
        'image_bits': ParameterValue(value['image_bits'], value_type=int),
    }
    sim_time = {'use_sim_time': ParameterValue(value['use_sim_time'], value_type=bool)}

    def node(**arguments):
        """A node that is started again when it has died; half a second lets the dead one's topics go."""
        # Threads of OpenBLAS are of no use to small matrices and slow the start down.
        return Node(
            namespace=value['namespace'],
            respawn=value['respawn'],
            respawn_delay=0.5,
            output='screen',
            additional_env={'OPENBLAS_NUM_THREADS': '1'},
            **arguments,
        )

    return LaunchDescription(
        [
            *[
                DeclareLaunchArgument(name, default_value=default, description=text)
                for name, (default, text) in ARGUMENTS.items()
            ],
            node(
                package='stereo_recovery',
                executable='recovery_node',
                parameters=[
                    PathJoinSubstitution([FindPackageShare('stereo_recovery'), 'config', 'recovery.yaml']),
                    {'rectify': ParameterValue(value['rectify'], value_type=bool)},
                    images,
                    sim_time,
                ],
                remappings=topics,
            ),
            node(
                package='model_matcher',
                executable='matcher_node',
                parameters=[
                    PathJoinSubstitution([share, 'config', 'matcher.yaml']),
                    {'models': models, 'use_images': ParameterValue(rectified, value_type=bool)},
                    images,
                    sim_time,
                ],
                remappings=topics,
            ),
            node(
                package='model_matcher',
                executable='tracker_node',
                condition=IfCondition(rectified),
                parameters=[
                    PathJoinSubstitution([share, 'config', 'tracker.yaml']),
                    {'models': models, 'tf': ParameterValue(value['tf'], value_type=bool)},
                    images,
                    sim_time,
                ],
                remappings=topics,
            ),
            Node(
                package='rviz2',
                executable='rviz2',
                condition=IfCondition(value['rviz']),
                remappings=[('/left/image_rect', value['left_image'])],
                arguments=['-d', PathJoinSubstitution([share, 'config', 'recognise.rviz']), '-f', value['frame']],
            ),
        ]
    )
