"""Messages of /tf and /tf_static made for tests, in ROS 1 and ROS 2."""

from rosbags.typesys import get_types_from_msg

TF = "tf2_msgs/msg/TFMessage"
LIDAR = ("base_link", "velodyne", (1.2, 0.0, 1.9), (0.0, 0.0, 0.0, 1.0))
# Not of unit length, as people type them.
CAMERA = ("base_link", "/camera", (1.5, 0.1, 1.4), (-1.0, 1.0, -1.0, 1.0))


def message(types, stated, stamp_ns=1_700_000_000_000_000_000):
    """A TFMessage of (parent, child, translation, quaternion)s, of the ROS whose types these are."""
    if TF not in types.types:
        types.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms\n", TF))

    def of(name, *fields):
        return types.types[name](*fields)

    head = [0] if "seq" in types.types["std_msgs/msg/Header"].__dataclass_fields__ else []
    time = of("builtin_interfaces/msg/Time", *divmod(stamp_ns, 10**9))
    placed = []
    for parent, child, t, q in stated:
        offset, turn = of("geometry_msgs/msg/Vector3", *t), of("geometry_msgs/msg/Quaternion", *q)
        header = of("std_msgs/msg/Header", *head, time, parent)
        transform = of("geometry_msgs/msg/Transform", offset, turn)
        placed.append(of("geometry_msgs/msg/TransformStamped", header, child, transform))
    return of(TF, placed)
