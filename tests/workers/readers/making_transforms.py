"""Messages of /tf and /tf_static made for tests, in ROS 1 and ROS 2."""

from making_recordings import START_NS
from making_recordings import TYPES as ROS1
from making_ros2 import TYPES as ROS2
from rosbags.typesys import get_types_from_msg

TF = "tf2_msgs/msg/TFMessage"
for types in (ROS1, ROS2):
    if TF not in types.types:
        types.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms\n", TF))
LIDAR = ("base_link", "velodyne", (1.2, 0.0, 1.9), (0.0, 0.0, 0.0, 1.0))
# Not of unit length, as people type them.
CAMERA = ("base_link", "/camera", (1.5, 0.1, 1.4), (-1.0, 1.0, -1.0, 1.0))


def message(types, *stated, stamp_ns=START_NS):
    def of(name, *fields):
        return types.types[name](*fields)

    head = [0] if types is ROS1 else []
    return of(
        TF,
        [
            of(
                "geometry_msgs/msg/TransformStamped",
                of("std_msgs/msg/Header", *head, of("builtin_interfaces/msg/Time", *divmod(stamp_ns, 10**9)), parent),
                child,
                of(
                    "geometry_msgs/msg/Transform",
                    of("geometry_msgs/msg/Vector3", *t),
                    of("geometry_msgs/msg/Quaternion", *q),
                ),
            )
            for parent, child, t, q in stated
        ],
    )
