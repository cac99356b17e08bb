"""Messages of /tf and /tf_static made for tests, in ROS 1 and ROS 2."""

from rosbags.typesys import get_types_from_msg

from tests.workers.readers.making_recordings import header

TF = "tf2_msgs/msg/TFMessage"
LIDAR = ("base_link", "velodyne", (1.2, 0.0, 1.9), (0.0, 0.0, 0.0, 1.0))
# Not of unit length, as people type them.
CAMERA = ("base_link", "/camera", (1.5, 0.1, 1.4), (-1.0, 1.0, -1.0, 1.0))


def message(types, stated, stamp_ns=1_700_000_000_000_000_000):
    """A TFMessage of (parent, child, translation, quaternion)s, of the ROS whose types these are."""
    if TF not in types.types:
        types.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms\n", TF))

    def of(name, *fields):
        return types.types[f"geometry_msgs/msg/{name}"](*fields)

    placed = [
        of("TransformStamped", header(stamp_ns, parent, types), child,
           of("Transform", of("Vector3", *offset), of("Quaternion", *turn)))
        for parent, child, offset, turn in stated
    ]  # fmt: skip
    return types.types[TF](placed)
